#include "core/supervise/fault_monitor.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "core/robot/node_protocol.hpp"
#include "crux_msgs/bus_health_t.hpp"

namespace crux {
namespace {

using crux_msgs::bus_health_t;

// One cycle whose frames found no room is a hiccup; the nodes' watchdogs wait for more as well.
constexpr int kMaxFullCycles = 1;
// After a fault of its bus a limb's nodes are heard, and armed, again: until then they say nothing new.
constexpr double kBusEcho_s = 1.0;
constexpr double kHoldGone_s = 0.006;    // longer than readings that are wrong once or twice
constexpr double kFtResidual_s = 0.030;  // longer than a contact's shock
// A self-locking screw that starts again tells its force late: up to 54 ms on the emulated board.
constexpr double kFingerResidual_s = 0.08;

bool finite(const double* values, int n) {
  for (int i = 0; i < n; ++i) {
    if (!std::isfinite(values[i])) return false;
  }
  return true;
}

bool all_finite(const crux_msgs::control_input_t& in) {
  return std::isfinite(in.dt_s) && in.dt_s > 0.0 && finite(in.joint_position_rad, kAllJoints) &&
         finite(in.joint_velocity_rad_s, kAllJoints) && finite(in.joint_torque_nm, kAllJoints) &&
         finite(in.finger_opening_m, kLimbs) && finite(in.finger_speed_m_s, kLimbs) &&
         finite(in.finger_force_n, kLimbs) && finite(in.ft_force_g_n, 3 * kLimbs) &&
         finite(in.ft_moment_g_nm, 3 * kLimbs);
}

bool doubled(int faults) { return (faults & kFaultTwoSenders) != 0; }

bool unfit(int state, int faults) {
  return state == static_cast<int>(NodeState::kFault) || (faults & kFaultsUnfit) != 0 || doubled(faults);
}

bool latched(int faults) { return (faults & kFaultCommandTimeout) != 0; }

/// A node that has just started holds as well: it has lost what it was told.
bool holds(int state) {
  return state == static_cast<int>(NodeState::kHold) || state == static_cast<int>(NodeState::kDecelerate) ||
         state == static_cast<int>(NodeState::kBoot);
}

/// Adds dt while `wrong` lasts; true once it has lasted for `persistence_s`.
bool lasts(bool wrong, double& time_s, double dt_s, double persistence_s) {
  time_s = wrong ? time_s + dt_s : 0.0;
  return time_s >= persistence_s;
}

}  // namespace

FaultMonitor::FaultMonitor(const RobotDescription& robot)
    : limits_(robot.supervisor), can_(robot.can), stance_(robot.stance) {}

void FaultMonitor::observe(const crux_msgs::control_input_t& in) noexcept {
  bool all_fresh = true;
  const auto count = [&](int fresh, int& silence) {
    silence = fresh != 0 ? 0 : silence + 1;
    all_fresh = all_fresh && fresh != 0;
  };
  for (int j = 0; j < kAllJoints; ++j) {
    if (in.joint_state[j] == static_cast<int>(NodeState::kBoot))
      note_restart(j / kJoints, can_.nodes.joints[j % kJoints], joint_silence_[j], in.dt_s);
    count(in.joint_fresh[j], joint_silence_[j]);
  }
  for (int l = 0; l < kLimbs; ++l) {
    if (in.gripper_state[l] == static_cast<int>(NodeState::kBoot))
      note_restart(l, can_.nodes.gripper, gripper_silence_[l], in.dt_s);
    count(in.gripper_fresh[l], gripper_silence_[l]);
    count(in.ft_fresh[l], ft_silence_[l]);
  }
  if (!all_fresh) ++missed_cycles_;
  for (int l = 0; l < kLimbs; ++l) {
    full_cycles_[l] = in.bus_state[l] == bus_health_t::FULL ? full_cycles_[l] + 1 : 0;
    since_bus_fault_s_[l] = in.bus_state[l] == bus_health_t::ACTIVE ? since_bus_fault_s_[l] + in.dt_s : 0.0;
    bus_held_[l] = bus_held_[l] || in.bus_state[l] != bus_health_t::ACTIVE;
  }
  well_time_s_ = link_well(in) ? well_time_s_ + in.dt_s : 0.0;
}

/// Several of a limb: their limb; of several limbs: none.
void FaultMonitor::note_restart(int limb, int node, int silence, double dt_s) noexcept {
  if (silence <= limits_.silent_cycles) return;
  const bool first = !supply_;
  const int of_limb = first || supply_.limb == limb ? limb : -1;
  const int of_node = first || (of_limb >= 0 && supply_.node == node) ? node : 0;
  supply_ = {FaultCode::kPowerLost, of_limb, of_node, std::max(supply_.value, silence * dt_s), 0.0};
}

bool FaultMonitor::link_well(const crux_msgs::control_input_t& in) const noexcept {
  if (!all_finite(in)) return false;
  for (int j = 0; j < kAllJoints; ++j) {
    if (joint_silence_[j] > 0 || unfit(in.joint_state[j], in.joint_faults[j])) return false;
  }
  for (int l = 0; l < kLimbs; ++l) {
    if (in.bus_state[l] != bus_health_t::ACTIVE || gripper_silence_[l] > 0 ||
        unfit(in.gripper_state[l], in.gripper_faults[l])) {
      return false;
    }
  }
  return force_torque_well(in);
}

bool FaultMonitor::all_well(const crux_msgs::control_input_t& in) const noexcept {
  return link_well(in) && !any_latched(in);
}

bool FaultMonitor::any_latched(const crux_msgs::control_input_t& in) const noexcept {
  return std::any_of(std::begin(in.joint_faults), std::end(in.joint_faults), latched) ||
         std::any_of(std::begin(in.gripper_faults), std::end(in.gripper_faults), latched);
}

bool FaultMonitor::force_torque_well(const crux_msgs::control_input_t& in) const noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    if (ft_silence_[l] > limits_.silent_cycles || in.ft_status[l] != 0) return false;
  }
  return true;
}

