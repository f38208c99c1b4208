// A finger that comes down on its hold instead of beside it shows on which side the hold is: the gripper goes up again,
// over to that side, and down.
#pragma once

#include <cstdint>

#include "core/robot/geometry.hpp"

namespace crux {

/// Where along `axis_W`, seen from the gripper, what presses it off its hold, along `off_W`, does so [m].
inline double pressed_along_m(const Wrench& wrench_W, const Vector3& axis_W, const Vector3& off_W) noexcept {
  return -wrench_W.moment_Nm.dot(off_W.cross(axis_W)) / wrench_W.force_N.dot(off_W);
}

/// Of one limb, on its way to one hold.
class HoldSearch {
 public:
  static constexpr int kTries = 2;
  static constexpr double kClear_m = 0.010;  // above what the finger stands on

  void reset() noexcept { *this = HoldSearch(); }

  /// The gripper stands `above_m` over where it is to be, along `off_W`: it goes up, and over by `shift_W_m`, as far as
  /// `most_m` from where it was sent. False where it has been there.
  bool begin(double above_m, const Vector3& off_W, const Vector3& shift_W_m, double most_m) noexcept {
    const Vector3 next_W_m = clamped_norm(beside_W_m_ + shift_W_m, most_m);
    if (tries_ == kTries || (next_W_m - beside_W_m_).norm() < kReached_m) return false;
    ++tries_;
    next_W_m_ = next_W_m;
    up_W_m_ = (above_m + kClear_m) * off_W;
    beside_W_m_ += up_W_m_ - beside_W_m_.dot(off_W) * off_W;
    enter(Step::kUp);
    return true;
  }

  /// Once a cycle while it searches; the gripper is `distance_m` from where it is to be. True where that changes.
  bool advance(double distance_m, double dt_s) noexcept {
    time_s_ += dt_s;
    if (distance_m > kReached_m && time_s_ < kMost_s) return false;
    beside_W_m_ = next_W_m_ + (step_ == Step::kUp ? up_W_m_ : Vector3::Zero());
    enter(step_ == Step::kUp ? Step::kOver : Step::kNone);
    return true;
  }

  /// The hand stands on the hold, and comes no lower, whatever its encoders say.
  void stand() noexcept { stands_ = true; }
  bool stands() const { return stands_; }

  bool begun() const { return tries_ > 0; }
  bool searches() const { return step_ != Step::kNone; }  ///< and has not come down yet
  /// From where the limb was sent to where it is to be, in W.
  const Vector3& beside_W_m() const { return beside_W_m_; }

 private:
  enum class Step : std::uint8_t { kNone, kUp, kOver };
  static constexpr double kReached_m = 0.004;
  static constexpr double kMost_s = 2.0;  // of a step

  void enter(Step step) noexcept {
    step_ = step;
    time_s_ = 0.0;
  }

  Step step_ = Step::kNone;
  bool stands_ = false;
  int tries_ = 0;
  double time_s_ = 0.0;
  Vector3 beside_W_m_ = Vector3::Zero();
  Vector3 next_W_m_ = Vector3::Zero();
  Vector3 up_W_m_ = Vector3::Zero();
};

}  // namespace crux
