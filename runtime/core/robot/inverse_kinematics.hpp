// Inverse kinematics of one limb: damped least squares from the last command, inside position and speed limits.
// Of the angles of seven joints those count that are none off the middle of the joints' ranges in the way that leaves
// the gripper at rest there, as planner and checker have it.
#pragma once

#include "core/robot/limb_kinematics.hpp"
#include "core/robot/linkage_limits.hpp"

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
  /// slowed by one common factor, so that the gripper goes on towards its target. Joints that begin off their angles of
  /// a pose come to them slowly, with the gripper on its target.
  IkResult step(const Pose& target_B, const JointVector& last_command_rad, double dt_s) noexcept;

 private:
  using Errors = JointVector;  ///< of the gripper's pose, weighted, then how far the joints are off along `spare_`

  struct Target {
    Pose gripper_B;
    double spare_rad = 0.0;  ///< along `spare_`
  };

  /// Errors, and what small ways of the joints take off them.
  struct Linear {
    Errors errors;
    JointMatrix jacobian;
  };

  IkResult solve(const Target& target, const JointVector& start_rad, int max_iterations) noexcept;
  void evaluate(const JointVector& q_rad, const Target& target, Linear& here) noexcept;
  /// Damped least-squares step that leaves every joint inside these ranges.
  JointVector damped_step(const Linear& here, const JointVector& q_rad, double damping, const JointVector& lower_rad,
                          const JointVector& upper_rad) const noexcept;
  /// Where that leads to inside the limits; along the edge of what a five-bar leaves.
  JointVector stepped(const Linear& here, const JointVector& q_rad, double damping) const noexcept;

  LinkageLimits limits_;
  JointVector spare_ = JointVector::Zero();  ///< the way; 0: of six turns there is none
  double spare_rad_ = 0.0;                   ///< how far the middle is along it
  int turns_;
  LimbKinematics& kinematics_;
};

}  // namespace crux
