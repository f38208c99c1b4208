// What Grips does where a grasp is made: it pulls it, tries it again beside its place, and finds holds again.
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/grips/grips.hpp"

namespace crux {
namespace {

// Of a joint's effort: a pull loads no limb further.
constexpr double kMostTorque = 0.95;
// A gripper on its way down has stood so long: it does not come down; a finger leans on its hold.
constexpr double kBlocked_s = 0.3, kLeans_s = 1.0;
// Share of the fingers' opening from which on it is a finger that stands on something, not the hand.
constexpr double kFinger = 0.6;
// A finger that rubs on the hold it leaves opens so much further.
constexpr double kFurther_m = 0.01;
// Between fingers that touch the wall and what else stands there.
constexpr double kAside_m = 0.01;
// Of the force by which a gripper feels the wall: so much is left where it still does.
constexpr double kStaysFelt = 0.4;
// By its joints' limits a gripper is kept from where it is to be.
constexpr double kKept_m = 0.002;

/// Grasp force that each limb's share of the load needs.
PerLimb<double> needs_N(const CycleView& now) noexcept {
  PerLimb<double> needs_N{};
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = now.reference.limbs[l];
    if (limb.gripping() && !limb.on_foothold && !now.health.hold_lost[l])
      needs_N[l] =
          needed_grasp_force_N(now.wrenches_W[l], limb.finger_axis_W(), contact(now, l, limb), now.robot.control);
  }
  return needs_N;
}

}  // namespace

/// By sensor and by command: no grasp is loaded on the word of one of them.
double Grips::pressed_share(const CycleView& now, int limb) const noexcept {
  const LimbReference& reference = now.reference.limbs[limb];
  const Fingers& fingers = now.limbs[limb].fingers();
  const double reserve_N = now.robot.control.grasp_force_reserve_N;
  const double needed_N =
      needed_grasp_force_N(pull_.load_W(), reference.finger_axis_W(), contact(now, limb, reference), now.robot.control);
  const double presses_N = std::min(fingers.force_N(), fingers.expected_force_N());
  return (presses_N - reserve_N) / std::max(needed_N - reserve_N, 1e-9);
}

void Grips::begin_pull(const CycleView& now, const PlanTime& at, int limb) noexcept {
  if (pull_.limb() >= 0) return;
  PerLimb<double> bearable_N = needs_N(now);
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& other = now.reference.limbs[l];
    if (other.on_foothold) continue;
    bearable_N[l] =
        std::max(bearable_N[l], testable_N(*now.plan, at, l, other.finger_axis_W(), contact(now, l, other), now.robot));
  }
  const LimbReference& pulled = now.reference.limbs[limb];
  pull_.begin(limb, test_load_W(*now.plan, at, limb, pulled.finger_axis_W(), contact(now, limb, pulled), now.robot),
              bearable_N);
}

void Grips::pull_new_grasps(const CycleView& now, PerLimb<LimbController>& limbs, bool climbs, double dt_s) noexcept {
  PerLimb<double> needs_N = crux::needs_N(now);
  for (int l = 0; l < kLimbs; ++l) {
    if (limbs[l].torque_share() > kMostTorque) needs_N[l] = std::numeric_limits<double>::infinity();
  }
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& reference = now.reference.limbs[l];
    if (!reference.gripping() && !reference.closing()) pull_.forget(l);
    if (pull_.limb() == l) {
      pull_.advance({limbs[l].gripper_W_m(now.body_W), stance_.slid_m(l), pressed_share(now, l), needs_N, borne_N_},
                    now.robot.grasp_test, dt_s);
    }
    // Beside a hold's edge there is nothing to grip: then it reaches to the other side.
    const bool misses = retry_.tried(l) && limbs[l].fingers().finds_no_hold(reference, now.started);
    if (!climbs && touches_[l].busy()) {
      touches_[l].reset();
      limbs[l].aim_beside(searches_[l].beside_W_m(), reference);
    }
    if (climbs && (misses || pull_.result(l) == GraspPull::Result::kFailed) && retry_.begin(l)) {
      pull_.forget(l);
      limbs[l].aim_beside(searches_[l].beside_W_m() + retry_.shift_W_m(reference), reference);
    }
  }
}

