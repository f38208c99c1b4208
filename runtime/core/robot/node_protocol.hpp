// The node enumerations of msgs/can/crux.dbc in the core's own types.
#pragma once

#include <crux_can_ids.h>

#include <cstdint>

namespace crux {

enum class NodeMode : std::int8_t {
  kHold = CRUX_CAN_JOINT_COMMAND_MODE_HOLD_CHOICE,
  kTrack = CRUX_CAN_JOINT_COMMAND_MODE_TRACK_CHOICE,
  kRearm = CRUX_CAN_JOINT_COMMAND_MODE_REARM_CHOICE,
};

enum class NodeState : std::int8_t {
  kBoot = CRUX_CAN_JOINT_STATUS_STATE_BOOT_CHOICE,
  kHold = CRUX_CAN_JOINT_STATUS_STATE_HOLD_CHOICE,
  kTrack = CRUX_CAN_JOINT_STATUS_STATE_TRACK_CHOICE,
  kDecelerate = CRUX_CAN_JOINT_STATUS_STATE_DECELERATE_CHOICE,
  kFault = CRUX_CAN_JOINT_STATUS_STATE_FAULT_CHOICE,
};

/// Bit of a status' Faults that stands for an emergency cause.
constexpr int fault_bit(unsigned cause) { return static_cast<int>(CRUX_CAN_FAULT_BIT(cause)); }

/// The watchdog latched a hold; REARM clears it.
inline constexpr int kFaultCommandTimeout = fault_bit(CRUX_CAN_JOINT_EMERGENCY_CAUSE_COMMAND_TIMEOUT_CHOICE);
/// What makes a node unfit to go on. (Clamped commands are the node's protection, not a defect of it.)
inline constexpr int kFaultsUnfit = fault_bit(CRUX_CAN_JOINT_EMERGENCY_CAUSE_OVER_TEMPERATURE_CHOICE) |
                                    fault_bit(CRUX_CAN_JOINT_EMERGENCY_CAUSE_BUS_OFF_CHOICE) |
                                    fault_bit(CRUX_CAN_JOINT_EMERGENCY_CAUSE_DRIVER_CHOICE) |
                                    fault_bit(CRUX_CAN_JOINT_EMERGENCY_CAUSE_THERMOMETER_CHOICE) |
                                    fault_bit(CRUX_CAN_JOINT_EMERGENCY_CAUSE_NOT_CALIBRATED_CHOICE);

/// Beyond the bits of a status: the runtime's bus has heard two senders under the node's number, and believes neither.
inline constexpr int kFaultTwoSenders = 0x100;

// ForceTorque.Status
inline constexpr int kFtOverload = 1;
inline constexpr int kFtNotReady = 2;

}  // namespace crux
