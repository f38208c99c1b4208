// The body's pose from the limbs that stand: the rigid motion that best lays the grippers, seen from the body by
// forward kinematics, as they hold the wall. The robot has no inertial unit.
#pragma once

#include "core/robot/geometry.hpp"

namespace crux {

class BodyEstimator {
 public:
  void reset(const Pose& body_W) { body_W_ = body_W; }

  /// Minimises Σ wᵢ (|R·bᵢ + r − aᵢ|² + λᵢ² |log(Aᵢ·(R·Bᵢ)ᵀ)|²) by damped Gauss-Newton steps from the last estimate.
  /// `anchor_W`: (Aᵢ, aᵢ), how the grippers hold; `gripper_B`: (Bᵢ, bᵢ); `weight`: wᵢ >= 0, zero for a limb in the air;
  /// `lever_m`: λᵢ, on which a turn of the gripper counts as much as a shift, zero where it says nothing.
  /// Places tell all of the pose where three grippers or more are not on one line. Of a turn about the line through
  /// them only the grippers' own turns tell; where they say nothing either, it stays as it was.
  const Pose& update(const PerLimb<Pose>& anchor_W, const PerLimb<Pose>& gripper_B, const PerLimb<double>& weight,
                     const PerLimb<double>& lever_m, int iterations = kIterationsPerCycle) noexcept;

  const Pose& body_W() const { return body_W_; }

  static constexpr int kIterationsPerCycle = 3;

 private:
  Pose body_W_;
};

/// The slow correction of the commanded body pose: an integral of what the estimate is off its reference, clamped.
class BodyCorrection {
 public:
  BodyCorrection(double gain_1_s, double max_offset_m, double max_rotation_rad)
      : gain_1_s_(gain_1_s), max_offset_m_(max_offset_m), max_rotation_rad_(max_rotation_rad) {}

  /// The correction with which the command is `command_W` when the reference is `reference_W`.
  void reset(const Pose& command_W, const Pose& reference_W) noexcept;

  /// The command as it was last, of the reference it was made from.
  Pose command_W(const Pose& reference_W) const noexcept;

  /// The command is `command_W` although the reference is another; the way made stays.
  void rebase(const Pose& command_W, const Pose& reference_W) noexcept;

  /// The command moves along with the world it is counted in.
  void relocate(const Pose& motion, const Pose& reference_W) noexcept;

  /// Moves the reference by at most kMaxWay_m towards what limbs at their joints' limits cannot reach: `missed_W_m`
  /// points from where their grippers come to where they should be. It comes back slowly.
  void make_way(const Vector3& missed_W_m, double dt_s) noexcept;

  /// Integrates one period and returns the commanded body pose, W <- B.
  Pose update(const Pose& reference_W, const Pose& estimate_W, double dt_s) noexcept;

  static constexpr double kMaxWay_m = 0.03;

 private:
  double gain_1_s_;
  double max_offset_m_;
  double max_rotation_rad_;
  Vector3 offset_m_ = Vector3::Zero();
  Vector3 rotation_rad_ = Vector3::Zero();
  Vector3 way_m_ = Vector3::Zero();  ///< of the reference
};

}  // namespace crux
