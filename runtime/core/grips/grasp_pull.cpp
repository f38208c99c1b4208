#include "core/grips/grasp_pull.hpp"

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

constexpr double kFailedEasing = 10.0;  // times quicker: a grasp that slides does not bear its load anyway

/// The heaviest load of a grip that lasts on, from `at` on in steps of `step` intervals, and the grasp force it needs.
struct Heaviest {
  double need_N = 0.0;
  Wrench wrench_W;
};

Heaviest heaviest(const PreparedPlan& plan, const PlanTime& at, int step, int limb, const Vector3& finger_axis_W,
                  const Contact& contact, const ControlParameters& control) noexcept {
  Heaviest heaviest{control.grasp_force_reserve_N, {}};
  for (int k = at.interval + step; k >= 0 && k <= plan.intervals() && !plan.limbs[k][limb].air; k += step) {
    const Wrench& wrench_W = plan.limbs[k][limb].wrench_W;
    const double need_N = needed_grasp_force_N(wrench_W, finger_axis_W, contact, control);
    if (need_N > heaviest.need_N) heaviest = {need_N, wrench_W};
  }
  return heaviest;
}

}  // namespace

Wrench test_load_W(const PreparedPlan& plan, const PlanTime& at, int limb, const Vector3& finger_axis_W,
                   const Contact& contact, const RobotDescription& robot) noexcept {
  const ControlParameters& control = robot.control;
  const double reserve_N = control.grasp_force_reserve_N;
  const Heaviest load = heaviest(plan, at, at.back ? -1 : 1, limb, finger_axis_W, contact, control);
  const double room = (contact.max_normal_N - reserve_N) / std::max(load.need_N - reserve_N, 1e-9);
  return load.wrench_W * std::min(robot.grasp_test.load_factor, room);
}

double testable_N(const PreparedPlan& plan, const PlanTime& at, int limb, const Vector3& finger_axis_W,
                  const Contact& contact, const RobotDescription& robot) noexcept {
  const ControlParameters& control = robot.control;
  const double before_N = heaviest(plan, at, -1, limb, finger_axis_W, contact, control).need_N;
  const double after_N = heaviest(plan, at, 1, limb, finger_axis_W, contact, control).need_N;
  return std::min(robot.grasp_test.load_factor * std::max(before_N, after_N), contact.max_normal_N);
}

void GraspPull::begin(int limb, const Wrench& load_W, const PerLimb<double>& bearable_N) noexcept {
  if (limb_ >= 0) return;
  limb_ = limb;
  load_W_ = load_W;
  bearable_N_ = bearable_N;
  time_s_ = share_ = gave_way_m_ = 0.0;
  standing_ = easing_ = failed_ = false;
}

bool GraspPull::others_within(const PerLimb<double>& needs_N, const PerLimb<double>& most_N) const noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    if (l != limb_ && needs_N[l] > most_N[l]) return false;
  }
  return true;
}

void GraspPull::load_more(double step, const Seen& seen, const GraspTestParameters& test) noexcept {
  const double next = std::min(share_ + step, 1.0);
  const bool all_bear = std::isfinite(seen.needs_N[limb_]) && others_within(seen.needs_N, bearable_N_);
  if (all_bear && (smoothstep(next) <= seen.pressed || time_s_ >= test.press_s)) share_ = next;
  standing_ = !all_bear || share_ == 1.0;
  loaded_slid_m_ = seen.slid_m;
  if (standing_) time_s_ = 0.0;
}

void GraspPull::advance(const Seen& seen, const GraspTestParameters& test, double dt_s) noexcept {
  if (limb_ < 0) return;
  const double rate_N_s =
      others_within(seen.needs_N, seen.borne_N) ? test.rate_N_s : std::min(test.new_rate_N_s, test.rate_N_s);
  const double step = dt_s / std::max(load_W_.force_N.norm() / rate_N_s, test.min_ramp_s);
  time_s_ += dt_s;
  if (easing_) {
    share_ = std::max(share_ - (failed_ ? kFailedEasing : 1.0) * step, 0.0);
    if (share_ > 0.0) return;
    if (failed_) result_[limb_] = Result::kFailed;
    limb_ = -1;
    return;
  }
  if (share_ == 0.0) unloaded_W_m_ = seen.gripper_W_m;
  if (!standing_) load_more(step, seen, test);
  const double way_m = (seen.gripper_W_m - unloaded_W_m_).norm();
  const bool comes_off = way_m > kMaxWay_m;
  gave_way_m_ = comes_off ? way_m : seen.slid_m - (standing_ ? loaded_slid_m_ : 0.0);
  limit_m_ = comes_off ? kMaxWay_m : (standing_ ? kMaxCreep_m : kMaxSlide_m);
  failed_ = gave_way_m_ > limit_m_;
  easing_ = failed_ || (standing_ && time_s_ >= test.stand_s);
  // The plan goes on while a pull that was passed is let off.
  if (easing_ && !failed_) result_[limb_] = Result::kPassed;
}

}  // namespace crux