FaultEvent FaultMonitor::bus_fault(const crux_msgs::control_input_t& in) const noexcept {
  FaultEvent fault;
  std::int8_t gravest = bus_health_t::ACTIVE;
  for (int l = 0; l < kLimbs; ++l) {
    if (in.bus_state[l] <= gravest) continue;
    FaultCode code = FaultCode::kNone;
    double value = 0.0, limit = 0.0;
    switch (in.bus_state[l]) {
      case bus_health_t::PASSIVE:
        code = FaultCode::kBusPassive;
        break;
      case bus_health_t::UNACKNOWLEDGED:
        code = FaultCode::kBusUnacknowledged;
        break;
      case bus_health_t::FULL:
        if (full_cycles_[l] <= kMaxFullCycles) continue;
        code = FaultCode::kBusFull;
        value = full_cycles_[l];
        limit = kMaxFullCycles;
        break;
      case bus_health_t::FOREIGN:
        code = FaultCode::kBusForeign;
        break;
      case bus_health_t::OFF:
        code = FaultCode::kBusOff;
        break;
      default:
        code = FaultCode::kBusDown;
        break;
    }
    gravest = in.bus_state[l];
    fault = {code, l, 0, value, limit};
  }
  return fault;
}

FaultEvent FaultMonitor::silent_node(After after) const noexcept {
  const double limit = limits_.silent_cycles;
  const int longest = std::max(std::ranges::max(joint_silence_), std::ranges::max(gripper_silence_));
  const int shortest = std::min(std::ranges::min(joint_silence_), std::ranges::min(gripper_silence_));
  // Some may have got a last word in: nobody has been heard for half of the limit.
  if (longest > limits_.silent_cycles && 2 * shortest > limits_.silent_cycles) {
    return {FaultCode::kAllNodesSilent, -1, 0, static_cast<double>(longest), limit};
  }
  for (int l = 0; l < kLimbs; ++l) {
    if (after == After::kOtherFaults && follows_bus(l)) continue;
    for (int j = 0; j < kJoints; ++j) {
      const int silence = joint_silence_[l * kJoints + j];
      if (silence > limits_.silent_cycles) {
        return {FaultCode::kNodeSilent, l, can_.nodes.joints[j], static_cast<double>(silence), limit};
      }
    }
    if (gripper_silence_[l] > limits_.silent_cycles) {
      return {FaultCode::kNodeSilent, l, can_.nodes.gripper, static_cast<double>(gripper_silence_[l]), limit};
    }
  }
  return {};
}

