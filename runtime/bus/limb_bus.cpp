#include "bus/limb_bus.hpp"

#include <algorithm>
#include <string>

#include "bus/bus.hpp"
#include "core/robot/node_protocol.hpp"
#include "crux_can.h"
#include "crux_msgs/status_t.hpp"

namespace crux {

namespace {

/// Frames of which a node sends one for each Sync.
bool answers_sync(FrameKind kind) {
  return kind == FrameKind::kJointStatus || kind == FrameKind::kGripperStatus || kind == FrameKind::kForceTorque ||
         kind == FrameKind::kGripperAnswer;
}

}  // namespace

LimbBus::LimbBus(int limb, const RobotDescription& robot, CommandFrames frames)
    : limb_(limb),
      driven_(static_cast<std::size_t>(robot.limbs[limb].driven)),
      nodes_(1U << CRUX_CAN_NODE_GRIPPER),
      command_frames_(frames),
      silent_cycles_(robot.supervisor.silent_cycles) {
  constexpr std::size_t kHashDigits = 8;  // of robot_hash() in Identity.ParameterHash
  parameter_hash_ = static_cast<std::uint32_t>(std::stoul(robot.sha256.substr(0, kHashDigits), nullptr, 16));
  if (robot.can.nodes.gripper != static_cast<int>(CRUX_CAN_NODE_GRIPPER))
    throw BusError("robot '" + robot.name + "': can.nodes.gripper is " + std::to_string(robot.can.nodes.gripper) +
                   ", the CAN database has the gripper at node " + std::to_string(CRUX_CAN_NODE_GRIPPER));
  if (frames == CommandFrames::kBroadcast) check_broadcast_joints(robot, driven_);
  joint_of_node_.fill(-1);
  silence_.fill(silent_cycles_ + 1);  // until they are heard
  streams_.fill(StreamWatch(silent_cycles_));
  for (std::size_t joint = 0; joint < driven_; ++joint) {
    const int node = robot.can.nodes.joints[joint];
    if (node < 1 || node > static_cast<int>(CRUX_CAN_NODES) || node == static_cast<int>(CRUX_CAN_NODE_GRIPPER) ||
        joint_of_node_[static_cast<std::size_t>(node)] >= 0)
      throw BusError("robot '" + robot.name + "': can.nodes gives joint " + std::to_string(joint + 1) + " node " +
                     std::to_string(node) + ", right are the nodes 1 to " + std::to_string(CRUX_CAN_NODES) +
                     " but the gripper's, each once");
    node_of_joint_[joint] = static_cast<std::uint8_t>(node);
    joint_of_node_[static_cast<std::size_t>(node)] = static_cast<int>(joint);
    nodes_ |= 1U << static_cast<unsigned>(node);
    kp_Nm_rad_[joint] = static_cast<float>(robot.servo.position_gain_Nm_rad[joint]);
    kd_Nms_rad_[joint] = static_cast<float>(robot.servo.velocity_gain_Nms_rad[joint]);
    if (frames == CommandFrames::kBroadcast) check_broadcast_gains(robot, joint);
  }
}

Frame& LimbBus::next(std::uint32_t id, std::uint8_t length) noexcept {
  Frame& frame = frames_[n_frames_++];
  frame.id = id;
  frame.length = length;
  return frame;
}

void LimbBus::protect(Frame& frame) noexcept {
  crux_e2e_protect(frame.id, ++send_counters_[frame.id], frame.data.data(), frame.length);
}

bool LimbBus::trusted(const Frame& frame, const FrameMeaning& meaning) noexcept {
  if (frame.extended || frame.remote || frame.length != meaning.length) {
    ++statistics_.wrong_size;
    return false;
  }
  if (answers_sync(meaning.kind)) return trusted_answer(frame, meaning);
  switch (crux_e2e_check(frame.id, frame.data.data(), frame.length, &receivers_[frame.id])) {
    case CRUX_E2E_OK:
      break;
    case CRUX_E2E_LOST:
      ++statistics_.lost;
      break;
    case CRUX_E2E_REPEATED:
      // A node that has restarted counts anew: what it says first looks like what it said first in its life before.
      if (meaning.kind == FrameKind::kIdentity || meaning.kind == FrameKind::kEmergency) break;
      ++statistics_.repeated;
      return false;
    case CRUX_E2E_CORRUPT:
      ++statistics_.crc_errors;
      return false;
  }
  if (wrong_[meaning.node].node != 0 && meaning.kind != FrameKind::kIdentity) ++statistics_.distrusted;
  return true;
}

/// A node answers a Sync once. Who shows to be two is not believed until nothing has shown it for silent_cycles.
bool LimbBus::trusted_answer(const Frame& frame, const FrameMeaning& meaning) noexcept {
  const std::uint8_t node = meaning.node;
  crux_e2e_receiver any{};
  if (crux_e2e_check(frame.id, frame.data.data(), frame.length, &any) == CRUX_E2E_CORRUPT) {
    ++statistics_.crc_errors;
    return false;
  }
  const std::size_t stream = meaning.kind == FrameKind::kForceTorque     ? kWrenchStream
                             : meaning.kind == FrameKind::kGripperAnswer ? kAnswerStream
                                                                         : node;
  believed_ = false;
  switch (streams_[stream].judge(frame)) {
    case StreamWatch::Verdict::kTwice:
      ++statistics_.repeated;
      return false;
    case StreamWatch::Verdict::kGap:
      ++statistics_.lost;
      believed_ = true;
      break;
    case StreamWatch::Verdict::kNext:
      believed_ = true;
      break;
    case StreamWatch::Verdict::kJumped:
      break;
    case StreamWatch::Verdict::kResumed:
      identified_nodes_ &= ~(1U << node);  // it says again who it is
      break;
    case StreamWatch::Verdict::kRival:
      ++statistics_.rivals;
      disputed_[node] = silent_cycles_;
      fresh_ &= ~(1U << node);
      if (node == CRUX_CAN_NODE_GRIPPER) fresh_ &= ~(1U << kForceTorqueBit);
      break;
  }
  if (wrong_[node].node != 0) ++statistics_.distrusted;
  return true;
}

/// The node has restarted, or is another one: its counters begin anew.
void LimbBus::start_anew(std::uint8_t node) noexcept {
  streams_[node].forget();
  if (node != CRUX_CAN_NODE_GRIPPER) return;
  streams_[kWrenchStream].forget();
  streams_[kAnswerStream].forget();
}

void LimbBus::age_streams() noexcept {
  for (StreamWatch& stream : streams_) stream.tick();
  for (int& cycles : disputed_) cycles = std::max(cycles - 1, 0);
}

bool LimbBus::take(const Frame& frame, NodeNotice& notice) noexcept {
  if (frame.id >= kStandardIds) {
    ++statistics_.unknown;
    return false;
  }
  const FrameMeaning& meaning = kFrameMeanings[frame.id];
  if (meaning.kind == FrameKind::kFromHost) {
    take_from_host(frame);
    return false;
  }
  if (meaning.kind == FrameKind::kUnknown) {
    ++statistics_.unknown;
    return false;
  }
  if (!trusted(frame, meaning)) return false;
  switch (meaning.kind) {
    case FrameKind::kJointStatus:
      answer_stamp_ns_ = std::max(answer_stamp_ns_, frame.stamp_ns);
      take_joint_status(frame, meaning.node);
      return false;
    case FrameKind::kGripperStatus:
      answer_stamp_ns_ = std::max(answer_stamp_ns_, frame.stamp_ns);
      take_gripper_status(frame);
      return false;
    case FrameKind::kForceTorque:
      answer_stamp_ns_ = std::max(answer_stamp_ns_, frame.stamp_ns);
      take_force_torque(frame);
      return false;
    case FrameKind::kGripperAnswer:
      answer_stamp_ns_ = std::max(answer_stamp_ns_, frame.stamp_ns);
      take_gripper_answer(frame);
      return false;
    case FrameKind::kHeartbeat:
      ++statistics_.heartbeats;
      return false;
    case FrameKind::kIdentity:
      ++statistics_.identities;
      return take_identity(frame, meaning.node, notice);
    case FrameKind::kEmergency: {
      ++statistics_.emergencies;
      crux_can_joint_emergency_t emergency{};  // the gripper's has the same layout
      crux_can_joint_emergency_unpack(&emergency, frame.data.data(), frame.length);
      if (wrong_[meaning.node].node != 0) return false;
      if (emergency.cause == CRUX_CAN_JOINT_EMERGENCY_CAUSE_RESTARTED_CHOICE) {
        restarted_ |= 1U << meaning.node;
        start_anew(meaning.node);
        identified_nodes_ &=
            ~(1U << meaning.node) | introduced_;  // it introduces itself first; where that was lost: ask
      }
      notice = {NodeNotice::Kind::kEmergency, static_cast<std::int8_t>(limb_), meaning.node, emergency.cause,
                emergency.detail};
      return true;
    }
    case FrameKind::kUnknown:
    case FrameKind::kFromHost:
      break;
  }
  return false;
}

bool LimbBus::is_echo(const Frame& frame) const noexcept {
  const std::span<const Frame> sent(frames_.data(), n_frames_);
  return frame.own || std::ranges::any_of(sent, [&](const Frame& own) {
           return own.id == frame.id && std::ranges::equal(own.payload(), frame.payload());
         });
}

/// One that is no echo was sent by another host.
void LimbBus::take_from_host(const Frame& frame) noexcept {
  if (!is_echo(frame)) {
    ++statistics_.foreign;
    foreign_host_ = true;
  } else if (frame.id == CRUX_CAN_ID_SYNC || frame.id == CRUX_CAN_ID_BROADCAST) {
    sync_stamp_ns_ = frame.stamp_ns;
  }
}

/// Whoever answers keeps the cycle going; what he says counts once he has said who he is.
bool LimbBus::accept_answer(std::uint32_t bit, std::uint8_t node, std::uint16_t cycle_echo) noexcept {
  const bool known = believed_ && disputed_[node] == 0 && (identified_nodes_ >> node & 1U) != 0;
  const std::uint32_t mask = 1U << bit;
  if (cycle_echo != awaited_cycle_) {
    ++statistics_.late;
    return known && (fresh_ & mask) == 0;  // older than wanted, yet newer than what is known
  }
  answered_ |= mask;
  if (!known || (fresh_ & mask) != 0) return false;  // of several answers to a repeated Sync(0) the first one counts
  fresh_ |= mask;
  return true;
}

void LimbBus::take_joint_status(const Frame& frame, std::uint8_t node) noexcept {
  const int joint = joint_of_node_[node];
  if (joint < 0) return;
  crux_can_joint_status_t status{};
  crux_can_joint_status_unpack(&status, frame.data.data(), frame.length);
  if (!accept_answer(node, node, status.cycle_echo)) return;
  JointValues& values = joints_[static_cast<std::size_t>(joint)];
  values.state = static_cast<std::int8_t>(status.state);
  values.faults = status.faults;
  values.position_rad = static_cast<double>(status.position_rad);
  values.velocity_rad_s = static_cast<double>(crux_can_joint_status_velocity_rad_s_decode(status.velocity_rad_s));
  values.torque_Nm = static_cast<double>(crux_can_joint_status_torque_nm_decode(status.torque_nm));
}

void LimbBus::take_gripper_status(const Frame& frame) noexcept {
  crux_can_gripper_status_t status{};
  crux_can_gripper_status_unpack(&status, frame.data.data(), frame.length);
  if (!accept_answer(CRUX_CAN_NODE_GRIPPER, CRUX_CAN_NODE_GRIPPER, status.cycle_echo)) return;
  gripper_.state = static_cast<std::int8_t>(status.state);
  gripper_.faults = status.faults;
  gripper_.opening_m = static_cast<double>(status.opening_m);
  gripper_.speed_m_s = static_cast<double>(crux_can_gripper_status_speed_m_s_decode(status.speed_m_s));
  gripper_.force_N = static_cast<double>(crux_can_gripper_status_force_n_decode(status.force_n));
}

void LimbBus::take_force_torque(const Frame& frame) noexcept {
  crux_can_force_torque_t sample{};
  crux_can_force_torque_unpack(&sample, frame.data.data(), frame.length);
  if (!accept_answer(kForceTorqueBit, CRUX_CAN_NODE_GRIPPER, sample.cycle_echo)) return;
  force_torque_.status = sample.status;
  force_torque_.force_N = {static_cast<double>(crux_can_force_torque_force_x_n_decode(sample.force_x_n)),
                           static_cast<double>(crux_can_force_torque_force_y_n_decode(sample.force_y_n)),
                           static_cast<double>(crux_can_force_torque_force_z_n_decode(sample.force_z_n))};
  force_torque_.moment_Nm = {static_cast<double>(crux_can_force_torque_moment_x_nm_decode(sample.moment_x_nm)),
                             static_cast<double>(crux_can_force_torque_moment_y_nm_decode(sample.moment_y_nm)),
                             static_cast<double>(crux_can_force_torque_moment_z_nm_decode(sample.moment_z_nm))};
}

void LimbBus::take_gripper_answer(const Frame& frame) noexcept {
  crux_can_gripper_answer_t answer{};
  crux_can_gripper_answer_unpack(&answer, frame.data.data(), frame.length);
  const bool status_counts = accept_answer(CRUX_CAN_NODE_GRIPPER, CRUX_CAN_NODE_GRIPPER, answer.cycle_echo);
  const bool wrench_counts = accept_answer(kForceTorqueBit, CRUX_CAN_NODE_GRIPPER, answer.cycle_echo);
  if (!status_counts && !wrench_counts) return;
  gripper_.state = static_cast<std::int8_t>(answer.state);
  gripper_.faults = answer.faults;
  gripper_.opening_m = static_cast<double>(answer.opening_m);
  gripper_.speed_m_s = static_cast<double>(crux_can_gripper_answer_speed_m_s_decode(answer.speed_m_s));
  gripper_.force_N = static_cast<double>(crux_can_gripper_answer_force_n_decode(answer.force_n));
  force_torque_.status = answer.wrench_status;
  force_torque_.force_N = {static_cast<double>(crux_can_gripper_answer_force_x_n_decode(answer.force_x_n)),
                           static_cast<double>(crux_can_gripper_answer_force_y_n_decode(answer.force_y_n)),
                           static_cast<double>(crux_can_gripper_answer_force_z_n_decode(answer.force_z_n))};
  force_torque_.moment_Nm = {static_cast<double>(crux_can_gripper_answer_moment_x_nm_decode(answer.moment_x_nm)),
                             static_cast<double>(crux_can_gripper_answer_moment_y_nm_decode(answer.moment_y_nm)),
                             static_cast<double>(crux_can_gripper_answer_moment_z_nm_decode(answer.moment_z_nm))};
}

bool LimbBus::take_identity(const Frame& frame, std::uint8_t node, NodeNotice& notice) noexcept {
  crux_can_joint_identity_t identity{};  // the gripper's has the same layout
  crux_can_joint_identity_unpack(&identity, frame.data.data(), frame.length);
  silence_[node] = 0;
  notice = {
      .limb = static_cast<std::int8_t>(limb_), .node = node, .cause = identity.limb, .detail = identity.parameter_hash};
  if (identity.protocol != CRUX_CAN_PROTOCOL_VERSION) {
    notice.kind = NodeNotice::Kind::kWrongProtocol;
    notice.cause = identity.protocol;
  } else if (identity.node_id != node || identity.limb != limb_) {
    notice.kind = NodeNotice::Kind::kWrongPlace;
  } else if (identity.parameter_hash != parameter_hash_) {
    notice.kind = NodeNotice::Kind::kWrongParameters;
  } else {
    identified_nodes_ |= 1U << node;
    introduced_ |= 1U << node;
    wrong_[node] = {};
    return false;
  }
  identified_nodes_ &= ~(1U << node);
  const NodeNotice& told = wrong_[node];
  const bool news =
      told.node == 0 || told.kind != notice.kind || told.cause != notice.cause || told.detail != notice.detail;
  wrong_[node] = notice;
  return news;
}

/// A cable may have been plugged in elsewhere while nobody heard the node.
void LimbBus::forget_silent_nodes() noexcept {
  for (std::uint8_t node = 1; node <= CRUX_CAN_NODES; ++node) {
    if ((answered_ >> node & 1U) != 0) {
      silence_[node] = 0;
    } else if (silence_[node] <= silent_cycles_ && ++silence_[node] > silent_cycles_) {
      identified_nodes_ &= ~(1U << node);
    }
  }
}

std::int8_t LimbBus::node_state(std::uint8_t node) const noexcept {
  using crux_msgs::status_t;
  if ((nodes_ >> node & 1U) == 0) return status_t::WELL;
  if (silence_[node] > silent_cycles_ && (answered_ >> node & 1U) == 0) return status_t::SILENT;
  if ((identified_nodes_ >> node & 1U) != 0) return status_t::WELL;
  if (wrong_[node].node == 0) return status_t::UNIDENTIFIED;
  switch (wrong_[node].kind) {
    case NodeNotice::Kind::kWrongProtocol:
      return status_t::WRONG_PROTOCOL;
    case NodeNotice::Kind::kWrongPlace:
      return status_t::WRONG_PLACE;
    default:
      return status_t::WRONG_ROBOT;
  }
}

std::vector<int> LimbBus::silent_nodes() const {
  std::vector<int> nodes;
  for (int node = 1; node <= static_cast<int>(CRUX_CAN_NODES); ++node) {
    const bool force_torque_missing =
        node == static_cast<int>(CRUX_CAN_NODE_GRIPPER) && (answered_ >> kForceTorqueBit & 1U) == 0;
    if ((nodes_ >> node & 1U) == 0) continue;
    if ((answered_ >> node & 1U) == 0 || force_torque_missing) nodes.push_back(node);
  }
  return nodes;
}

void LimbBus::fill(crux_msgs::control_input_t& input) const noexcept {
  const auto fresh = [this](std::uint32_t bit) { return static_cast<std::int8_t>(fresh_ >> bit & 1U); };
  const auto state_of = [this](std::uint32_t node, std::int8_t said) {
    return (restarted_ >> node & 1U) != 0 ? static_cast<std::int8_t>(NodeState::kBoot) : said;
  };
  const auto faults_of = [this](std::uint32_t node, int said) {
    return static_cast<std::int16_t>(disputed_[node] > 0 ? said | kFaultTwoSenders : said);
  };
  for (std::size_t slot = 0; slot < CRUX_CAN_JOINTS; ++slot) {
    const std::size_t i = static_cast<std::size_t>(limb_) * CRUX_CAN_JOINTS + slot;
    const std::size_t joint = std::min(slot, driven_ - 1);  // a slot without a joint is as well as the last one is
    const JointValues& values = joints_[joint];
    input.joint_fresh[i] = fresh(node_of_joint_[joint]);
    input.joint_state[i] = state_of(node_of_joint_[joint], values.state);
    input.joint_faults[i] = faults_of(node_of_joint_[joint], values.faults);
    const double there = slot < driven_ ? 1.0 : 0.0;
    input.joint_position_rad[i] = there * values.position_rad;
    input.joint_velocity_rad_s[i] = there * values.velocity_rad_s;
    input.joint_torque_nm[i] = there * values.torque_Nm;
  }
  input.gripper_fresh[limb_] = fresh(CRUX_CAN_NODE_GRIPPER);
  input.gripper_state[limb_] = state_of(CRUX_CAN_NODE_GRIPPER, gripper_.state);
  input.gripper_faults[limb_] = faults_of(CRUX_CAN_NODE_GRIPPER, gripper_.faults);
  input.finger_opening_m[limb_] = gripper_.opening_m;
  input.finger_speed_m_s[limb_] = gripper_.speed_m_s;
  input.finger_force_n[limb_] = gripper_.force_N;
  input.ft_fresh[limb_] = fresh(kForceTorqueBit);
  input.ft_status[limb_] = force_torque_.status;
  for (int axis = 0; axis < 3; ++axis) {
    input.ft_force_g_n[3 * limb_ + axis] = force_torque_.force_N[static_cast<std::size_t>(axis)];
    input.ft_moment_g_nm[3 * limb_ + axis] = force_torque_.moment_Nm[static_cast<std::size_t>(axis)];
  }
}

}  // namespace crux
