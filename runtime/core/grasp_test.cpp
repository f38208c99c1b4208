#include "core/grasp_test.hpp"

#include <algorithm>

namespace crux {
namespace {

constexpr double kLoadFactor = 1.2;
constexpr double kPress_s = 0.3;    // for the fingers to press as the full load needs
constexpr double kRate_N_s = 30.0;  // of the pull: slow enough for the other limbs to give way to
constexpr double kLeastRamp_s = 0.2;
constexpr double kStand_s = 0.3;

}  // namespace

Wrench test_load_W(const PreparedPlan& plan, const PlanTime& at, int limb, const Vector3& finger_axis_W,
                   const Contact& contact, const ControlParameters& control) noexcept {
  const double reserve_N = control.grasp_force_reserve_N;
  Wrench heaviest_W;
  double most_N = reserve_N;
  const int step = at.back ? -1 : 1;
  for (int k = at.interval + step; k >= 0 && k <= plan.intervals() && !plan.limbs[k][limb].air; k += step) {
    const Wrench& wrench_W = plan.limbs[k][limb].wrench_W;
    const double needed_N = needed_grasp_force_N(wrench_W, finger_axis_W, contact, control);
    if (needed_N > most_N) most_N = needed_N, heaviest_W = wrench_W;
  }
  const double room = (contact.max_normal_N - reserve_N) / std::max(most_N - reserve_N, 1e-9);
  return heaviest_W * std::min(kLoadFactor, room);
}

void GraspTest::begin(int limb, const Wrench& load_W) noexcept {
  if (limb_ >= 0) return;
  limb_ = limb;
  load_W_ = load_W;
  time_s_ = share_ = gave_way_m_ = 0.0;
  easing_ = failed_ = false;
}

void GraspTest::advance(const Vector3& gripper_W_m, double slid_m, double dt_s) noexcept {
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
    const double way_m = (gripper_W_m - unloaded_W_m_).norm();
    gave_way_m_ = way_m > kMaxWay_m ? way_m : slid_m;
    limit_m_ = way_m > kMaxWay_m ? kMaxWay_m : kMaxSlide_m;
    easing_ = failed_ = gave_way_m_ > limit_m_;
  } else {
    gave_way_m_ = (gripper_W_m - loaded_W_m_).norm();
    limit_m_ = kMaxCreep_m;
    failed_ = gave_way_m_ > limit_m_;
    easing_ = failed_ || time_s_ >= kStand_s;
  }
}

}  // namespace crux
