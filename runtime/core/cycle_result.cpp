// Filling in what one cycle gives.
#include <algorithm>
#include <cmath>

#include "core/control_core.hpp"
#include "core/robot/node_protocol.hpp"

namespace crux {
namespace {

void copy_rotation(const Matrix3& from, double* to) {
  const std::array<double, 4> quaternion = quaternion_wxyz(from);
  std::copy(quaternion.begin(), quaternion.end(), to);
}

bool latched_node(int state, int faults) {
  return (faults & kFaultCommandTimeout) != 0 || state == static_cast<int>(NodeState::kFault);
}

}  // namespace

void ControlCore::write_modes(const crux_msgs::control_input_t& in, CycleResult& out) const noexcept {
  const NodeMode mode = engaged_ ? NodeMode::kTrack : NodeMode::kHold;
  for (const LimbController& limb : limbs_) limb.write(mode, mode, out.output);
  for (int j = 0; j < kAllJoints && engaged_; ++j) out.output.joint_torque_nm[j] += probe_.torque_Nm(j);
  if (rearm_cycles_ == 0) return;
  for (int j = 0; j < kAllJoints; ++j) {
    if (latched_node(in.joint_state[j], in.joint_faults[j])) {
      out.output.joint_mode[j] = static_cast<std::int8_t>(NodeMode::kRearm);
    }
  }
  for (int l = 0; l < kLimbs; ++l) {
    if (latched_node(in.gripper_state[l], in.gripper_faults[l])) {
      out.output.gripper_mode[l] = static_cast<std::int8_t>(NodeMode::kRearm);
    }
  }
}

void ControlCore::write_reference(CycleResult& out) const noexcept {
  const CycleView now = view();
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& from = reference_.limbs[l];
    crux_msgs::limb_reference_t& to = out.reference[l];
    to.limb = static_cast<std::int8_t>(l);
    // Before control has taken over the plan's beginning says nothing of a limb; its fingers do.
    const bool idle = supervisor_.state() == SupervisorState::kIdle && !looks_around_;
    const LimbPhase felt = limbs_[l].fingers().presses() ? LimbPhase::kStance : LimbPhase::kSwing;
    to.phase = static_cast<std::int8_t>(idle ? felt : from.phase);
    to.load = from.load;
    copy(from.gripper_position_W_m, to.gripper_position_w_m);
    to.gripper_yaw_w_rad = from.gripper_yaw_W_rad;
    std::copy_n(from.gripper_tilt_W_rad.data(), 2, to.gripper_tilt_w_rad);
    to.finger_opening_m = from.gripping() ? limbs_[l].grip_opening_m(from) : from.finger_opening_m;
    copy(from.wrench_W.force_N, to.force_w_n);
    const Vector3 moment_Nm = from.wrench_W.moment_Nm + from.to_foot_W_m().cross(from.wrench_W.force_N);
    copy(from.on_foothold ? moment_Nm : from.wrench_W.moment_Nm, to.moment_w_nm);
    to.friction = from.friction;
    crux_msgs::limb_telemetry_t& telemetry = out.telemetry[l];
    limbs_[l].write(body_.body_W(), wrenches_W_[l], telemetry);
    const bool off_wall = supervisor_.state() == SupervisorState::kIdle && !limbs_[l].fingers().presses();
    telemetry.utilisation = off_wall ? 0.0 : grips_.utilisation(now, l);
    const Misfit& misfit = grips_.stance().since_contact(l);
    copy(misfit.shift_G_m, telemetry.stance_shift_g_m);
    copy(misfit.turn_G_rad, telemetry.stance_turn_g_rad);
    const SlipWatch& slip = grips_.slip(l);
    telemetry.slip_m = slip.slid_m();
    telemetry.borne_friction = slip.borne() * from.friction;
    telemetry.slip_friction = slip.slipped_at() * from.friction;
    telemetry.compliance_m_n = grips_.compliance_m_N(l);
  }
}

void ControlCore::write(const crux_msgs::control_input_t& in, CycleResult& out) const noexcept {
  out.output.cycle = in.cycle;
  write_modes(in, out);
  write_reference(out);

  const int slipping = grips_.slipping_limb(), moving = grips_.moving_limb();
  const bool climbing = supervisor_.state() == SupervisorState::kClimbing;
  const WaitingFor waiting_for = rise_.rises()   ? WaitingFor::kStandUp
                                 : !climbing     ? WaitingFor::kNothing
                                 : slipping >= 0 ? WaitingFor::kSlip
                                 : moving >= 0   ? WaitingFor::kDrift
                                 : started_      ? clock_.waiting_for()
                                                 : WaitingFor::kSettle;
  crux_msgs::robot_state_t& state = out.state;
  state.cycle = in.cycle;
  state.time_s = static_cast<double>(in.cycle) * in.dt_s;
  state.supervisor_state = static_cast<std::int8_t>(supervisor_.state());
  const Motion to_hold = clock_.now().back ? Motion::kReverse : Motion::kStep;
  state.motion = static_cast<std::int8_t>(grips_.returns() ? to_hold : supervisor_.motion());
  state.plan_complete = plan_ && clock_.complete(*plan_) ? 1 : 0;
  state.waiting_for = static_cast<std::int8_t>(waiting_for);
  state.waiting_limb = static_cast<std::int8_t>(!climbing     ? -1
                                                : moving >= 0 ? moving
                                                : started_    ? clock_.waiting_limb()
                                                              : settling_limb_);
  state.fault_code = static_cast<std::int16_t>(supervisor_.fault().code);
  state.missed_cycles = faults_.missed_cycles();
  state.plan_time_s = plan_ ? clock_.now().seconds(*plan_) : 0.0;
  state.plan_end_s = plan_ ? plan_->end_s() : 0.0;
  state.verified_time_s = plan_ && clock_.verified().interval >= 0 ? clock_.verified().seconds(*plan_) : -1.0;
  state.speed_scale = supervisor_.speed_scale();
  copy(body_.body_W().position_m, state.body_position_w_m);
  copy_rotation(body_.body_W().rotation, state.body_quaternion_w);
  copy(reference_.body_W.position_m, state.body_reference_position_w_m);
  copy_rotation(reference_.body_W.rotation, state.body_reference_quaternion_w);
  copy(com_W_m_, state.centre_of_mass_w_m);
  copy(balance_.unbalanced_W().force_N, state.unbalanced_force_w_n);
  copy(balance_.unbalanced_W().moment_Nm, state.unbalanced_moment_w_nm);

  const FaultEvent& fault = notice_ && !supervisor_.news() ? notice_ : supervisor_.news();
  out.has_fault = static_cast<bool>(fault);
  out.fault = {};
  out.fault.cycle = in.cycle;
  out.fault.code = static_cast<std::int16_t>(fault.code);
  out.fault.limb = static_cast<std::int8_t>(fault.limb);
  out.fault.node = static_cast<std::int8_t>(fault.node);
  out.fault.value = fault.value;
  out.fault.limit = fault.limit;
  out.command_verdict = supervisor_.verdict();
  out.command_refusal = supervisor_.refusal();
}

}  // namespace crux
