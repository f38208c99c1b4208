// The way of a body that hangs lower than planned, as after a loss of power, back to its plan: slow, and no further
// than its limbs bear and reach.
#pragma once

#include "core/robot/geometry.hpp"

namespace crux {

class StandUp {
 public:
  /// A body stands up as long as no joint needs more of its torque than that. Loads are shared within a little less, so
  /// that a joint does not stop it where others could take over.
  static constexpr double kMostTorque = 0.95, kSharedTorque = 0.9;

  /// The body hangs at `body_W` where it should be at `reference_W`. Nothing to do where that is less than the slow
  /// correction of the body's pose makes good.
  void begin(const Pose& body_W, const Pose& reference_W) noexcept;

  /// Whether the limb follows, which is `missed_m` from where it should be: that is little, or no more than it was.
  bool follows(int limb, double missed_m) noexcept;

  /// Goes on by a period, `may` or not.
  void advance(bool may, double dt_s) noexcept;

  /// `reference_W`, moved by what is left of the way.
  Pose below(const Pose& reference_W) const noexcept;

  /// There is some of it left.
  bool rises() const noexcept { return left_ > 0.0; }
  double left_m() const noexcept { return left_ * offset_m_.norm(); }
  /// Since it went on last.
  double waited_s() const noexcept { return waited_s_; }

 private:
  double left_ = 0.0;  ///< share of the way
  Vector3 offset_m_ = Vector3::Zero();
  Vector3 turn_rad_ = Vector3::Zero();
  double speed_1_s_ = 0.0;
  double waited_s_ = 0.0;
  PerLimb<double> least_missed_m_;
};

}  // namespace crux
