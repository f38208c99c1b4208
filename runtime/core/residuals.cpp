// What the control core checks in every cycle: the grips against each other, forces against the weight, and the errors
// that the fault monitor judges.
#include "core/control_core.hpp"

#include <algorithm>

namespace crux {
namespace {

// A limb with this share of its load counts as standing.
constexpr double kStandingLoad = 0.9;

// A gripper that slips is relieved where so many others take its load.
constexpr int kLeastOthers = 2;

}  // namespace

void ControlCore::watch_stance(double dt_s) noexcept {
  PerLimb<FittedLimb> fitted;
  unsigned holding = 0;  // a bit a limb
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference_.limbs[l];
    // Before the plan has begun somebody may put the robot on: a limb holds where its fingers press.
    const bool presses = limbs_[l].finger_force_N() >= robot_.control.min_grasp_force_N;
    const bool grips = limb.gripping() && limbs_[l].in_contact() && (started_ || presses);
    const bool seen = !faults_.lost(l) && !limbs_[l].blind();
    const bool holds = engaged_ && !limb.point_foot && (grips || test_.begun(l)) && seen;
    fitted[l] = {&limbs_[l].state(), limbs_[l].torque_Nm(), holds};
    if (holds) holding |= 1U << static_cast<unsigned>(l);
  }
  stance_.update(fitted, dt_s);
  PerLimb<Wrench> felt_W;
  PerLimb<Vector3> grippers_W_m;
  for (int l = 0; l < kLimbs; ++l) {
    felt_W[l] = limbs_[l].wrench_W();
    grippers_W_m[l] = body_.body_W() * limbs_[l].state().gripper_B.position_m;
  }
  if (!started_) balance_.restart();
  balance_.update(felt_W, grippers_W_m, com_W_m_, robot_.total_mass_kg * plan_->gravity_W_m_s2, dt_s);
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference_.limbs[l];
    const double used = limit_surface_utilisation(limbs_[l].wrench_W(), limb.finger_axis_W(), contact(l, limb),
                                                  limbs_[l].finger_force_N());
    // While control takes over, the fingers' force and the load change too quickly to be set against each other.
    slips_[l].update(l, stance_, fitted[l].holds && limb.gripping(), started_ ? used : 0.0, dt_s);
    const Matrix3 rotation_GW = (body_.body_W().rotation * limbs_[l].state().gripper_B.rotation).transpose();
    compliances_[l].update(fitted[l].holds ? holding : 0, rotation_GW * limbs_[l].wrench_W().force_N,
                           stance_.since_contact(l).shift_G_m, dt_s);
  }
}

int ControlCore::slipping_limb() const noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    if (slips_[l].slips()) return l;
  }
  return -1;
}

double ControlCore::relief(int limb) const noexcept {
  int others = 0;
  for (int l = 0; l < kLimbs; ++l) others += l != limb && reference_.limbs[l].gripping() && !faults_.lost(l);
  return others < kLeastOthers ? 1.0 : slips_[limb].relief();
}

double ControlCore::utilisation(int limb) const noexcept {
  const LimbReference& reference = reference_.limbs[limb];
  if (!plan_ || plan_->point_feet || !reference.gripping()) return 0.0;
  if (supervisor_.state() == SupervisorState::kIdle && !limbs_[limb].presses()) return 0.0;
  const Wrench& wrench_W = faults_.distrusted(limb) ? wrenches_W_[limb] : limbs_[limb].wrench_W();
  return limit_surface_utilisation(wrench_W, reference.finger_axis_W(), contact(limb, reference),
                                   limbs_[limb].finger_force_N());
}

bool ControlCore::moves_slowly(int limb) const noexcept {
  const LimbReference& reference = reference_.limbs[limb];
  if (reference.point_foot) return reference.load > kStandingLoad;
  return test_.limb() != limb && retry_.limb() != limb;
}

FaultEvent ControlCore::oscillation() const noexcept {
  FaultEvent widest;
  for (const LimbController& limb : limbs_) {
    if (limb.oscillation().value > widest.value) widest = limb.oscillation();
  }
  return widest;
}

