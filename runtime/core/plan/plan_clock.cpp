#include "core/plan/plan_clock.hpp"

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

// From a standstill to full speed, and back: a body that starts or stops at once pushes on its limbs.
constexpr double kStart_s = 0.2;

}  // namespace

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

void PlanClock::stop_at(double elapsed_s, double dt_s, double pace) noexcept {
  now_.elapsed_s = elapsed_s;
  waited_s_ += dt_s;
  pace_ = pace;
}

PlanTime PlanClock::next_stance(const PreparedPlan& plan) const noexcept {
  for (int k = now_.interval; k < plan.intervals(); ++k) {
    const double at_s = stance_s(plan, k);
    if (at_s >= 0.0 && (k > now_.interval || at_s > now_.elapsed_s)) return {k, at_s};
  }
  return {-1, 0.0};
}

PlanTime PlanClock::last_stance(const PreparedPlan& plan) const noexcept {
  for (int k = std::min(now_.interval, verified_.interval); k >= 0; --k) {
    const double at_s = stance_s(plan, k);
    if (at_s >= 0.0 && (k < now_.interval || at_s < now_.elapsed_s)) return {k, at_s, true};
  }
  return {-1, 0.0};
}

void PlanClock::depart(const PreparedPlan& plan, Motion motion) noexcept {
  stop_ = motion == Motion::kReverse ? last_stance(plan) : motion == Motion::kStep ? next_stance(plan) : PlanTime{-1};
  now_.back = motion == Motion::kReverse;
  arrived_ = false;
  waiting_for_ = WaitingFor::kNothing;
  waiting_limb_ = -1;
  waited_s_ = 0.0;
  pace_ = 0.0;
}

/// To where the motion ends; more than kStart_s is not told exactly.
double PlanClock::left_s(const PreparedPlan& plan) const noexcept {
  const int last = now_.back ? 0 : plan.intervals() - 1;
  const int end = stops() ? stop_.interval : last;
  const double end_s = stops() ? stop_.elapsed_s : now_.back ? 0.0 : plan.step_s[last];
  double left_s = now_.back ? now_.elapsed_s - end_s : end_s - now_.elapsed_s;
  for (int k = now_.interval; k != end && left_s < kStart_s; k += now_.back ? -1 : 1) {
    left_s += plan.step_s[now_.back ? k - 1 : k];
  }
  return left_s;
}

/// A stance counts as verified when all limbs bear and all of them grip.
void PlanClock::verify(const PreparedPlan& plan, const PerLimb<LimbEvents>& events) noexcept {
  const double at_s = stance_s(plan, now_.interval);
  if (at_s < 0.0 || now_.elapsed_s < at_s || now_.elapsed_s > kUnloadBegin * plan.step_s[now_.interval]) return;
  if (std::ranges::all_of(events, &LimbEvents::gripped)) verified_ = {now_.interval, at_s};
}

/// Into the interval before or behind; where the motion ends in it the clock begins at its edge, so that it does not
/// pass a stop that stands there.
void PlanClock::cross_knot(const PreparedPlan& plan) noexcept {
  const int next = now_.interval + (now_.back ? -1 : 1);
  const double length_s = plan.step_s[now_.interval];
  if (next < 0 || next == plan.intervals()) {
    now_.elapsed_s = now_.back ? 0.0 : length_s;
    return;
  }
  const double edge_s = now_.back ? plan.step_s[next] : 0.0;
  const double rest_s = now_.back ? now_.elapsed_s : now_.elapsed_s - length_s;
  now_ = {next, next == stop_.interval ? edge_s : edge_s + rest_s, now_.back};
}

void PlanClock::advance(const PreparedPlan& plan, const PerLimb<LimbEvents>& events, double dt_s,
                        double scale) noexcept {
  verify(plan, events);
  if (arrived(plan)) return;
  const int k = now_.interval;
  const bool back = now_.back;
  const double length_s = plan.step_s[k];
  // In reverse a limb leaves the hold it took, and comes to the one that it left.
  const auto leaves = [&](int l) { return back ? plan.takes_hold(k + 1, l) : plan.lets_go(k, l); };
  const auto comes = [&](int l) { return back ? plan.lets_go(k, l) : plan.takes_hold(k + 1, l); };
  const auto leaves_next = [&](int l) { return back ? plan.takes_hold(k, l) : plan.lets_go(k + 1, l); };
  const double leave_s = (back ? plan.swing.close : plan.swing.lift) * length_s;
  const double arrive_s = (back ? plan.swing.lift : plan.swing.close) * length_s;
  const double edge_s = back ? 0.0 : length_s;
  const double sign = back ? -1.0 : 1.0;
  pace_ = std::min(pace_ + dt_s / kStart_s, 1.0);
  const auto brakes = [&](double left_s) {
    pace_ = std::clamp(std::sqrt(2.0 * std::abs(left_s) / kStart_s), dt_s / kStart_s, pace_);
  };
  brakes(left_s(plan));
  for (int l = 0; l < kLimbs; ++l) {
    if (comes(l) && !events[l].gripped) brakes(edge_s - now_.elapsed_s);
    if (leaves(l) && !events[l].opened && sign * (leave_s - now_.elapsed_s) >= 0.0) brakes(leave_s - now_.elapsed_s);
  }
  const double to_s = now_.elapsed_s + sign * pace_ * scale * dt_s;
  const auto ahead = [&](double at_s) { return sign * (at_s - now_.elapsed_s) >= 0.0; };
  // A gate stands where the clock is about to pass it.
  const auto passes = [&](double at_s) { return ahead(at_s) && sign * (to_s - at_s) > 0.0; };

  if (stop_.interval == k && ahead(stop_.elapsed_s) && sign * (to_s - stop_.elapsed_s) >= 0.0) {
    if (!all_seen(WaitingFor::kGrip, &LimbEvents::gripped, events, [](int) { return true; })) {
      return stop_at(stop_.elapsed_s, dt_s);
    }
    now_.elapsed_s = stop_.elapsed_s;
    verified_ = {stop_.interval, stop_.elapsed_s};
    arrived_ = true;
  } else {
    if (passes(leave_s) && !all_seen(WaitingFor::kOpen, &LimbEvents::opened, events, leaves)) {
      return stop_at(leave_s, dt_s);
    }
    // What a gripper comes down on, or runs against on its way, is pressed no further by the clock.
    const auto blocked = [&](int l) { return events[l].blocked && (!comes(l) || ahead(arrive_s)); };
    if (!all_seen(WaitingFor::kArrive, &LimbEvents::arrived, events, blocked)) {
      // A gentle start would only brush what is in the way, and the load never tell.
      return stop_at(now_.elapsed_s, dt_s, pace_);
    }
    if (passes(arrive_s) && !all_seen(WaitingFor::kArrive, &LimbEvents::arrived, events, comes)) {
      return stop_at(arrive_s, dt_s);
    }
    if (passes(edge_s) && !(all_seen(WaitingFor::kGrip, &LimbEvents::gripped, events, comes) &&
                            all_seen(WaitingFor::kUnload, &LimbEvents::unloaded, events, leaves_next))) {
      return stop_at(edge_s, dt_s);
    }
    now_.elapsed_s = to_s;
    if (sign * (to_s - edge_s) > 0.0) cross_knot(plan);
  }
  waiting_for_ = WaitingFor::kNothing;
  waiting_limb_ = -1;
  waited_s_ = 0.0;
}

}  // namespace crux
