// Which CAN identifier means what: a table of all 2048 standard identifiers, made from the generated constants.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "crux_can_ids.h"

namespace crux {

enum class FrameKind : std::uint8_t {
  kUnknown,
  kFromHost,  ///< sent by the runtime alone; heard again on a bus that echoes
  kJointStatus,
  kGripperStatus,
  kForceTorque,
  kGripperAnswer,  ///< gripper status and wrench in one frame
  kEmergency,
  kHeartbeat,
  kIdentity,
};

struct FrameMeaning {
  FrameKind kind = FrameKind::kUnknown;
  std::uint8_t node = 0;    ///< 1 .. CRUX_CAN_NODES, 0: the host
  std::uint8_t length = 0;  ///< payload bytes
};

inline constexpr std::size_t kStandardIds = 0x800;

constexpr std::array<FrameMeaning, kStandardIds> make_frame_meanings() {
  std::array<FrameMeaning, kStandardIds> table{};
  table[CRUX_CAN_ID_SYNC] = {FrameKind::kFromHost, 0, CRUX_CAN_LENGTH_SYNC};
  table[CRUX_CAN_ID_BROADCAST] = {FrameKind::kFromHost, 0, CRUX_CAN_LENGTH_BROADCAST};
  table[CRUX_CAN_ID_HOST_HEARTBEAT] = {FrameKind::kFromHost, 0, CRUX_CAN_LENGTH_HOST_HEARTBEAT};
  for (std::uint8_t node = 1; node <= CRUX_CAN_NODES; ++node) {
    if (node == CRUX_CAN_NODE_GRIPPER) continue;
    table[CRUX_CAN_ID_JOINT_COMMAND(node)] = {FrameKind::kFromHost, node, CRUX_CAN_LENGTH_JOINT_COMMAND};
    table[CRUX_CAN_ID_JOINT_STATUS(node)] = {FrameKind::kJointStatus, node, CRUX_CAN_LENGTH_JOINT_STATUS};
    table[CRUX_CAN_ID_JOINT_EMERGENCY(node)] = {FrameKind::kEmergency, node, CRUX_CAN_LENGTH_JOINT_EMERGENCY};
    table[CRUX_CAN_ID_JOINT_HEARTBEAT(node)] = {FrameKind::kHeartbeat, node, CRUX_CAN_LENGTH_JOINT_HEARTBEAT};
    table[CRUX_CAN_ID_JOINT_IDENTITY(node)] = {FrameKind::kIdentity, node, CRUX_CAN_LENGTH_JOINT_IDENTITY};
  }
  constexpr std::uint8_t kGripper = CRUX_CAN_NODE_GRIPPER;
  table[CRUX_CAN_ID_GRIPPER_COMMAND] = {FrameKind::kFromHost, kGripper, CRUX_CAN_LENGTH_GRIPPER_COMMAND};
  table[CRUX_CAN_ID_GRIPPER_STATUS] = {FrameKind::kGripperStatus, kGripper, CRUX_CAN_LENGTH_GRIPPER_STATUS};
  table[CRUX_CAN_ID_GRIPPER_ANSWER] = {FrameKind::kGripperAnswer, kGripper, CRUX_CAN_LENGTH_GRIPPER_ANSWER};
  table[CRUX_CAN_ID_FORCE_TORQUE] = {FrameKind::kForceTorque, kGripper, CRUX_CAN_LENGTH_FORCE_TORQUE};
  table[CRUX_CAN_ID_GRIPPER_EMERGENCY] = {FrameKind::kEmergency, kGripper, CRUX_CAN_LENGTH_GRIPPER_EMERGENCY};
  table[CRUX_CAN_ID_GRIPPER_HEARTBEAT] = {FrameKind::kHeartbeat, kGripper, CRUX_CAN_LENGTH_GRIPPER_HEARTBEAT};
  table[CRUX_CAN_ID_GRIPPER_IDENTITY] = {FrameKind::kIdentity, kGripper, CRUX_CAN_LENGTH_GRIPPER_IDENTITY};
  return table;
}

inline constexpr std::array<FrameMeaning, kStandardIds> kFrameMeanings = make_frame_meanings();

}  // namespace crux
