#include "core/supervise/loop_errors.hpp"

#include <algorithm>
#include <optional>

namespace crux {
namespace {

// A limb with this share of its load counts as standing.
constexpr double kStandingLoad = 0.9;
// A foot that is to press with less than so many times the least force is not said to have lost its foothold.
constexpr double kMustPress = 2.5;

/// A limb without inertia to speak of: legs that swing have some, and what slides on its hold as it is pulled.
bool moves_slowly(const CycleView& now, const Grips& grips, int limb) noexcept {
  const LimbReference& reference = now.reference.limbs[limb];
  return reference.foot() ? reference.load > kStandingLoad : grips.rests(limb);
}

/// A foot on a foothold, in place of what is asked of fingers.
void judge_foot(const CycleView& now, const Grips& grips, int l, LoopErrors& errors) noexcept {
  const LimbReference& reference = now.reference.limbs[l];
  const LimbController& limb = now.limbs[l];
  const double asked_N = now.wrenches_W[l].force_N.dot(reference.off_W());
  const bool stands = now.started && reference.gripping() && reference.load > kStandingLoad;
  errors.must_grip[l] = errors.closes_on_nothing[l] = false;
  errors.finger_residual_N[l] = 0.0;
  errors.foot_N[l] = limb.foot_force_N(reference);
  errors.must_press[l] = stands && !now.health.force_torque_distrusted[l] &&
                         asked_N > kMustPress * now.robot.supervisor.min_stance_force_N;
  errors.slid_m[l] = grips.foot_slid_m(now, l);
  errors.slips_on[l] = errors.slid_m[l] > now.robot.stance.max_slip_m;
}

}  // namespace

LoopErrors loop_errors(const CycleView& now, const Grips& grips, const WeightBalance& balance,
                       bool stands_up) noexcept {
  const bool walks = now.plan->point_feet;
  const StanceFit& stance = grips.stance();
  const GraspPull& pull = grips.pull();
  LoopErrors errors;
  errors.unbalanced_N = walks || now.health.any_force_torque_distrusted() ? 0.0 : balance.change_N();
  errors.unbalanced_limb = balance.limb();
  errors.body_error_m = (now.body_W.position_m - now.reference.body_W.position_m).norm();
  for (int l = 0; l < kLimbs; ++l) {
    const LimbController& limb = now.limbs[l];
    const LimbReference& reference = now.reference.limbs[l];
    errors.tracking_error_rad[l] = limb.tracking_error_rad(errors.worst_joint[l]);
    errors.ik_error_m[l] = limb.ik_error_m();
    // No grip counts as lost on the word of one sensor: opening and command must say so, too.
    errors.finger_force_N[l] = std::max(limb.fingers().force_N(), limb.fingers().expected_force_N());
    errors.least_force_N[l] = limb.fingers().least_force_N();
    errors.closes_on_nothing[l] = limb.fingers().closes_on_nothing();
    errors.finger_residual_N[l] = walks ? 0.0 : limb.finger_residual_N(reference, now.started);
    errors.finds_no_hold[l] = !walks && limb.fingers().finds_no_hold(reference, now.started);
    errors.opening_m[l] = limb.fingers().opening_m();
    errors.hold_m[l] = reference.finger_opening_m;
    errors.grasp_failed[l] = pull.result(l) == GraspPull::Result::kFailed;
    const bool settled = now.started && !stands_up;
    errors.ft_residual_Nm[l] = settled && moves_slowly(now, grips, l) ? limb.ft_residual_Nm() : 0.0;
    errors.ft_frozen_Nm[l] = settled ? limb.ft_frozen_Nm() : 0.0;
    errors.slid_m[l] = grips.slip(l).slid_m();
    if (pull.limb() != l) errors.misfit_m[l] = stance.misfit_m(l);
    errors.misfit_off_faces_m[l] = stance.misfit_off_faces_m(l);
    errors.slips_on[l] = grips.slip(l).out_of_hand();
    errors.must_grip[l] = now.started && !walks && reference.load > kStandingLoad;
    errors.ft_limit_Nm[l] = limb.ft_limit_Nm(now.wrenches_W[l], now.body_W.rotation);
    if (reference.on_foothold) judge_foot(now, grips, l, errors);
  }
  if (!stands_up) errors.drift = grips.drift();
  errors.gave_way_m = pull.gave_way_m();
  errors.gave_way_limit_m = pull.limit_m();
  return errors;
}

FaultEvent oscillation(const PerLimb<LimbController>& limbs) noexcept {
  FaultEvent widest;
  for (const LimbController& limb : limbs) {
    if (limb.oscillation().value > widest.value) widest = limb.oscillation();
  }
  return widest;
}

std::array<double, kAllJoints> dead_time_s(const DelayProbe& probe, double rate_Hz) noexcept {
  std::array<double, kAllJoints> dead_s{};
  for (int joint = 0; joint < kAllJoints; ++joint) {
    const std::optional<int> cycles = probe.done() ? probe.dead_cycles(joint) : std::nullopt;
    dead_s[joint] = cycles ? *cycles / rate_Hz : -1.0;
  }
  return dead_s;
}

FaultEvent late_joint(const DelayProbe& probe, const RobotDescription& robot) noexcept {
  if (!probe.done()) return {};
  const std::array<double, kAllJoints> dead_s = dead_time_s(probe, robot.can.rate_Hz);
  const auto joint = static_cast<int>(std::ranges::max_element(dead_s) - dead_s.begin());
  const double borne_s = robot.delay_margin_s / crux_msgs::robot::kDeadTimeMargin;
  if (!(dead_s[joint] > borne_s)) return {};
  return {FaultCode::kJointLate, joint / kJoints, robot.can.nodes.joints[joint % kJoints], dead_s[joint], borne_s};
}

}  // namespace crux
