#include "core/grips/squeeze.hpp"

#include <algorithm>

#include "core/grips/shares.hpp"

namespace crux {
namespace {

double wanted_N(const CycleView& now, int limb, const LimbReference& reference, const Wrench& wrench_W) noexcept {
  const ControlParameters& control = now.robot.control;
  Contact trusted = contact(now, limb, reference);
  trusted.friction *= control.trusted_friction;
  return std::max(reference.squeeze_N, required_grasp_force_N(wrench_W, reference.finger_axis_W(), trusted, control));
}

}  // namespace

void press_holds(const CycleView& now, const Grips& grips, const PlanTime& at, PerLimb<LimbController>& limbs,
                 bool rises, double dt_s) noexcept {
  if (now.plan->point_feet) {
    for (int l = 0; l < kLimbs; ++l) limbs[l].fingers().grasp(now.reference.limbs[l], 0.0, dt_s);
    return;
  }
  const PlanReference ahead = play(*now.plan, later(*now.plan, at, now.robot.control.grasp_force_lead_s));
  const PerLimb<Wrench> wrenches_ahead_W = balanced(now, grips.bearers(now, ahead));
  const bool any_lost = now.health.any_hold_lost();
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& reference = now.reference.limbs[l];
    const GraspPull& pull = grips.pull();
    if (reference.on_foothold) {
      limbs[l].fingers().grasp(reference, 0.0, dt_s);
      continue;
    }
    limbs[l].fingers().hurry(any_lost);
    double force_N = 0.0;
    if (reference.gripping() || reference.closing()) force_N = wanted_N(now, l, reference, now.wrenches_W[l]);
    if (pull.limb() == l) force_N = wanted_N(now, l, reference, pull.load_W());
    if (reference.gripping() && (any_lost || rises || grips.slip(l).squeezes()))
      force_N = contact(now, l, reference).max_normal_N;
    if (reference.gripping() && !now.health.force_torque_distrusted[l])
      force_N = std::max(force_N, wanted_N(now, l, reference, limbs[l].wrench_W()));
    if (ahead.limbs[l].gripping() && !ahead.limbs[l].on_foothold)
      force_N = std::max(force_N, wanted_N(now, l, ahead.limbs[l], wrenches_ahead_W[l]));
    limbs[l].fingers().grasp(reference, force_N, dt_s);
  }
}

}  // namespace crux
