// The robot of the tests with gears, signs, offsets and a belt between its actuators and joints.
#pragma once

#include <crux_msgs/control_input_t.hpp>

#include "core/robot/robot_description.hpp"
#include "fixture.hpp"

namespace crux_test {

inline RobotDescription geared_robot() {
  RobotDescription geared = robot();
  crux_msgs::robot::Transmissions& section = geared.transmissions;
  section.ratio = {-1.0, 2.0, 1.0, 0.7, -1.5, 0.8, 1.0};
  section.offset_rad = {0.3, -0.5, 0.2, 0.0, 0.1, -0.4, 0.0};
  section.coupled_to = {0, 0, 2, 0, 0, 5, 0};
  section.coupling = {0.0, 0.0, -0.6, 0.0, 0.0, 0.4, 0.0};
  for (LimbDescription& limb : geared.limbs) {
    limb.transmission = Transmission(section, limb.driven, "robot.yaml");
    limb.actuators = limb.transmission.reached(limb.joints);
  }
  return geared;
}

/// What the nodes of its actuators tell where those of joints would tell `joints`.
inline crux_msgs::control_input_t of_actuators(const RobotDescription& geared,
                                               const crux_msgs::control_input_t& joints) {
  crux_msgs::control_input_t told = joints;
  for (int l = 0; l < kLimbs; ++l) {
    const Transmission& by = geared.limbs[l].transmission;
    const int at = kJoints * l;
    Eigen::Map<JointVector>(told.joint_position_rad + at) =
        by.actuators_rad(JointVector(joints.joint_position_rad + at));
    Eigen::Map<JointVector>(told.joint_velocity_rad_s + at) =
        by.actuator_ways(JointVector(joints.joint_velocity_rad_s + at));
    Eigen::Map<JointVector>(told.joint_torque_nm + at) =
        by.actuator_torque_Nm(JointVector(joints.joint_torque_nm + at));
  }
  return told;
}

}  // namespace crux_test
