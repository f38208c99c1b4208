// What weight does to the robot: torques in the joints, the true centre of mass.
#pragma once

#include "core/robot/limb_kinematics.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Torque [Nm] that each joint needs to carry its own distal links, by virtual work: τⱼ = −Σ mᵢ g·∂cᵢ/∂qⱼ.
JointVector gravity_torque(const LimbState& limb, const Vector3& gravity_B_m_s2);

/// Joint torque [Nm] that makes the gripper bear `on_robot`, the wrench the world puts on it at its centre, axes of B:
/// τ = −Jᵀ·w.
JointVector contact_torque(const LimbState& limb, const Wrench& on_robot_B);

/// Centre of mass of body and limbs in B [m].
Vector3 centre_of_mass(const RobotDescription& robot, const PerLimb<LimbState>& limbs);

}  // namespace crux
