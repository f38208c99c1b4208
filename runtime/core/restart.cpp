#include "core/restart.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/supervise/supervisor.hpp"

namespace crux {
namespace {

using crux_msgs::restart_t;

// What was left is older than the end of the run: the plan may have gone on for so long.
constexpr double kGoneOnStep_s = 0.02;
constexpr int kGoneOnSteps = 50;
constexpr double kSameOpening_m = 0.003;  // of fingers that nobody has moved
// Forces that differ from the weight by more than this share are not the weight alone.
constexpr double kWeightTolerance = 0.25;

/// Fingers neither have to press on a hold nor to be free of it.
bool opens_or_closes(const LimbReference& limb) { return limb.phase == LimbPhase::kOpen || limb.closing(); }

/// Where fingers and force/torque sensors do not agree with the plan's `there`.
Reason off_grips(const CycleView& now, const restart_t& left, const PlanReference& there) noexcept {
  const double contact_N = now.robot.control.contact_force_N;
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& reference = there.limbs[l];
    const LimbController& limb = now.limbs[l];
    const bool lost = now.reference.limbs[l].gripping() && left.grips[l] == 0;
    if (lost || opens_or_closes(reference)) continue;
    const double force_N = limb.fingers().force_N(), opening_m = limb.fingers().opening_m();
    if (reference.gripping() && !limb.fingers().presses())
      return {"it was on a hold, now its fingers press with {value} N (least: {limit} N)", l, 0, force_N, contact_N};
    if (left.grips[l] != 0 && reference.gripping() && std::abs(opening_m - left.finger_opening_m[l]) > kSameOpening_m)
      return {"its fingers stand at {value} m, on its hold they stood at {limit} m", l, 0, opening_m,
              left.finger_opening_m[l]};
    if (!reference.gripping() && limb.fingers().presses())
      return {"it was in the air, now its fingers press with {value} N (most: {limit} N)", l, 0, force_N, contact_N};
  }
  return {};
}

/// Where the grips as a whole do not agree with what was left.
Reason off_holds(const CycleView& now, const restart_t& left, double unbalanced_N) noexcept {
  const double weight_N = now.robot.total_mass_kg * now.plan->gravity_W_m_s2.norm();
  const double tolerated_N = std::max(kWeightTolerance * weight_N, now.robot.stance.max_unbalanced_N);
  if (!(unbalanced_N <= tolerated_N))
    return {"the force/torque sensors feel {value} N beside the robot's weight (limit: {limit} N)", -1, 0, unbalanced_N,
            tolerated_N};
  for (int l = 0; l < kLimbs; ++l) {
    if (left.grips[l] == 0) continue;
    const LimbController& limb = now.limbs[l];
    const double off_m = (limb.gripper_W_m(now.body_W) - limb.anchor_W_m(now.reference.limbs[l])).norm();
    if (!(off_m <= now.robot.stance.max_misfit_m))
      return {"the gripper is {value} m from its hold, as the other limbs stand (limit: {limit} m)", l, 0, off_m,
              now.robot.stance.max_misfit_m};
    const double limit_Nm = limb.ft_limit_Nm({}, now.body_W.rotation);
    if (!(limb.ft_residual_Nm() <= limit_Nm))
      return {"its joints' torques do not fit its force/torque sensor by {value} Nm (limit: {limit} Nm)", l, 0,
              limb.ft_residual_Nm(), limit_Nm};
  }
  return {};
}

}  // namespace

FoundHanging find_hanging(const CycleView& now, const restart_t& left, const PlanTime& at,
                          double unbalanced_N) noexcept {
  if (const Reason off = off_holds(now, left, unbalanced_N)) return {off, at};
  const bool climbed = left.supervisor_state == static_cast<std::int8_t>(SupervisorState::kClimbing);
  // Where in the plan limbs in the air are nearest to where they should be, and grips are as they should.
  double nearest_m = std::numeric_limits<double>::infinity();
  FoundHanging found{off_grips(now, left, play(*now.plan, at)), at};
  for (int step = 0; step <= (climbed ? kGoneOnSteps : 0); ++step) {
    const PlanTime then = later(*now.plan, at, step * kGoneOnStep_s);
    const PlanReference there = play(*now.plan, then);
    if (off_grips(now, left, there)) continue;
    double distance_m = 0.0;
    for (int l = 0; l < kLimbs; ++l) {
      const LimbReference& limb = there.limbs[l];
      if (!limb.gripping()) distance_m += (now.limbs[l].gripper_W_m(now.body_W) - limb.gripper_position_W_m).norm();
    }
    if (distance_m < nearest_m) nearest_m = distance_m, found = {{}, then};
  }
  return found;
}

}  // namespace crux
