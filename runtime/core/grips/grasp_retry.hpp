// A grasp that gives way when it is pulled is opened, shifted along the hold's faces and closed again.
#pragma once

#include <Eigen/Geometry>

#include "core/plan/reference_player.hpp"

namespace crux {

class GraspRetry {
 public:
  static constexpr int kTries = 2;  // to one side of the first place, then to the other
  static constexpr double kShift_m = 0.006;

  void reset() noexcept { *this = GraspRetry(); }

  /// Begins another try of `limb`; false where it has had all of them.
  bool begin(int limb) noexcept {
    if (tries_[limb] == kTries) return false;
    ++tries_[limb];
    limb_ = limb;
    return true;
  }
  void opened() noexcept { limb_ = -1; }

  bool tried(int limb) const { return tries_[limb] > 0; }  ///< beside its first place already
  int limb() const { return limb_; }                       ///< that opens for another try; -1: none
  /// From where the limb grips as planned to where it tries next, in W.
  Vector3 shift_W_m(const LimbReference& reference) const noexcept {
    return (tries_[limb_] % 2 == 0 ? -kShift_m : kShift_m) * reference.gripper_rotation_W().col(1);
  }

  /// Keeps the fingers of limb() open, as they are on their way to the hold.
  void apply(PlanReference& reference) noexcept {
    for (int l = 0; l < kLimbs; ++l) {
      LimbReference& limb = reference.limbs[l];
      if (limb.phase == LimbPhase::kSwing) tries_[l] = 0;
      if (l != limb_) continue;
      limb.phase = LimbPhase::kDescend;
      limb.finger_opening_m = limb.open_m;
    }
  }

 private:
  int limb_ = -1;
  PerLimb<int> tries_{};
};

}  // namespace crux
