// How the control core presses on holds, pulls new grasps, tries them again and finds a hold again that it left.
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/control_core.hpp"

namespace crux {
namespace {

// Of a joint's effort: a pull loads no limb further.
constexpr double kMostTorque = 0.95;
// A gripper on its way down has stood so long: it does not come down.
constexpr double kBlocked_s = 0.3;
// Share of the fingers' opening from which on it is a finger that stands on something, not the hand.
constexpr double kFinger = 0.6;

}  // namespace

Contact ControlCore::contact(int limb, const LimbReference& reference) const noexcept {
  return {reference.friction, plan_->patch_k_m, std::min(plan_->max_normal_N, robot_.gripper.max_finger_force_N),
          limbs_[limb].grip_opening_m(reference)};
}

Contact ControlCore::known_contact(int limb, const LimbReference& reference) const noexcept {
  Contact known = contact(limb, reference);
  const double slipped_at = slips_[limb].slipped_at();
  if (slipped_at > 0.0) known.friction *= std::min(slipped_at, 1.0);
  return known;
}

double ControlCore::wanted_grasp_force_N(int limb, const LimbReference& reference,
                                         const Wrench& wrench_W) const noexcept {
  Contact trusted = contact(limb, reference);
  trusted.friction *= robot_.control.trusted_friction;
  return std::max(reference.squeeze_N,
                  required_grasp_force_N(wrench_W, reference.finger_axis_W(), trusted, robot_.control));
}

PerLimb<double> ControlCore::needs_N(const PlanReference& reference) const noexcept {
  PerLimb<double> needs_N{};
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference.limbs[l];
    if (limb.gripping() && !faults_.lost(l))
      needs_N[l] = needed_grasp_force_N(wrenches_W_[l], limb.finger_axis_W(), contact(l, limb), robot_.control);
  }
  return needs_N;
}

void ControlCore::begin_test(int limb) noexcept {
  if (test_.limb() >= 0) return;
  PerLimb<double> bearable_N = needs_N(reference_);
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& other = reference_.limbs[l];
    bearable_N[l] = std::max(
        bearable_N[l], testable_N(*plan_, clock_.now(), l, other.finger_axis_W(), contact(l, other), robot_.control));
  }
  const LimbReference& tested = reference_.limbs[limb];
  test_.begin(limb,
              test_load_W(*plan_, clock_.now(), limb, tested.finger_axis_W(), contact(limb, tested), robot_.control),
              bearable_N);
}

void ControlCore::test_grasps(const PlanReference& reference, double dt_s) noexcept {
  PerLimb<double> needs_N = this->needs_N(reference);
  for (int l = 0; l < kLimbs; ++l) {
    if (limbs_[l].torque_share() > kMostTorque) needs_N[l] = std::numeric_limits<double>::infinity();
  }
  for (int l = 0; l < kLimbs; ++l) {
    if (!reference.limbs[l].gripping() && !reference.limbs[l].closing()) test_.forget(l);
    if (test_.limb() == l) test_.advance(limbs_[l].gripper_W_m(body_.body_W()), stance_.slid_m(l), needs_N, dt_s);
    const bool climbs = supervisor_.state() == SupervisorState::kClimbing;
    // Beside a hold's edge there is nothing to grip: then it reaches to the other side.
    const bool misses = retry_.tried(l) && limbs_[l].finds_no_hold(reference.limbs[l], started_);
    if (climbs && (misses || test_.result(l) == GraspPull::Result::kFailed) && retry_.begin(l)) {
      test_.forget(l);
      limbs_[l].aim_beside(searches_[l].beside_W_m() + retry_.shift_W_m(reference.limbs[l]), reference.limbs[l]);
    }
  }
}

void ControlCore::press_holds(const PlanReference& reference, double dt_s) noexcept {
  if (plan_->point_feet) {
    for (int l = 0; l < kLimbs; ++l) limbs_[l].grasp(reference.limbs[l], 0.0, dt_s);
    return;
  }
  // The plan's squeeze, and at least what the load needs where the hold has less friction than it was planned with. The
  // grasp leads the load: it is strong enough for what comes within the lead time as well, and for what its sensor
  // feels beyond the plan. A sensor that fails leaves what it felt last.
  const PlanReference ahead = play(*plan_, later(*plan_, clock_.now(), robot_.control.grasp_force_lead_s));
  const PerLimb<Wrench> wrenches_ahead_W = balanced(bearers(ahead));
  const bool any_lost = faults_.any_lost();
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& now = reference.limbs[l];
    limbs_[l].hurry(any_lost);
    double force_N = 0.0;
    if (now.gripping() || now.closing()) force_N = wanted_grasp_force_N(l, now, wrenches_W_[l]);
    if (test_.limb() == l) force_N = wanted_grasp_force_N(l, now, test_.load_W());
    if (now.gripping() && (any_lost || rise_.rises() || slips_[l].squeezes())) force_N = contact(l, now).max_normal_N;
    if (now.gripping() && !faults_.distrusted(l))
      force_N = std::max(force_N, wanted_grasp_force_N(l, now, limbs_[l].wrench_W()));
    if (ahead.limbs[l].gripping()) {
      force_N = std::max(force_N, wanted_grasp_force_N(l, ahead.limbs[l], wrenches_ahead_W[l]));
    }
    limbs_[l].grasp(now, force_N, dt_s);
  }
}

