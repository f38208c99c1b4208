// The robot of the tests with gears, signs, offsets and a belt between its actuators and joints, and with five-bars.
#pragma once

#include <algorithm>
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
    limb.actuators = limb.transmission.reached(limb.joints, limb.own, own_limits(section));
  }
  return geared;
}

/// Five-bars between the actuators and its second and third joints, whose limits no speed or torque narrows.
inline RobotDescription five_barred_robot() {
  RobotDescription made = robot();
  made.five_bar = {.first_joint = 2.0,
                   .crank_x_m = 0.0,
                   .crank_y_m = 0.038,
                   .crank_m = 0.15,
                   .rod_m = 0.188,
                   .pin_x_m = 0.177,
                   .pin_y_m = -0.046,
                   .bends = -1.0,
                   .least_sine = 0.2};
  made.transmissions.ratio[2] = -1.5;
  made.transmissions.speed_rad_s.fill(1e3);
  made.transmissions.torque_Nm.fill(1e4);
  for (LimbDescription& limb : made.limbs) {
    const ParallelJoints joints = parallel_joints(limb.chain, 1).value();
    const auto middle = [&](int j) { return (limb.own[j].lower_rad + limb.own[j].upper_rad) / 2.0; };
    const FiveBar bar(made.five_bar, joints.apart_m, joints.sense, {middle(1), middle(2)});
    limb.transmission = Transmission(made.transmissions, limb.driven, "robot.yaml", bar);
    const LimbLimits own = own_limits(made.transmissions), left = limb.transmission.within(limb.own, own);
    std::copy_n(left.begin(), limb.driven, limb.joints.begin());
    limb.actuators = limb.transmission.reached(limb.joints, limb.own, own);
    limb.crank = limb.transmission.crank_limits(own);
  }
  return made;
}

/// What the nodes of its actuators tell where those of joints would tell `joints`.
inline crux_msgs::control_input_t of_actuators(const RobotDescription& geared,
                                               const crux_msgs::control_input_t& joints) {
  crux_msgs::control_input_t told = joints;
  for (int l = 0; l < kLimbs; ++l) {
    const Transmission& by = geared.limbs[l].transmission;
    const int at = kJoints * l;
    const JointVector q_rad(joints.joint_position_rad + at);
    Eigen::Map<JointVector>(told.joint_position_rad + at) = by.actuators_rad(q_rad);
    Eigen::Map<JointVector>(told.joint_velocity_rad_s + at) =
        by.actuator_ways(JointVector(joints.joint_velocity_rad_s + at), q_rad);
    Eigen::Map<JointVector>(told.joint_torque_nm + at) =
        by.actuator_torque_Nm(JointVector(joints.joint_torque_nm + at), q_rad);
  }
  return told;
}

}  // namespace crux_test
