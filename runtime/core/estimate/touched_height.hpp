// How high a gripper that has touched the wall really grips. While its limb is in the air the others bear more, and
// their joints lie on other sides of their play: what the touch shows is off by that as well. The grip stays where it
// is when its limb takes up load, so the estimate is set against it then, in the stance that the other grips were found
// in.
#pragma once

#include <optional>

namespace crux {

/// Of one limb, on its way to one hold.
class TouchedHeight {
 public:
  /// The gripper touched, and is `high_m` higher by the estimate than that makes it.
  void touch(double high_m) noexcept { high_m_ = high_m; }
  /// Its fingers press on the hold at `height_m` by the estimate. The first cycle counts.
  void press(double height_m) noexcept {
    if (high_m_ && !grips_m_) grips_m_ = height_m - *high_m_;
  }
  /// They have let go again.
  void open() noexcept { grips_m_.reset(); }
  /// The limb bears, with its gripper at `height_m` by the estimate: how much higher that is than where it grips. Once.
  std::optional<double> found(double height_m) noexcept {
    const std::optional<double> grips_m = grips_m_;
    *this = {};
    return grips_m ? std::optional(height_m - *grips_m) : std::nullopt;
  }

 private:
  std::optional<double> high_m_, grips_m_;
};

}  // namespace crux
