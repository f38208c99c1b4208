// A gripper that has come down over its hold goes on until its fingers touch the wall, or its palm the hold, and back.
// How far the wall is from the body shows by nothing else: fingers grip at any height.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/robot/geometry.hpp"

namespace crux {

/// Where the gripper is, off the wall, as it touches [m]: by its fingers' ends, or by its palm on a hold so tall.
inline double touching_m(double hold_top_m, double pad_radius_m, double finger_height_m) noexcept {
  return std::max(pad_radius_m, hold_top_m - finger_height_m);
}

/// Of one limb, on its way to one hold.
class WallTouch {
 public:
  static constexpr double kBeyond_m = 0.025;  // below where it should touch, if nothing is there
  // So far ahead of the gripper it aims: it comes down as fast, and presses as hard, as that is far. What its sensor
  // alone feels it presses less, for joints that do not feel it do not give way.
  static constexpr double kAhead_m = 0.01, kFeltAhead_m = 0.0025;

  void reset() noexcept { *this = WallTouch(); }

  /// Fingers open, and then it goes down by `way_m` and further, until it touches.
  void begin(double way_m) noexcept {
    lowest_m_ = way_m + kBeyond_m;
    below_m_ = 0.0;
    enter(Step::kOpen);
  }

  /// What is seen of the gripper in a cycle.
  struct Seen {
    bool opened = false;   ///< its fingers
    bool felt = false;     ///< the wall, by its force/torque sensor
    bool borne = false;    ///< by its joints' torques, which are small where the limb is folded
    bool kept = false;     ///< by its joints' limits from where it is to be
    double above_m = 0.0;  ///< there
  };
  /// Once a cycle while it is busy. True where beside_W_m() changes.
  bool advance(const Seen& seen, double dt_s) noexcept {
    time_s_ += dt_s;
    const double height_m = seen.above_m - below_m_;
    const bool lower = height_m < lowest_height_m_ - kStill_m;
    lowest_height_m_ = lower ? height_m : lowest_height_m_;
    still_s_ = lower ? 0.0 : still_s_ + dt_s;
    felt_s_ = step_ == Step::kDown && seen.felt ? felt_s_ + dt_s : 0.0;
    // One sensor alone may be wrong: the joints bear it as well, or they go no further.
    touched_ = felt_s_ >= kTouch_s && (seen.borne || still_s_ >= kStill_s);
    const bool ends = seen.kept || time_s_ > kMost_s;
    const bool reached = std::abs(seen.above_m) < kReached_m;
    if (step_ == Step::kOpen && (seen.opened || ends)) return enter(seen.opened ? Step::kDown : Step::kOver);
    if (step_ == Step::kDown && (touched_ || ends || (reached && below_m_ >= lowest_m_))) return enter(Step::kUp);
    if (step_ == Step::kUp && (reached || time_s_ > kMost_s)) enter(Step::kOver);
    if (step_ != Step::kDown) return false;
    below_m_ = std::clamp((seen.felt && !seen.borne ? kFeltAhead_m : kAhead_m) - height_m, 0.0, lowest_m_);
    return true;
  }

  /// In the cycle of advance() in which it has touched for long enough: it stands there.
  bool touched() const noexcept { return touched_; }
  /// It feels something on its way down.
  bool presses() const noexcept { return felt_s_ > 0.0; }
  bool begun() const noexcept { return step_ != Step::kNone; }
  bool busy() const noexcept { return begun() && step_ != Step::kOver; }
  /// From where the limb was sent to where it is to be, in W.
  Vector3 beside_W_m() const noexcept { return step_ == Step::kDown ? Vector3(0.0, 0.0, -below_m_) : Vector3::Zero(); }

 private:
  enum class Step : std::uint8_t { kNone, kOpen, kDown, kUp, kOver };
  static constexpr double kReached_m = 0.004;
  static constexpr double kStill_m = 0.0005, kStill_s = 0.2;
  static constexpr double kTouch_s = 0.1;
  static constexpr double kMost_s = 3.0;  // of a step

  bool enter(Step step) noexcept {
    step_ = step;
    time_s_ = felt_s_ = still_s_ = 0.0;
    lowest_height_m_ = std::numeric_limits<double>::infinity();
    return step_ != Step::kOver;
  }

  Step step_ = Step::kNone;
  double below_m_ = 0.0, lowest_m_ = 0.0;  ///< where it was sent it aims, and the most
  double time_s_ = 0.0, felt_s_ = 0.0, still_s_ = 0.0;
  bool touched_ = false;
  double lowest_height_m_ = std::numeric_limits<double>::infinity();  ///< of the gripper, in this step
};

}  // namespace crux
