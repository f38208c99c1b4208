// What a limb's nodes are told: the sending half of LimbBus.
#include <algorithm>
#include <limits>
#include <string>

#include "bus/bus.hpp"
#include "bus/limb_bus.hpp"
#include "crux_can.h"

namespace crux {

void check_broadcast_joints(const RobotDescription& robot, std::size_t joints) {
  if (joints > CRUX_CAN_BROADCAST_JOINTS)
    throw BusError("robot '" + robot.name + "' has " + std::to_string(joints) +
                   " joints a limb, a broadcast has room for " + std::to_string(CRUX_CAN_BROADCAST_JOINTS) +
                   ": use --commands each");
}

/// A broadcast has 8 bits for a gain: none may be cut off, and none that holds the joint may become zero.
void check_broadcast_gains(const RobotDescription& robot, std::size_t joint) {
  const double kp = robot.servo.position_gain_Nm_rad[joint], kd = robot.servo.velocity_gain_Nms_rad[joint];
  constexpr std::uint8_t kLargest = std::numeric_limits<std::uint8_t>::max();
  const double least_kp = static_cast<double>(crux_can_broadcast_joint_kp_nm_rad_decode(1));
  const double most_kp = static_cast<double>(crux_can_broadcast_joint_kp_nm_rad_decode(kLargest));
  const double most_kd = static_cast<double>(crux_can_broadcast_joint_kd_nms_rad_decode(kLargest));
  const auto refuse = [&](const char* key, double value, double low, double high) {
    if (value < low || value > high)
      throw BusError("robot '" + robot.name + "': servo." + key + " of joint " + std::to_string(joint + 1) + " is " +
                     std::to_string(value) + ", a broadcast carries " + std::to_string(low) + " to " +
                     std::to_string(high));
  };
  refuse("position_gain_Nm_rad", kp, least_kp, most_kp);
  refuse("velocity_gain_Nms_rad", kd, 0.0, most_kd);
}

void LimbBus::add_sync(std::uint32_t cycle) noexcept {
  Frame& frame = next(CRUX_CAN_ID_SYNC, CRUX_CAN_LENGTH_SYNC);
  crux_can_sync_t sync{};
  sync.cycle = cycle;
  crux_can_sync_pack(frame.data.data(), &sync, frame.length);
  protect(frame);
}

void LimbBus::add_heartbeat(const HostHeartbeat& heartbeat) noexcept {
  Frame& frame = next(CRUX_CAN_ID_HOST_HEARTBEAT, CRUX_CAN_LENGTH_HOST_HEARTBEAT);
  crux_can_host_heartbeat_t message{};
  message.host_state = heartbeat.state;
  message.uptime_ms = heartbeat.uptime_ms;
  for (std::size_t n = 0; n < CRUX_CAN_NODES && message.identify == 0 && !identified(); ++n) {
    asked_node_ = static_cast<std::uint8_t>(asked_node_ % CRUX_CAN_NODES + 1);
    if ((nodes_ & ~identified_nodes_) >> asked_node_ & 1U)
      message.identify = std::min<std::uint8_t>(asked_node_, CRUX_CAN_NODE_GRIPPER);  // node 8 answers with it
  }
  crux_can_host_heartbeat_pack(frame.data.data(), &message, frame.length);
  protect(frame);
}

std::span<const Frame> LimbBus::pack_wake_up() noexcept {
  n_frames_ = 0;
  add_sync(0);
  return {frames_.data(), n_frames_};
}

void LimbBus::add_commands(const crux_msgs::control_output_t& output) noexcept {
  for (std::size_t joint = 0; joint < driven_; ++joint) {
    const std::size_t i = static_cast<std::size_t>(limb_) * CRUX_CAN_JOINTS + joint;
    Frame& frame = next(CRUX_CAN_ID_JOINT_COMMAND(node_of_joint_[joint]), CRUX_CAN_LENGTH_JOINT_COMMAND);
    crux_can_joint_command_t command{};
    command.mode = static_cast<std::uint8_t>(output.joint_mode[i]);
    command.position_rad = static_cast<float>(output.joint_position_rad[i]);
    command.velocity_rad_s =
        crux_can_joint_command_velocity_rad_s_encode_clipped(static_cast<float>(output.joint_velocity_rad_s[i]));
    command.torque_nm = crux_can_joint_command_torque_nm_encode_clipped(static_cast<float>(output.joint_torque_nm[i]));
    command.kp_nm_rad = crux_can_joint_command_kp_nm_rad_encode_clipped(kp_Nm_rad_[joint]);
    command.kd_nms_rad = crux_can_joint_command_kd_nms_rad_encode_clipped(kd_Nms_rad_[joint]);
    crux_can_joint_command_pack(frame.data.data(), &command, frame.length);
    protect(frame);
  }
  Frame& frame = next(CRUX_CAN_ID_GRIPPER_COMMAND, CRUX_CAN_LENGTH_GRIPPER_COMMAND);
  crux_can_gripper_command_t command{};
  command.mode = static_cast<std::uint8_t>(output.gripper_mode[limb_]);
  command.opening_m = static_cast<float>(output.finger_opening_m[limb_]);
  command.speed_limit_m_s =
      crux_can_gripper_command_speed_limit_m_s_encode_clipped(static_cast<float>(output.finger_speed_limit_m_s[limb_]));
  command.force_limit_n =
      crux_can_gripper_command_force_limit_n_encode_clipped(static_cast<float>(output.finger_force_limit_n[limb_]));
  crux_can_gripper_command_pack(frame.data.data(), &command, frame.length);
  protect(frame);
}

void LimbBus::add_broadcast(const crux_msgs::control_output_t& output, std::uint32_t cycle) noexcept {
  Frame& frame = next(CRUX_CAN_ID_BROADCAST, CRUX_CAN_LENGTH_BROADCAST);
  crux_can_broadcast_header_t header{};
  header.cycle = static_cast<std::uint16_t>(cycle);
  crux_can_broadcast_header_pack(frame.data.data(), &header, CRUX_CAN_LENGTH_BROADCAST_HEADER);
  for (std::size_t joint = 0; joint < driven_; ++joint) {
    const std::size_t i = static_cast<std::size_t>(limb_) * CRUX_CAN_JOINTS + joint;
    crux_can_broadcast_joint_t command{};
    command.mode = static_cast<std::uint8_t>(output.joint_mode[i]);
    command.position_rad =
        crux_can_broadcast_joint_position_rad_encode_clipped(static_cast<float>(output.joint_position_rad[i]));
    command.velocity_rad_s =
        crux_can_broadcast_joint_velocity_rad_s_encode_clipped(static_cast<float>(output.joint_velocity_rad_s[i]));
    command.torque_nm =
        crux_can_broadcast_joint_torque_nm_encode_clipped(static_cast<float>(output.joint_torque_nm[i]));
    command.kp_nm_rad = crux_can_broadcast_joint_kp_nm_rad_encode_clipped(kp_Nm_rad_[joint]);
    command.kd_nms_rad = crux_can_broadcast_joint_kd_nms_rad_encode_clipped(kd_Nms_rad_[joint]);
    const std::size_t first = CRUX_CAN_OFFSET_BROADCAST_JOINT +
                              CRUX_CAN_LENGTH_BROADCAST_JOINT * static_cast<std::size_t>(node_of_joint_[joint] - 1);
    crux_can_broadcast_joint_pack(&frame.data[first], &command, CRUX_CAN_LENGTH_BROADCAST_JOINT);
  }
  crux_can_broadcast_gripper_t command{};
  command.mode = static_cast<std::uint8_t>(output.gripper_mode[limb_]);
  command.opening_m =
      crux_can_broadcast_gripper_opening_m_encode_clipped(static_cast<float>(output.finger_opening_m[limb_]));
  command.speed_limit_m_s = crux_can_broadcast_gripper_speed_limit_m_s_encode_clipped(
      static_cast<float>(output.finger_speed_limit_m_s[limb_]));
  command.force_limit_n =
      crux_can_broadcast_gripper_force_limit_n_encode_clipped(static_cast<float>(output.finger_force_limit_n[limb_]));
  crux_can_broadcast_gripper_pack(&frame.data[CRUX_CAN_OFFSET_BROADCAST_GRIPPER], &command,
                                  CRUX_CAN_LENGTH_BROADCAST_GRIPPER);
  protect(frame);
}

std::span<const Frame> LimbBus::pack_cycle(const crux_msgs::control_output_t& output, std::uint32_t cycle,
                                           const HostHeartbeat* heartbeat) noexcept {
  n_frames_ = 0;
  forget_silent_nodes();
  age_streams();
  if (heartbeat != nullptr) add_heartbeat(*heartbeat);
  if (command_frames_ == CommandFrames::kBroadcast) {
    add_broadcast(output, cycle);
  } else {
    add_commands(output);
    add_sync(cycle);
  }

  awaited_cycle_ = static_cast<std::uint16_t>(cycle);
  answered_ = fresh_ = introduced_ = 0;
  foreign_host_ = false;
  restarted_ = 0;
  sync_stamp_ns_ = answer_stamp_ns_ = 0;
  return {frames_.data(), n_frames_};
}

}  // namespace crux
