#include "lcm/messages.hpp"

#include <array>
#include <bit>
#include <cinttypes>
#include <cstdio>
#include <string>

#include "core/robot/reason.hpp"
#include "crux_can.h"
#include "crux_msgs/faults.hpp"

namespace crux {
namespace {

const char* cause_name(std::uint8_t cause) {
  switch (cause) {
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_COMMAND_TIMEOUT_CHOICE:
      return "no valid command in time, holding";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_E2_E_CRC_CHOICE:
      return "damaged command (CRC)";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_E2_E_COUNTER_CHOICE:
      return "commands out of sequence";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_POSITION_LIMIT_CHOICE:
      return "commanded beyond the position limit";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_VELOCITY_LIMIT_CHOICE:
      return "commanded beyond the velocity limit";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_OVER_TEMPERATURE_CHOICE:
      return "too hot";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_BUS_OFF_CHOICE:
      return "bus off";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_INVALID_COMMAND_CHOICE:
      return "invalid command";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_SENSOR_CHOICE:
      return "sensor lost";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_DRIVER_CHOICE:
      return "the gate driver stopped the bridge";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_THERMOMETER_CHOICE:
      return "the winding's thermometer is open or shorted";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_NOT_CALIBRATED_CHOICE:
      return "the board is not calibrated, its motor is not driven";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_CURRENTS_CHOICE:
      return "the motor's currents do not fit voltage and speed";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_DIRECTION_CHOICE:
      return "the motor turns against its current: phases swapped, or wrong electrical offset";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_DIRECTION_UNCHECKED_CHOICE:
      return "the motor's direction could not be checked, for its shaft is loaded or locked";
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_ENCODER_ERRORS_CHOICE:
      return "samples of the motor's encoder left out";
    default:
      return "unknown cause";
  }
}

/// " (1.50 rad)": the emergency frame's Detail in its unit (msgs/can/README.md); empty where the cause has none.
std::string detail_of(const NodeNotice& notice) {
  const bool gripper = notice.node == CRUX_CAN_NODE_GRIPPER;
  const auto value = std::bit_cast<float>(notice.detail);
  std::array<char, 48> text{};
  switch (notice.cause) {
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_COMMAND_TIMEOUT_CHOICE:
      std::snprintf(text.data(), text.size(), " (silent for %.1f ms)", notice.detail * 1e-3);
      break;
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_POSITION_LIMIT_CHOICE:
      std::snprintf(text.data(), text.size(), " (%.4g %s)", static_cast<double>(value), gripper ? "m" : "rad");
      break;
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_VELOCITY_LIMIT_CHOICE:
      std::snprintf(text.data(), text.size(), " (%.4g %s)", static_cast<double>(value), gripper ? "m/s" : "rad/s");
      break;
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_OVER_TEMPERATURE_CHOICE:
      std::snprintf(text.data(), text.size(), " (%.0f degC)", static_cast<double>(value));
      break;
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_E2_E_CRC_CHOICE:
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_E2_E_COUNTER_CHOICE:
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_INVALID_COMMAND_CHOICE:
    case CRUX_CAN_JOINT_EMERGENCY_CAUSE_ENCODER_ERRORS_CHOICE:
      std::snprintf(text.data(), text.size(), " (%" PRIu32 " so far)", notice.detail);
      break;
    default:
      break;
  }
  return text.data();
}

/// "LF node 3: ".
std::string place(const NodeNotice& notice) { return in_words({"", notice.limb, notice.node}); }

}  // namespace

void print_fault(const crux_msgs::fault_t& fault) {
  const crux_msgs::FaultInfo* info = crux_msgs::fault_info(fault.code);
  const char* text = info != nullptr ? info->text.data() : "unknown fault";
  const Reason event{text, fault.limb, fault.node, fault.value, fault.limit};
  std::fprintf(stderr, "crux-runtime: cycle %" PRId64 ": %s\n", fault.cycle, in_words(event).c_str());
}

void print_reason(const Reason& reason) { std::fprintf(stderr, "crux-runtime: %s\n", in_words(reason).c_str()); }

void print_notice(const NodeNotice& notice) {
  const std::string where = place(notice);
  switch (notice.kind) {
    case NodeNotice::Kind::kEmergency:
      if (notice.cause == CRUX_CAN_JOINT_EMERGENCY_CAUSE_RESTARTED_CHOICE) return;
      std::fprintf(stderr, "crux-runtime: %semergency: %s%s\n", where.c_str(), cause_name(notice.cause),
                   detail_of(notice).c_str());
      return;
    case NodeNotice::Kind::kWrongProtocol:
      std::fprintf(stderr,
                   "crux-runtime: %sspeaks CAN protocol %u, this runtime speaks %u; the node is not listened to\n",
                   where.c_str(), notice.cause, CRUX_CAN_PROTOCOL_VERSION);
      return;
    case NodeNotice::Kind::kWrongPlace:
      std::fprintf(stderr, "crux-runtime: %sthe node takes itself for another one (limb %u); it is not listened to\n",
                   where.c_str(), notice.cause);
      return;
    case NodeNotice::Kind::kWrongParameters:
      std::fprintf(stderr,
                   "crux-runtime: %sthe node was made for another robot description (%08" PRIx32
                   "); it is not listened to\n",
                   where.c_str(), notice.detail);
      return;
  }
}

void print_malformed(crux_msgs::Channel channel, std::size_t bytes, std::uint64_t count) {
  if (!std::has_single_bit(count)) return;
  std::fprintf(stderr, "crux-runtime: LCM %s: %zu bytes that are no such message, ignored (%" PRIu64 " so far)\n",
               crux_msgs::channel_info(channel).name, bytes, count);
}

void print_refused(const std::string& reason, std::uint64_t count) {
  if (!std::has_single_bit(count)) return;
  std::fprintf(stderr, "crux-runtime: refused what came over LCM: %s (%" PRIu64 " refused so far)\n", reason.c_str(),
               count);
}

}  // namespace crux
