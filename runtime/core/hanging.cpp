// How the robot hangs; and control that takes over from there, as after a loss of power or in a new run.
#include <Eigen/Geometry>

#include <algorithm>
#include <utility>

#include "core/control_core.hpp"
#include "core/restart.hpp"

namespace crux {
namespace {

// A gripper that came down on its hold, or was closing about it, is turned by more than that: it begins anew.
constexpr double kAskew_rad = 0.1;
constexpr double kMostUsed = 0.9;  // of a grip, while the body stands up

FaultEvent fault_of(const crux_msgs::fault_t& left) {
  if (crux_msgs::fault_info(left.code) == nullptr) return {};
  return {static_cast<FaultCode>(left.code), left.limb, left.node, left.value, left.limit};
}

}  // namespace

void ControlCore::watch(double dt_s) noexcept {
  PerLimb<Wrench> felt_W;
  PerLimb<Vector3> grippers_W_m;
  for (int l = 0; l < kLimbs; ++l) {
    felt_W[l] = limbs_[l].wrench_W();
    grippers_W_m[l] = limbs_[l].gripper_W_m(body_.body_W());
  }
  if (!started_) {
    balance_.restart();
    balance_.forget_load();
  }
  const Vector3 weight_W_N = robot_.total_mass_kg * plan_->gravity_W_m_s2;
  balance_.update(felt_W, grippers_W_m, com_W_m_, weight_W_N, dt_s);
  const bool hangs = started_ && engaged_ && !plan_->point_feet && !faults_.health().any_force_torque_distrusted();
  if (hangs) balance_.weigh(weight_W_N, dt_s);
  grips_.watch(view(), started_ && supervisor_.state() == SupervisorState::kClimbing, dt_s);
}

void ControlCore::leave(crux_msgs::restart_t& left) const noexcept {
  left.plan_id.clear();
  const bool on_holds = plan_ && started_ && !plan_->point_feet && !plan_->footholds;
  if (!on_holds || supervisor_.state() == SupervisorState::kIdle) return;
  left.plan_id.assign(plan_->plan_id);
  left.supervisor_state = static_cast<std::int8_t>(supervisor_.state());
  left.interval = clock_.now().interval;
  left.elapsed_s = clock_.now().elapsed_s;
  left.back = clock_.now().back ? 1 : 0;
  left.verified_interval = clock_.verified().interval;
  left.verified_elapsed_s = clock_.verified().elapsed_s;
  left.speed_scale = supervisor_.speed_scale();
  const FaultEvent& fault = supervisor_.fault();
  left.fault.code = static_cast<std::int16_t>(fault.code);
  left.fault.limb = static_cast<std::int8_t>(fault.limb);
  left.fault.node = static_cast<std::int8_t>(fault.node);
  left.fault.value = fault.value;
  left.fault.limit = fault.limit;
  copy(body_.body_W().position_m, left.body_position_w_m);
  std::ranges::copy(quaternion_wxyz(body_.body_W().rotation), left.body_quaternion_w);
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference_.limbs[l];
    left.grips[l] = limb.gripping() && !faults_.health().hold_lost[l] ? 1 : 0;
    copy(limbs_[l].anchor_W_m(limb), left.place_w_m + 3 * l);
    left.finger_opening_m[l] = limbs_[l].fingers().gripped_opening_m();
    copy(limbs_[l].tare_G().force_N, left.tare_force_g_n + 3 * l);
    copy(limbs_[l].tare_G().moment_Nm, left.tare_moment_g_nm + 3 * l);
  }
}

void ControlCore::restore(const crux_msgs::restart_t& left) {
  left_ = left;
  looks_around_ = true;
  clock_.restore({std::clamp(left.interval, 0, plan_->intervals() - 1), left.elapsed_s, left.back != 0},
                 {std::clamp(left.verified_interval, -1, plan_->intervals() - 1), left.verified_elapsed_s});
  reference_ = play(*plan_, clock_.now());
  const double* q = left.body_quaternion_w;
  body_.reset(
      {Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix(), Vector3(left.body_position_w_m)});
  for (int l = 0; l < kLimbs; ++l) {
    limbs_[l].restore(reference_.limbs[l], left.grips[l] != 0, Vector3(left.place_w_m + 3 * l),
                      left.finger_opening_m[l],
                      {Vector3(left.tare_force_g_n + 3 * l), Vector3(left.tare_moment_g_nm + 3 * l)});
  }
}

void ControlCore::take_up() noexcept {
  if (!looks_around_ || !faults_.link_restored()) return;
  looks_around_ = false;
  const FoundHanging found = find_hanging(view(), left_, clock_.now(), balance_.unbalanced_W().force_N.norm());
  restart_refusal_ = found.refusal;
  if (restart_refusal_) {
    notice_ = {FaultCode::kRestartRefused, restart_refusal_.limb, 0, restart_refusal_.value, restart_refusal_.limit};
    dropped_ = std::move(plan_);
    clock_.reset();
    reference_ = PlanReference();
    body_.reset({});
    return;
  }
  clock_.restore(found.at, clock_.verified());
  reference_ = play(*plan_, clock_.now());
  notice_ = {FaultCode::kRestarted, -1, 0, clock_.now().seconds(*plan_), 0.0};
  supervisor_.take_up(fault_of(left_.fault), left_.speed_scale);
  started_ = true;
  rearm_cycles_ = kRearmCycles;
}

/// From where the robot hangs: what was to come down on its hold may be somewhere else.
void ControlCore::begin_again() noexcept {
  reference_ = play(*plan_, clock_.now());
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference_.limbs[l];
    double distance_m = 0.0, angle_rad = 0.0;
    limbs_[l].pose_error(limb, body_.body_W(), distance_m, angle_rad);
    const bool comes = !limb.point_foot && (limb.closing() || limb.phase == LimbPhase::kDescend);
    distance_m = (limbs_[l].gripper_W_m(body_.body_W()) - limbs_[l].anchor_W_m(limb)).norm();
    if (comes && (distance_m > robot_.supervisor.arrive_tolerance_m || angle_rad > kAskew_rad))
      clock_.approach_anew(*plan_);
  }
  reference_ = play(*plan_, clock_.now());
}

void ControlCore::stand_up(double dt_s) noexcept {
  if (!rise_.rises()) return;
  const CycleView now = view();
  bool may = engagement() >= 1.0;
  for (int l = 0; may && l < kLimbs; ++l) {
    const bool bears = limbs_[l].torque_share() <= StandUp::kMostTorque && grips_.utilisation(now, l) <= kMostUsed;
    const LimbPhase phase = reference_.limbs[l].phase;
    const bool flies = phase == LimbPhase::kLift || phase == LimbPhase::kSwing || phase == LimbPhase::kDescend;
    const bool comes = flies ? !limbs_[l].caught() : rise_.follows(l, limbs_[l].ik_error_m());
    may = bears && comes;
  }
  rise_.advance(may, dt_s);
  reference_.body_W = rise_.below(reference_.body_W);
}

}  // namespace crux
