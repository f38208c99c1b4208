#include "core/plan_clock.hpp"

namespace crux {

template <class Concerns>
bool PlanClock::all_seen(WaitingFor what, bool LimbEvents::* wanted, const PerLimb<LimbEvents>& events,
                         Concerns concerns) noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    if (!concerns(l) || events[l].*wanted) continue;
    waiting_for_ = what;
    waiting_limb_ = l;
    return false;
  }
  return true;
}

void PlanClock::stop_at(double elapsed_s, double dt_s) noexcept {
  now_.elapsed_s = elapsed_s;
  waited_s_ += dt_s;
}

void PlanClock::advance(const PreparedPlan& plan, const PerLimb<LimbEvents>& events, double dt_s) noexcept {
  if (complete(plan)) return;
  const int k = now_.interval;
  const auto lets_go = [&](int l) { return plan.lets_go(k, l); };
  const auto takes_hold_next = [&](int l) { return plan.takes_hold(k + 1, l); };
  const auto lets_go_next = [&](int l) { return plan.lets_go(k + 1, l); };
  const double target_s = now_.elapsed_s + dt_s;
  // A gate stands where the clock is about to pass it.
  const auto passes = [&](double share) { return now_.elapsed_s <= share * plan.dt_s && target_s > share * plan.dt_s; };

  if (passes(kLiftShare) && !all_seen(WaitingFor::kOpen, &LimbEvents::opened, events, lets_go)) {
    return stop_at(kLiftShare * plan.dt_s, dt_s);
  }
  if (passes(kCloseShare) && !all_seen(WaitingFor::kArrive, &LimbEvents::arrived, events, takes_hold_next)) {
    return stop_at(kCloseShare * plan.dt_s, dt_s);
  }
  if (passes(1.0) && !(all_seen(WaitingFor::kGrip, &LimbEvents::gripped, events, takes_hold_next) &&
                       all_seen(WaitingFor::kUnload, &LimbEvents::unloaded, events, lets_go_next))) {
    return stop_at(plan.dt_s, dt_s);
  }

  waiting_for_ = WaitingFor::kNothing;
  waiting_limb_ = -1;
  waited_s_ = 0.0;
  now_.elapsed_s = target_s;
  if (target_s <= plan.dt_s) return;
  if (k + 1 == plan.intervals()) {
    now_.elapsed_s = plan.dt_s;
  } else {
    now_ = {k + 1, target_s - plan.dt_s};
  }
}

}  // namespace crux
