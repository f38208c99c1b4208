// A runtime that starts while its robot hangs on the wall: what the run before leaves behind for it, and whether
// joints, fingers and force/torque sensors agree with that.
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/control_core.hpp"

namespace crux {
namespace {

using crux_msgs::restart_t;

// What was left is older than the end of the run: the plan may have gone on for so long.
constexpr double kGoneOnStep_s = 0.02;
constexpr int kGoneOnSteps = 50;
constexpr double kSameOpening_m = 0.003;  // of fingers that nobody has moved
// Forces that differ from the weight by more than this share are not the weight alone.
constexpr double kWeightTolerance = 0.25;

void copy(const Vector3& from, double* to) { std::copy(from.data(), from.data() + 3, to); }

FaultEvent fault_of(const crux_msgs::fault_t& left) {
  if (crux_msgs::fault_info(left.code) == nullptr) return {};
  return {static_cast<FaultCode>(left.code), left.limb, left.node, left.value, left.limit};
}

/// Fingers neither have to press on a hold nor to be free of it.
bool opens_or_closes(const LimbReference& limb) { return limb.phase == LimbPhase::kOpen || limb.closing(); }

}  // namespace

void ControlCore::leave(restart_t& left) const noexcept {
  left.plan_id.clear();
  const bool on_wall = plan_ && started_ && !plan_->point_feet && supervisor_.state() != SupervisorState::kIdle;
  if (!on_wall) return;
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
    left.grips[l] = limb.gripping() && !faults_.lost(l) ? 1 : 0;
    copy(limbs_[l].anchor_W_m(limb), left.place_w_m + 3 * l);
    left.finger_opening_m[l] = limbs_[l].gripped_opening_m();
    copy(limbs_[l].tare_G().force_N, left.tare_force_g_n + 3 * l);
    copy(limbs_[l].tare_G().moment_Nm, left.tare_moment_g_nm + 3 * l);
  }
}

void ControlCore::restore(const restart_t& left) {
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

Reason ControlCore::off_grips(const PlanTime& at) const noexcept {
  const PlanReference there = play(*plan_, at);
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = there.limbs[l];
    const bool lost = reference_.limbs[l].gripping() && left_.grips[l] == 0;
    if (lost || opens_or_closes(limb)) continue;
    const double force_N = limbs_[l].finger_force_N(), opening_m = limbs_[l].finger_opening_m();
    if (limb.gripping() && !limbs_[l].presses())
      return {"it was on a hold, now its fingers press with {value} N (least: {limit} N)", l, 0, force_N,
              robot_.control.contact_force_N};
    if (left_.grips[l] != 0 && limb.gripping() && std::abs(opening_m - left_.finger_opening_m[l]) > kSameOpening_m)
      return {"its fingers stand at {value} m, on its hold they stood at {limit} m", l, 0, opening_m,
              left_.finger_opening_m[l]};
    if (!limb.gripping() && limbs_[l].presses())
      return {"it was in the air, now its fingers press with {value} N (most: {limit} N)", l, 0, force_N,
              robot_.control.contact_force_N};
  }
  return {};
}

Reason ControlCore::off_restart() noexcept {
  const double weight_N = robot_.total_mass_kg * plan_->gravity_W_m_s2.norm();
  const double unbalanced_N = balance_.unbalanced_W().force_N.norm();
  const double tolerated_N = std::max(kWeightTolerance * weight_N, robot_.stance.max_unbalanced_N);
  if (!(unbalanced_N <= tolerated_N))
    return {"the force/torque sensors feel {value} N beside the robot's weight (limit: {limit} N)", -1, 0, unbalanced_N,
            tolerated_N};
  for (int l = 0; l < kLimbs; ++l) {
    if (left_.grips[l] == 0) continue;
    const LimbController& limb = limbs_[l];
    const double off_m = (limb.gripper_W_m(body_.body_W()) - limb.anchor_W_m(reference_.limbs[l])).norm();
    if (!(off_m <= robot_.stance.max_misfit_m))
      return {"the gripper is {value} m from its hold, as the other limbs stand (limit: {limit} m)", l, 0, off_m,
              robot_.stance.max_misfit_m};
    const double limit_Nm = limb.ft_limit_Nm({}, body_.body_W().rotation);
    if (!(limb.ft_residual_Nm() <= limit_Nm))
      return {"its joints' torques do not fit its force/torque sensor by {value} Nm (limit: {limit} Nm)", l, 0,
              limb.ft_residual_Nm(), limit_Nm};
  }
  const Reason off = off_grips(clock_.now());
  const bool climbed = left_.supervisor_state == static_cast<std::int8_t>(SupervisorState::kClimbing);
  // Where in the plan limbs in the air are nearest to where they should be, and grips are as they should.
  double nearest_m = std::numeric_limits<double>::infinity();
  PlanTime best = clock_.now();
  for (int step = 0; step <= (climbed ? kGoneOnSteps : 0); ++step) {
    const PlanTime at = later(*plan_, clock_.now(), step * kGoneOnStep_s);
    if (off_grips(at)) continue;
    const PlanReference there = play(*plan_, at);
    double distance_m = 0.0;
    for (int l = 0; l < kLimbs; ++l) {
      const LimbReference& limb = there.limbs[l];
      if (!limb.gripping()) distance_m += (limbs_[l].gripper_W_m(body_.body_W()) - limb.gripper_position_W_m).norm();
    }
    if (distance_m < nearest_m) nearest_m = distance_m, best = at;
  }
  if (std::isinf(nearest_m)) return off;
  clock_.restore(best, clock_.verified());
  reference_ = play(*plan_, best);
  return {};
}

void ControlCore::take_up() noexcept {
  if (!looks_around_ || !faults_.link_restored()) return;
  looks_around_ = false;
  restart_refusal_ = off_restart();
  if (restart_refusal_) {
    notice_ = {FaultCode::kRestartRefused, restart_refusal_.limb, 0, restart_refusal_.value, restart_refusal_.limit};
    dropped_ = std::move(plan_);
    clock_.reset();
    reference_ = PlanReference();
    body_.reset({});
    return;
  }
  notice_ = {FaultCode::kRestarted, -1, 0, clock_.now().seconds(*plan_), 0.0};
  supervisor_.take_up(fault_of(left_.fault), left_.speed_scale);
  started_ = true;
  rearm_cycles_ = kRearmCycles;
}

}  // namespace crux