FaultEvent FaultMonitor::doubled_node(const crux_msgs::control_input_t& in) const noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    for (int j = 0; j < kJoints; ++j) {
      if (doubled(in.joint_faults[l * kJoints + j])) return {FaultCode::kNodeTwice, l, can_.nodes.joints[j], 0.0, 0.0};
    }
    if (doubled(in.gripper_faults[l])) return {FaultCode::kNodeTwice, l, can_.nodes.gripper, 0.0, 0.0};
  }
  return {};
}

FaultEvent FaultMonitor::unfit_node(const crux_msgs::control_input_t& in, bool state_counts) const noexcept {
  const auto wrong = [state_counts](int state, int faults) {
    return state_counts ? unfit(state, faults) : (faults & kFaultsUnfit) != 0;
  };
  for (int l = 0; l < kLimbs; ++l) {
    for (int j = 0; j < kJoints; ++j) {
      const int i = l * kJoints + j;
      if (wrong(in.joint_state[i], in.joint_faults[i])) {
        return {FaultCode::kNodeFault, l, can_.nodes.joints[j], static_cast<double>(in.joint_faults[i]), 0.0};
      }
    }
    if (wrong(in.gripper_state[l], in.gripper_faults[l])) {
      return {FaultCode::kNodeFault, l, can_.nodes.gripper, static_cast<double>(in.gripper_faults[l]), 0.0};
    }
  }
  return {};
}

bool FaultMonitor::holds_by_itself(int state, int faults) const noexcept {
  // A node takes a few cycles from the first command to track until its status says so.
  return latched(faults) || (tracking_cycles_ > limits_.silent_cycles && holds(state));
}

void FaultMonitor::note_standing(const crux_msgs::control_input_t& in) noexcept {
  // One that has just started follows the next command.
  const auto stands = [this](int state, int faults) {
    return state != static_cast<int>(NodeState::kBoot) && holds_by_itself(state, faults);
  };
  for (int l = 0; l < kLimbs; ++l) {
    joint_stands_[l] = false;
    for (int i = l * kJoints; i < (l + 1) * kJoints; ++i)
      joint_stands_[l] = joint_stands_[l] || stands(in.joint_state[i], in.joint_faults[i]);
    fingers_stand_[l] = stands(in.gripper_state[l], in.gripper_faults[l]);
  }
}

FaultEvent FaultMonitor::holding_node(const crux_msgs::control_input_t& in) noexcept {
  const bool must_track = tracking_cycles_ > limits_.silent_cycles;
  const auto stopped_node = [&](int l) {  // the limb's first; 0: none
    for (int j = 0; j < kJoints; ++j) {
      const int i = l * kJoints + j;
      if (holds_by_itself(in.joint_state[i], in.joint_faults[i])) return can_.nodes.joints[j];
    }
    return holds_by_itself(in.gripper_state[l], in.gripper_faults[l]) ? can_.nodes.gripper : 0;
  };
  FaultEvent first;
  int limbs = 0;
  for (int l = 0; l < kLimbs; ++l) {
    const int node = stopped_node(l);
    bus_held_[l] = bus_held_[l] && (node != 0 || !must_track);  // until they are armed again
    if (node != 0 && ++limbs > 0 && !first && !bus_held_[l]) first = {FaultCode::kNodeHolds, l, node, 0.0, 0.0};
  }
  return limbs == kLimbs ? FaultEvent{FaultCode::kAllNodesHold, -1, 0, 0.0, 0.0} : first;
}

bool FaultMonitor::follows_bus(int limb) const noexcept { return since_bus_fault_s_[limb] < kBusEcho_s; }

