#include "core/robot/gravity.hpp"

#include <Eigen/Geometry>

namespace crux {

JointVector gravity_torque(const LimbState& limb, const Vector3& gravity_B_m_s2) {
  JointVector torque;
  for (int j = 0; j < kJoints; ++j) {
    const Vector3 gripper_velocity = limb.jacobian_B.block<3, 1>(0, j);
    const Vector3 axis = limb.jacobian_B.block<3, 1>(3, j);
    // A point at c moves with v_gripper + axis × (c − p_gripper); summed over the masses distal of the joint.
    const Vector3 arm = limb.distal_moment_B_kgm[j] - limb.distal_mass_kg[j] * limb.gripper_B.position_m;
    torque[j] = -gravity_B_m_s2.dot(limb.distal_mass_kg[j] * gripper_velocity + axis.cross(arm));
  }
  return torque;
}

JointVector contact_torque(const LimbState& limb, const Wrench& on_robot_B) {
  return -(limb.jacobian_B.topRows<3>().transpose() * on_robot_B.force_N +
           limb.jacobian_B.bottomRows<3>().transpose() * on_robot_B.moment_Nm);
}

Vector3 centre_of_mass(const RobotDescription& robot, const PerLimb<LimbState>& limbs) {
  double mass = robot.body_mass_kg;
  Vector3 moment = robot.body_mass_kg * robot.body_com_B_m;
  for (const LimbState& limb : limbs) {
    mass += limb.mass_kg;
    moment += limb.moment_B_kgm;
  }
  return moment / mass;
}

}  // namespace crux
