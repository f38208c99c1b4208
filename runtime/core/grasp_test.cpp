#include "core/grasp_test.hpp"

#include <algorithm>

namespace crux {
namespace {

constexpr double kPress_s = 0.3;    // for the fingers to press as the full load needs
constexpr double kRate_N_s = 30.0;  // of the pull: slow enough for the other limbs to give way to
constexpr double kLeastRamp_s = 0.2;
constexpr double kStand_s = 0.3;

}  // namespace

void GraspTest::begin(int limb, const Wrench& load_W) noexcept {
  if (limb_ >= 0) return;
  limb_ = limb;
  load_W_ = load_W;
  time_s_ = share_ = gave_way_m_ = 0.0;
  easing_ = failed_ = false;
}

void GraspTest::advance(const Vector3& gripper_W_m, double dt_s) noexcept {
  if (limb_ < 0) return;
  const double step = dt_s / std::max(load_W_.force_N.norm() / kRate_N_s, kLeastRamp_s);
  time_s_ += dt_s;
  if (easing_) {
    share_ = std::max(share_ - step, 0.0);
    if (share_ > 0.0) return;
    result_[limb_] = failed_ ? Result::kFailed : Result::kPassed;
    limb_ = -1;
  } else if (share_ == 0.0 && time_s_ < kPress_s) {
    unloaded_W_m_ = gripper_W_m;
  } else if (share_ < 1.0) {
    share_ = std::min(share_ + step, 1.0);
    loaded_W_m_ = gripper_W_m;
    time_s_ = 0.0;
    gave_way_m_ = (gripper_W_m - unloaded_W_m_).norm();
    easing_ = failed_ = gave_way_m_ > kMaxWay_m;
  } else {
    gave_way_m_ = (gripper_W_m - loaded_W_m_).norm();
    failed_ = gave_way_m_ > kMaxCreep_m;
    easing_ = failed_ || time_s_ >= kStand_s;
  }
}

}  // namespace crux