void ControlCore::find_hold_again(int command, double dt_s) noexcept {
  if (supervisor_.state() != SupervisorState::kHolding || return_ == Return::kOver || plan_->point_feet) return;
  if (!faults_.any_lost()) return;
  // A gripper that comes down on its hold, closes or presses on it already goes on, and its limb takes up load.
  bool in_air = false, comes = false;
  for (int l = 0; l < kLimbs; ++l) {
    in_air = in_air || !(reference_.limbs[l].gripping() || faults_.lost(l));
    const bool near = reference_.limbs[l].closing() || reference_.limbs[l].phase == LimbPhase::kDescend;
    comes = comes || (near && !faults_.lost(l));
  }
  if (return_ == Return::kNone) {
    const bool on = comes && !clock_.now().back;
    const bool leads = on ? stance_s(*plan_, clock_.now().interval + 1) > 0.0 : clock_.can_reverse(*plan_);
    const bool can = in_air && retry_.limb() < 0 && leads;
    return_ = can ? Return::kOnItsWay : Return::kOver;
    if (!can) return;
    clock_.depart(*plan_, on ? Motion::kStep : Motion::kReverse);
    test_.reset();
    retry_.reset();
  }
  // On two grips the body may hang elsewhere than it seems: fingers that do not arrive close where they are.
  const bool late = clock_.waiting_for() == WaitingFor::kArrive && clock_.waited_s() > kBlocked_s;
  PerLimb<LimbEvents> events;
  for (int l = 0; l < kLimbs; ++l) {
    events[l] = limbs_[l].events(reference_.limbs[l], body_.body_W(), dt_s);
    events[l].gripped = events[l].gripped || faults_.lost(l);
    events[l].arrived = events[l].arrived || late;
  }
  clock_.advance(*plan_, events, dt_s, 1.0);
  const bool ends = clock_.arrived(*plan_) || clock_.waited_s() > robot_.supervisor.event_timeout_s;
  if (ends || command == crux_msgs::command_t::HOLD) return_ = Return::kOver;
}

void ControlCore::search_hold(int limb, const LimbReference& reference, LimbEvents& events, double dt_s) noexcept {
  HoldSearch& search = searches_[limb];
  if (reference.phase != LimbPhase::kDescend && !reference.closing()) return search.reset();
  const Vector3 missed_W_m = limbs_[limb].gripper_W_m(body_.body_W()) - limbs_[limb].anchor_W_m(reference);
  bool aims_anew = false;
  if (search.searches()) {
    aims_anew = search.advance(missed_W_m.norm(), dt_s);
  } else if (clock_.waiting_for() == WaitingFor::kArrive && clock_.waiting_limb() == limb &&
             clock_.waited_s() > kBlocked_s && limbs_[limb].runs_against() && !faults_.distrusted(limb)) {
    const Vector3 axis_W = reference.finger_axis_W();
    const Wrench& wrench_W = limbs_[limb].wrench_W();
    const double open_m = limbs_[limb].finger_opening_m(), at_m = pressed_along_m(wrench_W, axis_W);
    const bool finger = wrench_W.force_N.z() > robot_.control.contact_force_N && std::abs(at_m) > kFinger * open_m;
    const int k = clock_.now().interval;
    const LimbKnot& grasp = plan_->limbs[clock_.now().back ? std::max(k - 1, 0) : k + 1][limb];
    const double slack_m = open_m - grasp.finger_opening_m;
    const Vector3 shift_W_m = std::copysign(slack_m, at_m) * axis_W;
    aims_anew = finger && search.begin(missed_W_m.z(), shift_W_m, robot_.control.max_contact_offset_m);
    // A hand that stands on its hold comes no lower, whatever its encoders say.
    const bool hand = wrench_W.force_N.z() > robot_.control.contact_force_N && !finger && events.opened;
    events.arrived = events.arrived || (hand && missed_W_m.head<2>().norm() <= robot_.supervisor.arrive_tolerance_m);
  }
  if (aims_anew) limbs_[limb].aim_beside(search.beside_W_m(), reference);
  if (!search.searches() && !aims_anew) return;
  events.arrived = false;
  clock_.wait_anew();
}

void ControlCore::advance_clock(const PlanReference& reference, double dt_s) noexcept {
  PerLimb<LimbEvents> events;
  for (int l = 0; l < kLimbs; ++l) events[l] = limbs_[l].events(reference.limbs[l], body_.body_W(), dt_s);
  if (!started_) {
    settling_limb_ = -1;
    for (int l = 0; l < kLimbs && settling_limb_ < 0; ++l) {
      if (reference.limbs[l].gripping() && !events[l].gripped) settling_limb_ = l;
    }
    started_ = settling_limb_ < 0 && probe_.done() && engaged_time_s_ >= robot_.supervisor.settle_time_s;
    if (started_) stance_.forget_play();  // it does not show while nothing moves
    if (engaged_time_s_ >= robot_.supervisor.settle_time_s) settling_time_s_ += dt_s;
  }
  for (int l = 0; l < kLimbs && started_ && !plan_->point_feet; ++l) {
    const LimbReference& limb = reference.limbs[l];
    search_hold(l, limb, events[l], dt_s);
    if (retry_.limb() == l) {
      if (limb.phase == LimbPhase::kDescend && events[l].arrived) retry_.opened();
      events[l].gripped = false;
      clock_.wait_anew();
    }
    if (!limb.closing()) continue;
    if (events[l].gripped && test_.result(l) == GraspPull::Result::kNone) begin_test(l);
    events[l].gripped = test_.result(l) == GraspPull::Result::kPassed;
  }
  if (started_) clock_.advance(*plan_, events, dt_s, supervisor_.speed_scale());
  if (test_.limb() >= 0) clock_.wait_anew();  // a pull takes as long as its load is heavy, and ends by itself
}

}  // namespace crux
