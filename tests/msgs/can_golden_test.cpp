// The generated C codec reads and writes the golden CAN frames as Python does.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "crux_can_ids.h"
#include "e2e.h"
#include "golden_vectors.hpp"

namespace {

using Signals = std::map<std::string, double>;
using Bytes = std::vector<std::uint8_t>;

struct Codec {
  Signals (*decode)(const Bytes&);
  Bytes (*encode)(const Signals&);
};

// One codec a kind: unpacks the raw struct, turns every field into its quantity, and back.
#define FIELD_OUT(kind, field, name) signals[name] = static_cast<double>(crux_can_##kind##_##field##_decode(raw.field));
#define FIELD_IN(kind, field, name) \
  raw.field = crux_can_##kind##_##field##_encode(static_cast<float>(signals.at(name)));
#define KIND(kind, length, FIELDS)                                                                     \
  Codec {                                                                                              \
    [](const Bytes& data) {                                                                            \
      crux_can_##kind##_t raw{};                                                                       \
      EXPECT_EQ(crux_can_##kind##_unpack(&raw, data.data(), data.size()), 0);                          \
      Signals signals;                                                                                 \
      FIELDS(FIELD_OUT, kind)                                                                          \
      return signals;                                                                                  \
    },                                                                                                 \
        [](const Signals& signals) {                                                                   \
          crux_can_##kind##_t raw{};                                                                   \
          FIELDS(FIELD_IN, kind)                                                                       \
          Bytes data(length);                                                                          \
          EXPECT_EQ(crux_can_##kind##_pack(data.data(), &raw, data.size()), static_cast<int>(length)); \
          return data;                                                                                 \
        }                                                                                              \
  }

#define SYNC_FIELDS(F, k) F(k, flags, "Flags")
#define HOST_FIELDS(F, k) F(k, host_state, "HostState") F(k, identify, "Identify")
#define EMERGENCY_FIELDS(F, k) F(k, cause, "Cause")
#define HEARTBEAT_FIELDS(F, k) F(k, state, "State")
// One field a line, as in the database; versions of clang-format disagree on the rest.
// clang-format off
#define JOINT_COMMAND_FIELDS(F, k) \
  F(k, mode, "Mode") \
  F(k, position_rad, "Position_rad") \
  F(k, velocity_rad_s, "Velocity_rad_s") \
  F(k, torque_nm, "Torque_Nm") \
  F(k, kp_nm_rad, "Kp_Nm_rad") \
  F(k, kd_nms_rad, "Kd_Nms_rad")
#define JOINT_STATUS_FIELDS(F, k) \
  F(k, state, "State") \
  F(k, position_rad, "Position_rad") \
  F(k, velocity_rad_s, "Velocity_rad_s") \
  F(k, torque_nm, "Torque_Nm") \
  F(k, cycle_echo, "CycleEcho") \
  F(k, faults, "Faults") \
  F(k, temperature_deg_c, "Temperature_degC")
#define GRIPPER_COMMAND_FIELDS(F, k) \
  F(k, mode, "Mode") \
  F(k, opening_m, "Opening_m") \
  F(k, speed_limit_m_s, "SpeedLimit_m_s") \
  F(k, force_limit_n, "ForceLimit_N")
#define GRIPPER_STATUS_FIELDS(F, k) \
  F(k, state, "State") \
  F(k, opening_m, "Opening_m") \
  F(k, speed_m_s, "Speed_m_s") \
  F(k, force_n, "Force_N") \
  F(k, cycle_echo, "CycleEcho") \
  F(k, faults, "Faults") \
  F(k, temperature_deg_c, "Temperature_degC")
#define FORCE_TORQUE_FIELDS(F, k) \
  F(k, status, "Status") \
  F(k, force_x_n, "ForceX_N") \
  F(k, force_y_n, "ForceY_N") \
  F(k, force_z_n, "ForceZ_N") \
  F(k, moment_x_nm, "MomentX_Nm") \
  F(k, moment_y_nm, "MomentY_Nm") \
  F(k, moment_z_nm, "MomentZ_Nm") \
  F(k, cycle_echo, "CycleEcho")
#define GRIPPER_ANSWER_FIELDS(F, k) \
  GRIPPER_STATUS_FIELDS(F, k) \
  F(k, wrench_status, "WrenchStatus") \
  F(k, force_x_n, "ForceX_N") \
  F(k, force_y_n, "ForceY_N") \
  F(k, force_z_n, "ForceZ_N") \
  F(k, moment_x_nm, "MomentX_Nm") \
  F(k, moment_y_nm, "MomentY_Nm") \
  F(k, moment_z_nm, "MomentZ_Nm")
#define BROADCAST_HEADER_FIELDS(F, k) \
  F(k, cycle, "Cycle")
#define IDENTITY_FIELDS(F, k) \
  F(k, protocol, "Protocol") \
  F(k, node_kind, "NodeKind") \
  F(k, node_id, "NodeId") \
  F(k, limb, "Limb")
// clang-format on

// The broadcast is coded by its parts, each under the names it has in the whole.
const Codec kBroadcastHeader = KIND(broadcast_header, CRUX_CAN_LENGTH_BROADCAST_HEADER, BROADCAST_HEADER_FIELDS);
const Codec kBroadcastJoint = KIND(broadcast_joint, CRUX_CAN_LENGTH_BROADCAST_JOINT, JOINT_COMMAND_FIELDS);
const Codec kBroadcastGripper = KIND(broadcast_gripper, CRUX_CAN_LENGTH_BROADCAST_GRIPPER, GRIPPER_COMMAND_FIELDS);

struct Part {
  std::string prefix;
  const Codec& codec;
  std::size_t offset, length;
};

std::vector<Part> broadcast_parts() {
  std::vector<Part> parts = {
      {"", kBroadcastHeader, CRUX_CAN_OFFSET_BROADCAST_HEADER, CRUX_CAN_LENGTH_BROADCAST_HEADER},
      {"Gripper", kBroadcastGripper, CRUX_CAN_OFFSET_BROADCAST_GRIPPER, CRUX_CAN_LENGTH_BROADCAST_GRIPPER}};
  for (std::size_t joint = 0; joint < CRUX_CAN_BROADCAST_JOINTS; ++joint) {
    parts.push_back({"Joint" + std::to_string(joint + 1), kBroadcastJoint,
                     CRUX_CAN_OFFSET_BROADCAST_JOINT + joint * CRUX_CAN_LENGTH_BROADCAST_JOINT,
                     CRUX_CAN_LENGTH_BROADCAST_JOINT});
  }
  return parts;
}

Signals decode_broadcast(const Bytes& data) {
  Signals all;
  for (const Part& part : broadcast_parts()) {
    const auto first = data.begin() + static_cast<std::ptrdiff_t>(part.offset);
    const Bytes bytes(first, first + static_cast<std::ptrdiff_t>(part.length));
    for (const auto& [name, value] : part.codec.decode(bytes)) all[part.prefix + name] = value;
  }
  return all;
}

Bytes encode_broadcast(const Signals& all) {
  Bytes data(CRUX_CAN_LENGTH_BROADCAST);
  for (const Part& part : broadcast_parts()) {
    Signals own;
    for (const auto& [name, value] : all) {
      if (name.starts_with(part.prefix)) own[name.substr(part.prefix.size())] = value;
    }
    std::ranges::copy(part.codec.encode(own), data.begin() + static_cast<std::ptrdiff_t>(part.offset));
  }
  return data;
}

const std::map<std::string, Codec>& codecs() {
  static const std::map<std::string, Codec> all = {
      {"Sync", KIND(sync, CRUX_CAN_LENGTH_SYNC, SYNC_FIELDS)},
      {"Broadcast", {decode_broadcast, encode_broadcast}},
      {"GripperAnswer", KIND(gripper_answer, CRUX_CAN_LENGTH_GRIPPER_ANSWER, GRIPPER_ANSWER_FIELDS)},
      {"HostHeartbeat", KIND(host_heartbeat, CRUX_CAN_LENGTH_HOST_HEARTBEAT, HOST_FIELDS)},
      {"JointEmergency", KIND(joint_emergency, CRUX_CAN_LENGTH_JOINT_EMERGENCY, EMERGENCY_FIELDS)},
      {"GripperEmergency", KIND(gripper_emergency, CRUX_CAN_LENGTH_GRIPPER_EMERGENCY, EMERGENCY_FIELDS)},
      {"JointCommand", KIND(joint_command, CRUX_CAN_LENGTH_JOINT_COMMAND, JOINT_COMMAND_FIELDS)},
      {"GripperCommand", KIND(gripper_command, CRUX_CAN_LENGTH_GRIPPER_COMMAND, GRIPPER_COMMAND_FIELDS)},
      {"JointStatus", KIND(joint_status, CRUX_CAN_LENGTH_JOINT_STATUS, JOINT_STATUS_FIELDS)},
      {"GripperStatus", KIND(gripper_status, CRUX_CAN_LENGTH_GRIPPER_STATUS, GRIPPER_STATUS_FIELDS)},
      {"ForceTorque", KIND(force_torque, CRUX_CAN_LENGTH_FORCE_TORQUE, FORCE_TORQUE_FIELDS)},
      {"JointHeartbeat", KIND(joint_heartbeat, CRUX_CAN_LENGTH_JOINT_HEARTBEAT, HEARTBEAT_FIELDS)},
      {"GripperHeartbeat", KIND(gripper_heartbeat, CRUX_CAN_LENGTH_GRIPPER_HEARTBEAT, HEARTBEAT_FIELDS)},
      {"JointIdentity", KIND(joint_identity, CRUX_CAN_LENGTH_JOINT_IDENTITY, IDENTITY_FIELDS)},
      {"GripperIdentity", KIND(gripper_identity, CRUX_CAN_LENGTH_GRIPPER_IDENTITY, IDENTITY_FIELDS)},
  };
  return all;
}

// 32-bit counters and hashes do not fit a float; where they stand in a frame.
const std::map<std::string, std::vector<std::pair<std::string, std::size_t>>> kWords = {
    {"Sync", {{"Cycle", 4}}},
    {"HostHeartbeat", {{"Uptime_ms", 4}}},
    {"JointHeartbeat", {{"Uptime_ms", 4}}},
    {"GripperHeartbeat", {{"Uptime_ms", 4}}},
    {"JointEmergency", {{"Detail", 4}}},
    {"GripperEmergency", {{"Detail", 4}}},
    {"JointIdentity", {{"FirmwareVersion", 8}, {"ParameterHash", 12}}},
    {"GripperIdentity", {{"FirmwareVersion", 8}, {"ParameterHash", 12}}},
};

std::uint32_t word_at(const Bytes& data, std::size_t offset) {
  std::uint32_t word = 0;
  for (std::size_t i = 0; i < 4; ++i) word |= static_cast<std::uint32_t>(data[offset + i]) << (8 * i);
  return word;
}

TEST(CanGolden, DecodesAndEncodesEveryFrameAsPythonDoes) {
  std::set<std::string> seen;
  for (const auto& vector : crux_test::golden("can_frames.json")) {
    const std::string name = vector["message"];
    SCOPED_TRACE(vector.dump());
    seen.insert(name);
    ASSERT_TRUE(codecs().contains(name));
    const Bytes data = crux_test::bytes_of(vector["data"]);
    const std::uint32_t identifier = vector["identifier"];

    crux_e2e_receiver receiver{};
    EXPECT_EQ(crux_e2e_check(identifier, data.data(), data.size(), &receiver), CRUX_E2E_OK);
    EXPECT_EQ(receiver.counter, vector["counter"].get<int>());

    const auto words = kWords.contains(name) ? kWords.at(name) : decltype(kWords.at(name)){};
    const Signals decoded = codecs().at(name).decode(data);
    EXPECT_EQ(decoded.size() + words.size(), vector["signals"].size()) << "a signal is not compared";
    for (const auto& [signal, value] : decoded) {
      const double expected = vector["signals"].at(signal);
      EXPECT_NEAR(value, expected, 2e-7 * std::abs(expected)) << signal;
    }

    Bytes encoded = codecs().at(name).encode(decoded);
    for (const auto& [signal, offset] : words) {
      EXPECT_EQ(word_at(data, offset), vector["signals"].at(signal).get<double>()) << signal;
      std::copy_n(data.begin() + static_cast<std::ptrdiff_t>(offset), 4,
                  encoded.begin() + static_cast<std::ptrdiff_t>(offset));
    }
    crux_e2e_protect(identifier, vector["counter"], encoded.data(), encoded.size());
    EXPECT_EQ(encoded, data);
  }
  EXPECT_EQ(seen.size(), codecs().size());
}

TEST(CanGolden, IdentifiersOfJointsAreBasePlusNode) {
  for (const auto& vector : crux_test::golden("can_frames.json")) {
    if (vector["message"] != "JointStatus") continue;
    EXPECT_EQ(vector["identifier"].get<std::uint32_t>(), CRUX_CAN_ID_JOINT_STATUS(vector["node"].get<int>()));
  }
}

TEST(CanCodec, ClippedEncodersHoldTheRangeOfTheSignal) {
  EXPECT_EQ(crux_can_joint_command_torque_nm_encode_clipped(1e9F), 32767);
  EXPECT_EQ(crux_can_joint_command_torque_nm_encode_clipped(-1e9F), -32768);
  EXPECT_EQ(crux_can_joint_command_torque_nm_encode_clipped(std::nanf("")), 0);
  EXPECT_EQ(crux_can_joint_command_torque_nm_encode_clipped(-3.2F), -3200);
  EXPECT_EQ(crux_can_joint_command_kp_nm_rad_encode_clipped(-1.0F), 0);
  EXPECT_EQ(crux_can_gripper_command_force_limit_n_encode_clipped(700.0F), 65535);
}

}  // namespace