FaultEvent FaultMonitor::sensor_fault(const crux_msgs::control_input_t& in, After after) const noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    if (after == After::kOtherFaults && follows_bus(l)) continue;
    if (ft_silence_[l] > limits_.silent_cycles) {
      return {FaultCode::kFtSilent, l, can_.nodes.gripper, static_cast<double>(ft_silence_[l]),
              static_cast<double>(limits_.silent_cycles)};
    }
    if ((in.ft_status[l] & kFtNotReady) != 0) {
      return {FaultCode::kFtNotReady, l, can_.nodes.gripper, static_cast<double>(in.ft_status[l]), 0.0};
    }
    if ((in.ft_status[l] & kFtOverload) != 0) {
      return {FaultCode::kFtOverload, l, can_.nodes.gripper, static_cast<double>(in.ft_status[l]), 0.0};
    }
  }
  return {};
}

FaultEvent FaultMonitor::node_fault(const crux_msgs::control_input_t& in, bool tracking) noexcept {
  tracking_cycles_ = tracking ? tracking_cycles_ + 1 : 0;
  note_standing(in);
  if (!all_finite(in)) return {FaultCode::kNotFinite, -1, 0, 0.0, 0.0};
  if (const FaultEvent fault = bus_fault(in)) return fault;
  if (const FaultEvent fault = doubled_node(in)) return fault;
  if (const FaultEvent fault = silent_node(After::kOtherFaults)) return fault;
  if (const FaultEvent fault = unfit_node(in, true)) return fault;
  if (const FaultEvent fault = holding_node(in)) return fault;
  return sensor_fault(in, After::kOtherFaults);
}

FaultEvent FaultMonitor::standing_cause(const crux_msgs::control_input_t& in) const noexcept {
  if (!all_finite(in)) return {FaultCode::kNotFinite, -1, 0, 0.0, 0.0};
  if (const FaultEvent fault = bus_fault(in)) return fault;
  if (const FaultEvent fault = doubled_node(in)) return fault;
  if (const FaultEvent fault = silent_node(After::kAnything)) return fault;
  if (const FaultEvent fault = unfit_node(in, false)) return fault;
  return sensor_fault(in, After::kAnything);
}