void Grips::judge(const CycleView& now, PlanClock& clock, PerLimb<LimbController>& limbs, bool unsure,
                  PerLimb<LimbEvents>& events, double dt_s) noexcept {
  touched_ = {};
  if (now.plan->point_feet) return;
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& reference = now.reference.limbs[l];
    search_hold(now, clock, limbs[l], l, events[l], dt_s);
    touch_wall(now, clock, limbs[l], l, unsure, events[l], dt_s);
    rubs_[l] = reference.phase == LimbPhase::kLift && (rubs_[l] || events[l].blocked);
    if (retry_.limb() == l) {
      Fingers& fingers = limbs[l].fingers();
      const bool opened = fingers.stands() || fingers.opened_wide(reference);
      // Fingers that jammed open no further, and close no further then.
      if (!fingers.stands()) clock.wait_anew();
      if (reference.phase == LimbPhase::kDescend && events[l].arrived && opened) {
        retry_.opened();
        fingers.close_again();
      }
      events[l].gripped = false;
    }
    if (!reference.closing() || reference.on_foothold) continue;
    if (events[l].gripped && pull_.result(l) == GraspPull::Result::kNone) begin_pull(now, clock.now(), l);
    events[l].gripped = pull_.result(l) == GraspPull::Result::kPassed;
  }
}

void Grips::hold_open(PlanReference& reference) noexcept {
  retry_.apply(reference);
  for (int l = 0; l < kLimbs; ++l) {
    LimbReference& limb = reference.limbs[l];
    if ((searches_[l].begun() || touches_[l].busy()) && limb.phase == LimbPhase::kDescend)
      limb.finger_opening_m = limb.open_m;
    if (rubs_[l] && limb.phase == LimbPhase::kLift) limb.finger_opening_m += kFurther_m;
  }
}

void Grips::search_hold(const CycleView& now, PlanClock& clock, LimbController& limb, int l, LimbEvents& events,
                        double dt_s) noexcept {
  const LimbReference& reference = now.reference.limbs[l];
  HoldSearch& search = searches_[l];
  if ((reference.phase != LimbPhase::kDescend && !reference.closing()) || reference.on_foothold) return search.reset();
  const Vector3 missed_W_m = limb.gripper_W_m(now.body_W) - limb.anchor_W_m(reference);
  const ControlParameters& control = now.robot.control;
  const Vector3 off_W = reference.off_W();
  const Wrench& wrench_W = limb.wrench_W();
  const double above_m = missed_W_m.dot(off_W), aside_m = (missed_W_m - above_m * off_W).norm();
  const bool near = events.opened && aside_m <= now.robot.supervisor.arrive_tolerance_m;
  const bool waited = clock.waiting_for() == WaitingFor::kArrive && clock.waiting_limb() == l &&
                      clock.waited_s() > kBlocked_s && !now.health.force_torque_distrusted[l];
  // A finger that leans on its hold from the side rubs, and keeps the gripper a little too high: closing moves it over.
  const bool leans = clock.waited_s() > kLeans_s && std::abs(above_m) <= now.robot.gripper.pad_radius_m &&
                     wrench_W.force_N.norm() > control.unload_force_N;
  bool aims_anew = false;
  if (search.searches()) {
    aims_anew = search.advance(missed_W_m.norm(), dt_s);
  } else if (waited && limb.runs_against()) {
    const Vector3 axis_W = reference.finger_axis_W();
    const double pressed_N = wrench_W.force_N.dot(off_W);
    const double open_m = limb.fingers().opening_m(), at_m = pressed_along_m(wrench_W, axis_W, off_W);
    const bool finger = pressed_N > control.contact_force_N && std::abs(at_m) > kFinger * open_m;
    const int k = clock.now().interval;
    const LimbKnot& grasp = now.plan->limbs[clock.now().back ? std::max(k - 1, 0) : k + 1][l];
    const double slack_m = reference.open_m - grasp.finger_opening_m;
    const Vector3 shift_W_m = std::copysign(slack_m, at_m) * axis_W;
    aims_anew = finger && search.begin(above_m, off_W, shift_W_m, control.max_contact_offset_m);
    const bool hand = pressed_N > control.contact_force_N && !finger;
    if (near && (hand || (!finger && leans))) search.stand();
  } else if (waited && near && leans) {
    search.stand();
  }
  events.arrived = events.arrived || search.stands();
  if (aims_anew) limb.aim_beside(search.beside_W_m(), reference);
  if (!search.searches() && !aims_anew) return;
  events.arrived = false;
  events.blocked = true;
  clock.wait_anew();
}

