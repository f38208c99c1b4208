// Inverse kinematics of one limb: damped least squares from the last command, inside position and speed limits.
#pragma once

#include "core/robot/limb_kinematics.hpp"

namespace crux {

/// Bits of limb_telemetry_t.ik_limited.
enum IkLimited : int { kIkPositionLimit = 1, kIkSpeedLimit = 2, kIkNoConvergence = 4 };

struct IkResult {
  JointVector q_rad = JointVector::Zero();
  int limited = 0;                       ///< IkLimited bits
  double position_error_m = 0;           ///< of the gripper centre that is left before the speed limit
  Vector3 missed_B_m = Vector3::Zero();  ///< the same as a vector, towards the target
  double rotation_error_rad = 0;
};

class InverseKinematics {
 public:
  InverseKinematics(const LimbDescription& limb, LimbKinematics& kinematics);

  /// Joint angles that bring the gripper to `target_B`, near `start_rad`. Joints stay inside their limits; what one at
  /// its limit cannot give, the others do as far as they can: the result is always the nearest pose found on the way
  /// from the start, never a jump back to a reference.
  IkResult solve(const Pose& target_B, const JointVector& start_rad, int max_iterations) noexcept;

  /// One control cycle: solve() from the last command with every joint slower than its speed limit. All joints are
  /// slowed by one common factor, so that the gripper goes on towards its target.
  IkResult step(const Pose& target_B, const JointVector& last_command_rad, double dt_s) noexcept;

 private:
  /// Damped least-squares step towards `error` that leaves every joint inside its limits.
  JointVector damped_step(const Matrix6& jacobian, const Vector6& error, const JointVector& q_rad,
                          double damping) const noexcept;

  JointVector lower_rad_, upper_rad_, velocity_rad_s_;
  LimbKinematics& kinematics_;
};

}  // namespace crux