void FaultMonitor::loop_faults(const LoopErrors& errors, double dt_s, FaultList& found) noexcept {
  const SupervisorParameters& p = limits_;
  const auto tell = [&found](const FaultEvent& event) { found.add(event); };
  if (lasts(errors.unbalanced_N > stance_.max_unbalanced_N, unbalanced_time_s_, dt_s, stance_.unbalanced_time_s)) {
    tell({FaultCode::kUnbalanced, errors.unbalanced_limb, 0, errors.unbalanced_N, stance_.max_unbalanced_N});
  }
  if (errors.late_s > p.max_late_s) tell({FaultCode::kCycleLate, -1, 0, errors.late_s, p.max_late_s});
  if (errors.waited_s > p.event_timeout_s) {
    tell({FaultCode::kEventTimeout, errors.waiting_limb, 0, errors.waited_s, p.event_timeout_s});
  }
  if (errors.rise_waited_s > p.event_timeout_s) {
    tell({FaultCode::kStandsNoFurther, -1, 0, errors.below_m, p.event_timeout_s});
  }
  if (lasts(errors.body_error_m > p.max_body_error_m, body_error_time_s_, dt_s, p.persistence_s)) {
    tell({FaultCode::kBodyError, -1, 0, errors.body_error_m, p.max_body_error_m});
  }
  if (const DriftWatch::Told& drift = errors.drift; drift.limb >= 0) {
    health_.gives_way[drift.limb] = true;
    const int node = drift.joint < 0 ? can_.nodes.gripper : can_.nodes.joints[drift.joint];
    tell({drift.joint < 0 ? FaultCode::kHoldCreeps : FaultCode::kEncoderDrifts, drift.limb, node, drift.moved,
          drift.within_s});
  }
  for (int l = 0; l < kLimbs; ++l) {
    if (lasts(errors.tracking_error_rad[l] > p.max_tracking_error_rad, tracking_error_time_s_[l], dt_s,
              p.persistence_s)) {
      tell({FaultCode::kTrackingError, l, can_.nodes.joints[errors.worst_joint[l]], errors.tracking_error_rad[l],
            p.max_tracking_error_rad});
    }
    const bool lost = errors.must_grip[l] && errors.finger_force_N[l] < p.min_stance_force_N;
    // Where opening and force of the fingers say the same, a moment is enough.
    const bool gone =
        lasts(errors.must_grip[l] && errors.closes_on_nothing[l], hold_gone_time_s_[l], dt_s, kHoldGone_s);
    if (lasts(lost, grip_error_time_s_[l], dt_s, p.persistence_s) || gone) {
      health_.hold_lost[l] = true;
      tell({FaultCode::kGripLost, l, can_.nodes.gripper, errors.finger_force_N[l],
            std::max(p.min_stance_force_N, errors.closes_on_nothing[l] ? errors.least_force_N[l] : 0.0)});
    }
    if (lasts(errors.must_press[l] && errors.foot_N[l] < p.min_stance_force_N, foot_error_time_s_[l], dt_s,
              p.persistence_s)) {
      health_.hold_lost[l] = true;
      tell({FaultCode::kFootLost, l, 0, errors.foot_N[l], p.min_stance_force_N});
    }
    if (lasts(errors.finds_no_hold[l], no_hold_time_s_[l], dt_s, p.persistence_s))
      tell({FaultCode::kHoldMissing, l, can_.nodes.gripper, errors.opening_m[l], errors.hold_m[l]});
    if (errors.grasp_failed[l])
      tell({FaultCode::kGraspFailed, l, can_.nodes.gripper, errors.gave_way_m, errors.gave_way_limit_m});
    if (lasts(errors.misfit_m[l] > stance_.max_misfit_m, misfit_time_s_[l], dt_s, p.persistence_s)) {
      // A gripper that has slipped, and is off along its faces alone, has slid there.
      const bool slid = errors.slid_m[l] > 0.0 && errors.misfit_off_faces_m[l] <= stance_.max_misfit_m;
      tell({slid ? FaultCode::kSlip : FaultCode::kStanceMisfit, l, slid ? can_.nodes.gripper : 0, errors.misfit_m[l],
            stance_.max_misfit_m});
    }
    // A hold that is gone lets its gripper slide as well; it is told as gone before this lasts.
    if (lasts(errors.slips_on[l], slip_time_s_[l], dt_s, p.persistence_s))
      tell({FaultCode::kSlip, l, can_.nodes.gripper, errors.slid_m[l], stance_.max_slip_m});
    // A sensor is told of once: a plan that an operator has it climb all the same goes on without it.
    if (lasts(errors.finger_residual_N[l] > p.max_finger_residual_N, finger_residual_time_s_[l], dt_s,
              kFingerResidual_s) &&
        !std::exchange(health_.finger_force_distrusted[l], true)) {
      tell({FaultCode::kFingerForceImplausible, l, can_.nodes.gripper, errors.finger_residual_N[l],
            p.max_finger_residual_N});
    }
    const bool frozen = errors.ft_frozen_Nm[l] > p.max_ft_residual_Nm;
    const double unexplained_Nm = frozen ? errors.ft_frozen_Nm[l] : errors.ft_residual_Nm[l];
    const double explained_Nm = frozen ? p.max_ft_residual_Nm : errors.ft_limit_Nm[l];
    if (lasts(unexplained_Nm > explained_Nm, ft_residual_time_s_[l], dt_s, kFtResidual_s) &&
        !std::exchange(health_.force_torque_distrusted[l], true)) {
      tell({FaultCode::kFtImplausible, l, can_.nodes.gripper, unexplained_Nm, explained_Nm});
    }
    if (lasts(errors.ik_error_m[l] > p.max_ik_error_m, ik_error_time_s_[l], dt_s, p.persistence_s)) {
      tell({FaultCode::kIkFailed, l, 0, errors.ik_error_m[l], p.max_ik_error_m});
    }
  }
}

void FaultMonitor::forgive() noexcept {
  health_ = {};
  supply_ = {};
}

}  // namespace crux