std::array<double, kAllJoints> ControlCore::joint_dead_time_s() const noexcept {
  std::array<double, kAllJoints> dead_s{};
  for (int joint = 0; joint < kAllJoints; ++joint) {
    const std::optional<int> cycles = probe_.done() ? probe_.dead_cycles(joint) : std::nullopt;
    dead_s[joint] = cycles ? *cycles / robot_.can.rate_Hz : -1.0;
  }
  return dead_s;
}

FaultEvent ControlCore::late_joint() const noexcept {
  FaultEvent latest;
  if (started_ || !probe_.done()) return latest;
  const std::array<double, kAllJoints> dead_s = joint_dead_time_s();
  const auto joint = static_cast<int>(std::ranges::max_element(dead_s) - dead_s.begin());
  const double borne_s = robot_.delay_margin_s / crux_msgs::robot::kDeadTimeMargin;
  if (dead_s[joint] > borne_s)
    latest = {FaultCode::kJointLate, joint / kJoints, robot_.can.nodes.joints[joint % kJoints], dead_s[joint], borne_s};
  return latest;
}

LoopErrors ControlCore::loop_errors(double late_s) const noexcept {
  LoopErrors errors;
  errors.late_s = late_s;
  errors.below_m = rise_.left_m();
  errors.rise_waited_s = rise_.waited_s();
  errors.unbalanced_N = plan_->point_feet || faults_.any_distrusted() ? 0.0 : balance_.change_N();
  errors.unbalanced_limb = balance_.limb();
  errors.body_error_m = (body_.body_W().position_m - reference_.body_W.position_m).norm();
  for (int l = 0; l < kLimbs; ++l) {
    errors.tracking_error_rad[l] = limbs_[l].tracking_error_rad(errors.worst_joint[l]);
    errors.ik_error_m[l] = limbs_[l].ik_error_m();
    // No grip counts as lost on the word of one sensor: opening and command must say so, too.
    errors.finger_force_N[l] = std::max(limbs_[l].finger_force_N(), limbs_[l].expected_finger_force_N());
    errors.least_force_N[l] = limbs_[l].least_finger_force_N();
    errors.closes_on_nothing[l] = limbs_[l].closes_on_nothing();
    errors.finger_residual_N[l] = plan_->point_feet ? 0.0 : limbs_[l].finger_residual_N(reference_.limbs[l], started_);
    errors.finds_no_hold[l] = !plan_->point_feet && limbs_[l].finds_no_hold(reference_.limbs[l], started_);
    errors.opening_m[l] = limbs_[l].finger_opening_m();
    errors.hold_m[l] = reference_.limbs[l].finger_opening_m;
    errors.grasp_failed[l] = test_.result(l) == GraspPull::Result::kFailed;
    // Joints at their stops bear what they do not tell.
    errors.ft_residual_Nm[l] = started_ && !rise_.rises() && moves_slowly(l) ? limbs_[l].ft_residual_Nm() : 0.0;
    errors.ft_frozen_Nm[l] = started_ && !rise_.rises() ? limbs_[l].ft_frozen_Nm() : 0.0;
    errors.slid_m[l] = slips_[l].slid_m();
    if (stance_.odd_limb() == l && test_.limb() != l) errors.misfit_m[l] = stance_.since_contact(l).shift_G_m.norm();
    errors.slips_on[l] = slips_[l].out_of_hand();
    errors.must_grip[l] = started_ && !plan_->point_feet && reference_.limbs[l].load > kStandingLoad;
    errors.ft_limit_Nm[l] = limbs_[l].ft_limit_Nm(wrenches_W_[l], body_.body_W().rotation);
  }
  errors.gave_way_m = test_.gave_way_m();
  errors.gave_way_limit_m = test_.limit_m();
  if (supervisor_.state() == SupervisorState::kClimbing) {
    errors.waited_s = started_ ? clock_.waited_s() : settling_time_s_;
    errors.waiting_limb = started_ ? clock_.waiting_limb() : settling_limb_;
  }
  return errors;
}

}  // namespace crux
