#include "core/plan/reference_player.hpp"

#include <algorithm>

namespace crux {
namespace {

double load_ramp(double u) { return smoothstep((u - kLoadBegin) / kLoadSpan); }

double unload_ramp(double u) { return smoothstep((u - kUnloadBegin) / kUnloadSpan); }

/// Cubic Hermite polynomial on [0, 1] between values a and b with slopes da and db over an interval of dt.
template <class Vector>
Vector hermite(const Vector& a, const Vector& b, const Vector& da, const Vector& db, double dt_s, double u) {
  const double u2 = u * u, u3 = u2 * u;
  const double h00 = 2.0 * u3 - 3.0 * u2 + 1.0, h10 = u3 - 2.0 * u2 + u, h01 = 3.0 * u2 - 2.0 * u3, h11 = u3 - u2;
  return h00 * a + h01 * b + dt_s * (h10 * da + h11 * db);
}

Pose body_pose(const PreparedPlan& plan, int k, double u) {
  const Vector6 pose =
      hermite(plan.body[k], plan.body[k + 1], plan.body_slope[k], plan.body_slope[k + 1], plan.step_s[k], u);
  return {rotation_from_rpy(pose.tail<3>()), pose.head<3>()};
}

void place_gripper(LimbReference& out, const LimbKnot& from, const LimbKnot& to, double share) {
  out.gripper_position_W_m = from.gripper_position_W_m + share * (to.gripper_position_W_m - from.gripper_position_W_m);
  out.gripper_yaw_W_rad = from.gripper_yaw_W_rad + share * (to.gripper_yaw_W_rad - from.gripper_yaw_W_rad);
  out.gripper_tilt_W_rad = from.gripper_tilt_W_rad + share * (to.gripper_tilt_W_rad - from.gripper_tilt_W_rad);
}

void stand_on(const LimbKnot& foothold, LimbReference& out) {
  out.on_foothold = foothold.foot;
  out.foot_radius_m = foothold.foot_radius_m;
}

void play_stance(const PreparedPlan& plan, int k, double u, int l, bool back, LimbReference& out) {
  const LimbKnot& here = plan.limbs[k][l];
  place_gripper(out, here, here, 0.0);
  out.finger_opening_m = here.finger_opening_m;
  out.friction = here.friction;
  out.lean_rad = here.lean_rad;
  stand_on(here, out);
  if (plan.lets_go(k + 1, l)) {
    out.load = 1.0 - unload_ramp(u);
    if (u > kUnloadBegin) out.phase = back ? LimbPhase::kLoad : LimbPhase::kUnload;
  } else if (plan.takes_hold(k, l)) {
    out.load = load_ramp(u);
  }
  if (plan.takes_hold(k, l) && u < kLoadBegin + kLoadSpan) {
    out.phase = back ? LimbPhase::kUnload : LimbPhase::kLoad;
    out.load = std::min(out.load, load_ramp(u));
  }
}

/// The end of a swing at which the fingers open or close on `grasp`; `air`: the knot beside it. By plan they are as far
/// open as `open` says, 0 on the hold and 1 at `air`, and by `clear` as the gripper begins to leave.
void play_swing_end(const LimbKnot& grasp, const LimbKnot& air, LimbPhase phase, double open, double clear,
                    LimbReference& out) {
  const double opens_m = grasp.foot ? 0.0 : air.finger_opening_m - grasp.finger_opening_m;
  out.phase = phase;
  out.open_m = air.finger_opening_m;
  out.finger_opening_m = out.closing() ? grasp.finger_opening_m : air.finger_opening_m;
  if (phase == LimbPhase::kDescend) out.finger_opening_m -= (1.0 - open) * opens_m;
  if (phase == LimbPhase::kOpen || phase == LimbPhase::kLift) out.opens_m = opens_m;
  if (phase == LimbPhase::kOpen) {
    out.may_lack_m = (1.0 - clear) * opens_m;
    stand_on(grasp, out);
  }
  if (phase == LimbPhase::kDescend || out.closing()) {
    out.friction = grasp.friction;
    out.lean_rad = grasp.lean_rad;
    stand_on(grasp, out);
  }
}

void play_air(const PreparedPlan& plan, int k, double u, int l, bool back, LimbReference& out) {
  const LimbKnot& here = plan.limbs[k][l];
  const LimbKnot& next = plan.limbs[k + 1][l];
  const SwingShares& swing = plan.swing;
  out.load = 0.0;
  // At the very instants the gripper still rests and the fingers are open, so that the clock may stand there.
  if (plan.lets_go(k, l)) {
    const LimbPhase forward = u <= swing.lift ? LimbPhase::kOpen : LimbPhase::kLift;
    const LimbPhase reverse = u < swing.lift ? LimbPhase::kClose : LimbPhase::kDescend;
    play_swing_end(plan.limbs[std::max(k - 1, 0)][l], next, back ? reverse : forward, swing.fingers_move ? u : 1.0,
                   swing.fingers_move ? swing.lift : 1.0, out);
    place_gripper(out, here, next, smoothstep((u - swing.lift) / (1.0 - swing.lift)));
  } else if (plan.takes_hold(k + 1, l)) {
    const LimbPhase forward = u <= swing.close ? LimbPhase::kDescend : LimbPhase::kClose;
    const LimbPhase reverse = u < swing.close ? LimbPhase::kLift : LimbPhase::kOpen;
    play_swing_end(next, here, back ? reverse : forward, swing.fingers_move ? 1.0 - u : 1.0,
                   swing.fingers_move ? 1.0 - swing.close : 1.0, out);
    place_gripper(out, here, next, smoothstep(u / swing.arrive));
  } else {
    out.phase = LimbPhase::kSwing;
    place_gripper(out, here, next, u);
    out.finger_opening_m = here.finger_opening_m + u * (next.finger_opening_m - here.finger_opening_m);
  }
}

FootPose foot_pose(const LimbKnot& knot) {
  FootPose pose;
  pose << knot.gripper_position_W_m, knot.gripper_yaw_W_rad;
  return pose;
}

/// Point feet: stance as on a hold, and in the air a way without fingers.
void play_foot(const PreparedPlan& plan, int k, double u, int l, LimbReference& out) {
  const LimbKnot& here = plan.limbs[k][l];
  out.point_foot = true;
  out.finger_opening_m = here.finger_opening_m;
  if (here.air) {
    out.load = 0.0;
    out.phase = plan.lets_go(k, l)          ? LimbPhase::kLift
                : plan.takes_hold(k + 1, l) ? LimbPhase::kDescend
                                            : LimbPhase::kSwing;
    out.friction = plan.limbs[k + 1][l].friction;
  } else {
    play_stance(plan, k, u, l, false, out);
  }
  const FootPose pose = hermite(foot_pose(here), foot_pose(plan.limbs[k + 1][l]), plan.foot_slope[k][l],
                                plan.foot_slope[k + 1][l], plan.step_s[k], u);
  out.gripper_position_W_m = pose.head<3>();
  out.gripper_yaw_W_rad = pose[3];
}

/// What is constant over each interval, between the intervals.
template <class Value>
Value blended(const PreparedPlan& plan, int k, double u, int l, Value LimbKnot::* value) {
  const Value& here = plan.limbs[k][l].*value;
  // Where a limb has just released, the shift was made before.
  const Value& before = k == 0 || plan.release[k] ? here : plan.limbs[k - 1][l].*value;
  Value now = before + (here - before) * load_ramp(u);
  if (plan.release[k + 1]) now = now + (plan.limbs[k + 1][l].*value - now) * unload_ramp(u);
  return now;
}

}  // namespace

double stance_s(const PreparedPlan& plan, int k) noexcept {
  bool taken = false;
  for (int l = 0; l < kLimbs; ++l) {
    if (plan.limbs[k][l].air) return -1.0;
    taken = taken || plan.takes_hold(k, l);
  }
  return taken ? (kLoadBegin + kLoadSpan) * plan.step_s[k] : 0.0;
}

PlanReference play(const PreparedPlan& plan, const PlanTime& at) noexcept {
  const int k = std::clamp(at.interval, 0, plan.intervals() - 1);
  const double u = std::clamp(at.elapsed_s / plan.step_s[k], 0.0, 1.0);
  PlanReference reference;
  reference.body_W = body_pose(plan, k, u);
  for (int l = 0; l < kLimbs; ++l) {
    LimbReference& limb = reference.limbs[l];
    limb.back = at.back;
    if (plan.point_feet) {
      play_foot(plan, k, u, l, limb);
    } else {
      plan.limbs[k][l].air ? play_air(plan, k, u, l, at.back, limb) : play_stance(plan, k, u, l, at.back, limb);
    }
    limb.wrench_W = blended(plan, k, u, l, &LimbKnot::wrench_W);
    limb.squeeze_N = blended(plan, k, u, l, &LimbKnot::squeeze_N);
  }
  return reference;
}

PlanTime later(const PreparedPlan& plan, const PlanTime& at, double ahead_s) noexcept {
  PlanTime then{at.interval, at.elapsed_s + (at.back ? -ahead_s : ahead_s), at.back};
  while (then.elapsed_s > plan.step_s[then.interval]) {
    if (then.interval + 1 >= plan.intervals()) return {plan.intervals() - 1, plan.step_s.back()};
    then.elapsed_s -= plan.step_s[then.interval];
    ++then.interval;
  }
  while (then.elapsed_s < 0.0) {
    if (then.interval == 0) return {0, 0.0, true};
    --then.interval;
    then.elapsed_s += plan.step_s[then.interval];
  }
  return then;
}

}  // namespace crux