void Grips::touch_wall(const CycleView& now, PlanClock& clock, LimbController& limb, int l, bool unsure,
                       LimbEvents& events, double dt_s) noexcept {
  const LimbReference& reference = now.reference.limbs[l];
  const GripperDescription& gripper = now.robot.gripper;
  WallTouch& touch = touches_[l];
  // A gripper that comes down aslant does not come down on the wall.
  if (reference.phase != LimbPhase::kDescend || reference.on_foothold || reference.back || !reference.upright())
    return touch.reset();
  const LimbKnot& grasp = now.plan->limbs[clock.now().interval + 1][l];
  const double touching_m = crux::touching_m(grasp.hold_top_m, gripper.pad_radius_m, gripper.finger_height_m);
  const Vector3 gripper_W_m = limb.gripper_W_m(now.body_W);
  if (!touch.begun()) {
    const bool room = grasp.alone_m > reference.open_m + 2.0 * gripper.pad_radius_m + kAside_m;
    const bool senses = !now.health.force_torque_distrusted[l] && limb.force_torque_tared();
    if (!unsure || !room || !senses || !events.arrived || events.blocked || searches_[l].begun()) return;
    // It begins where the clock waits for it.
    if (clock.waiting_for() == WaitingFor::kArrive && clock.waiting_limb() == l)
      touch.begin(gripper_W_m.z() - touching_m);
    events.arrived = false;
  }
  if (!touch.busy()) return;
  const double least_N = (touch.presses() ? kStaysFelt : 1.0) * now.robot.control.contact_force_N;
  const bool felt = limb.wrench_W().force_N.z() > least_N && !now.health.force_torque_distrusted[l];
  const double above_m = gripper_W_m.z() - limb.anchor_W_m(reference).z();
  if (touch.advance({events.opened, felt, limb.runs_against(), limb.ik_error_m() > kKept_m, above_m}, dt_s))
    limb.aim_beside(touch.beside_W_m(), reference);
  if (touch.touched()) {
    const double most_m = now.robot.control.max_contact_offset_m;
    touched_ = {l, std::clamp(gripper_W_m.z() - touching_m, -most_m, most_m)};
    limb.aim_beside(touched_.high_m * Vector3::UnitZ(), reference);  // there it is as high as planned
  }
  events.arrived = false;
  clock.wait_anew();
}

void Grips::find_hold_again(const CycleView& now, PlanClock& clock, PerLimb<LimbController>& limbs, bool hold,
                            double dt_s) noexcept {
  if (return_ == Return::kOver || now.plan->point_feet || now.plan->footholds) return;
  if (!now.health.any_hold_lost() && !now.health.any_gives_way()) return;
  // A gripper that comes down on its hold, closes or presses on it already goes on, and its limb takes up load.
  bool in_air = false, comes = false;
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& reference = now.reference.limbs[l];
    const bool lost = now.health.hold_lost[l];
    in_air = in_air || !(reference.gripping() || lost);
    const bool near = reference.closing() || reference.phase == LimbPhase::kDescend;
    comes = comes || (near && !lost);
  }
  if (return_ == Return::kNone) {
    const bool on = comes && !clock.now().back;
    const bool leads = on ? stance_s(*now.plan, clock.now().interval + 1) > 0.0 : clock.can_reverse(*now.plan);
    const bool can = in_air && retry_.limb() < 0 && leads;
    return_ = can ? Return::kOnItsWay : Return::kOver;
    if (!can) return;
    clock.depart(*now.plan, on ? Motion::kStep : Motion::kReverse);
    pull_.reset();
    retry_.reset();
  }
  // On two grips the body may hang elsewhere than it seems: fingers that do not arrive close where they are.
  const bool late = clock.waiting_for() == WaitingFor::kArrive && clock.waited_s() > kBlocked_s;
  PerLimb<LimbEvents> events;
  for (int l = 0; l < kLimbs; ++l) {
    events[l] = limbs[l].events(now.reference.limbs[l], now.body_W, dt_s);
    events[l].gripped = events[l].gripped || now.health.hold_lost[l];
    events[l].arrived = events[l].arrived || late;
  }
  clock.advance(*now.plan, events, dt_s, 1.0);
  const bool ends = clock.arrived(*now.plan) || clock.waited_s() > now.robot.supervisor.event_timeout_s;
  if (ends || hold) return_ = Return::kOver;
}

}  // namespace crux
