// Frames as a host would send them, sealed by a CRC written out bit by bit here, and a joint and a gripper to send them
// to. Parameters are round numbers of the tests' own: nothing here depends on a robot.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <vector>

extern "C" {
#include "gripper_node.h"
#include "joint_node.h"
}

namespace crux::firmware {

inline constexpr float kDt = 0.002F;
inline constexpr int kWatchdogCycles = 5;
inline constexpr std::uint8_t kJoint = 3;
inline constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

inline crux_joint_parameters joint_parameters() {
  return {.position_min_rad = -2.0F,
          .position_max_rad = 1.5F,
          .velocity_limit_rad_s = 4.0F,
          .torque_limit_Nm = 10.0F,
          .position_gain_Nm_rad = 100.0F,
          .velocity_gain_Nms_rad = 4.0F,
          .setpoint_time_constant_s = 0.02F,
          .max_deceleration_rad_s2 = 50.0F,
          .temperature_limit_degC = 80.0F,
          .period_us = 2000,
          .watchdog_cycles = kWatchdogCycles};
}

inline crux_gripper_parameters gripper_parameters() {
  return {.opening_min_m = 0.008F,
          .opening_max_m = 0.066F,
          .speed_limit_m_s = 0.02F,
          .force_limit_N = 60.0F,
          .stiffness_N_m = 20000.0F,
          .damping_Ns_m = 200.0F,
          .force_range_N = 200.0F,
          .moment_range_Nm = 8.0F,
          .temperature_limit_degC = 80.0F,
          .period_us = 2000,
          .watchdog_cycles = kWatchdogCycles};
}

// CRC-16, polynomial 0x1021, initial 0xFFFF, over payload[2..] and the identifier, low byte first: the definition.
inline std::uint16_t reference_crc(const crux_frame& frame) {
  std::vector<std::uint8_t> bytes(frame.data + 2, frame.data + frame.length);
  bytes.push_back(static_cast<std::uint8_t>(frame.id & 0xFF));
  bytes.push_back(static_cast<std::uint8_t>(frame.id >> 8));
  unsigned crc = 0xFFFF;
  for (const unsigned byte : bytes) {
    for (int bit = 7; bit >= 0; --bit) {
      const bool carry = ((crc >> 15) ^ (byte >> bit)) & 1U;
      crc = (crc << 1) & 0xFFFF;
      crc ^= carry ? 0x1021U : 0U;
    }
  }
  return static_cast<std::uint16_t>(crc);
}

inline void seal(crux_frame& frame, std::uint8_t counter) {
  frame.data[2] = counter;
  const std::uint16_t crc = reference_crc(frame);
  frame.data[0] = static_cast<std::uint8_t>(crc & 0xFF);
  frame.data[1] = static_cast<std::uint8_t>(crc >> 8);
}

struct JointCommand {
  unsigned mode = CRUX_MODE_TRACK;
  float position_rad = 0.0F;
  float velocity_rad_s = 0.0F;
  float torque_Nm = 0.0F;
  float kp = 100.0F;
  float kd = 4.0F;
};

inline crux_frame frame_of(const JointCommand& command, std::uint8_t counter, std::uint8_t node = kJoint) {
  crux_can_joint_command_t raw{};
  raw.mode = static_cast<std::uint8_t>(command.mode);
  raw.position_rad = command.position_rad;
  raw.velocity_rad_s = crux_can_joint_command_velocity_rad_s_encode_clipped(command.velocity_rad_s);
  raw.torque_nm = crux_can_joint_command_torque_nm_encode_clipped(command.torque_Nm);
  raw.kp_nm_rad = crux_can_joint_command_kp_nm_rad_encode_clipped(command.kp);
  raw.kd_nms_rad = crux_can_joint_command_kd_nms_rad_encode_clipped(command.kd);
  crux_frame frame{};
  frame.id = static_cast<std::uint16_t>(0x100 + node);
  frame.length = 16;
  crux_can_joint_command_pack(frame.data, &raw, sizeof frame.data);
  seal(frame, counter);
  return frame;
}

struct GripperCommand {
  unsigned mode = CRUX_MODE_TRACK;
  float opening_m = 0.03F;
  float speed_limit_m_s = 0.02F;
  float force_limit_N = 30.0F;
};

inline crux_frame frame_of(const GripperCommand& command, std::uint8_t counter) {
  crux_can_gripper_command_t raw{};
  raw.mode = static_cast<std::uint8_t>(command.mode);
  raw.opening_m = command.opening_m;
  raw.speed_limit_m_s = crux_can_gripper_command_speed_limit_m_s_encode_clipped(command.speed_limit_m_s);
  raw.force_limit_n = crux_can_gripper_command_force_limit_n_encode_clipped(command.force_limit_N);
  crux_frame frame{};
  frame.id = 0x107;
  frame.length = 16;
  crux_can_gripper_command_pack(frame.data, &raw, sizeof frame.data);
  seal(frame, counter);
  return frame;
}

inline crux_frame sync_frame(std::uint32_t cycle, std::uint8_t counter) {
  crux_can_sync_t raw{};
  raw.cycle = cycle;
  crux_frame frame{};
  frame.id = 0x010;
  frame.length = 8;
  crux_can_sync_pack(frame.data, &raw, sizeof frame.data);
  seal(frame, counter);
  return frame;
}

// A broadcast, its bits laid down one by one here: joints from byte 5 on, nine bytes each, the gripper in the last
// five. Every joint but the one asked for gets REARM and zeros, so that a node that reads another's part shows.
struct Broadcast {
  JointCommand joint = {};
  std::uint8_t node = kJoint;
  GripperCommand gripper = {};
};

inline void lay(crux_frame& frame, unsigned first_bit, unsigned bits, double steps) {
  const auto value = static_cast<std::int64_t>(std::llround(steps));
  for (unsigned i = 0; i < bits; ++i) {
    const auto bit = static_cast<unsigned>((value >> i) & 1);
    frame.data[(first_bit + i) / 8] |= static_cast<std::uint8_t>(bit << ((first_bit + i) % 8));
  }
}

inline crux_frame frame_of(const Broadcast& all, std::uint16_t cycle, std::uint8_t counter) {
  crux_frame frame{};
  frame.id = 0x011;
  frame.length = 64;
  lay(frame, 24, 16, cycle);
  for (unsigned node = 1; node <= 6; ++node) {
    const unsigned start = 40 + (72 * (node - 1));
    if (node != all.node) {
      lay(frame, start, 4, CRUX_MODE_REARM);
      continue;
    }
    lay(frame, start, 4, all.joint.mode);
    lay(frame, start + 4, 20, static_cast<double>(all.joint.position_rad) / 1e-5);
    lay(frame, start + 24, 16, static_cast<double>(all.joint.velocity_rad_s) / 0.001);
    lay(frame, start + 40, 16, static_cast<double>(all.joint.torque_Nm) / 0.001);
    lay(frame, start + 56, 8, static_cast<double>(all.joint.kp) / 2.0);
    lay(frame, start + 64, 8, static_cast<double>(all.joint.kd) / 0.05);
  }
  lay(frame, 472, 2, all.gripper.mode);
  lay(frame, 474, 14, static_cast<double>(all.gripper.opening_m) / 5e-6);
  lay(frame, 488, 10, static_cast<double>(all.gripper.speed_limit_m_s) / 1e-4);
  lay(frame, 498, 14, static_cast<double>(all.gripper.force_limit_N) / 0.02);
  seal(frame, counter);
  return frame;
}

// All frames in the node's transmit queue, by identifier.
inline std::multimap<std::uint16_t, crux_frame> take_all(crux_link& link) {
  std::multimap<std::uint16_t, crux_frame> frames;
  crux_frame frame;
  while (crux_link_take_frame(&link, &frame)) {
    frames.emplace(frame.id, frame);
  }
  return frames;
}

// A joint node, its host's counters and what its sensors read.
struct Joint {
  crux_joint_node node{};
  crux_joint_inputs inputs{.position_rad = 0.0F,
                           .velocity_rad_s = 0.0F,
                           .torque_Nm = 0.0F,
                           .temperature_degC = 25.0F,
                           .bus_off = false,
                           .driver_fault = false,
                           .health = {}};
  std::uint8_t command_counter = 0;
  std::uint8_t sync_counter = 0;
  std::uint32_t cycle = 0;

  explicit Joint(const crux_joint_parameters& parameters = joint_parameters(), float position_rad = 0.0F) {
    inputs.position_rad = position_rad;
    crux_joint_node_init(&node, 1, kJoint, 0xC0FFEE, &parameters);
  }
  void hear(const crux_frame& frame) { crux_joint_node_on_frame(&node, &frame); }
  void sync() { hear(sync_frame(++cycle, ++sync_counter)); }
  void command(const JointCommand& command) { hear(frame_of(command, ++command_counter)); }
  float tick(float dt_s = kDt) {
    crux_joint_outputs outputs{};
    crux_joint_node_tick(&node, dt_s, &inputs, &outputs);
    return outputs.torque_Nm;
  }
  // One whole bus cycle.
  float run(const JointCommand& wanted) {
    command(wanted);
    sync();
    return tick();
  }
};

struct Gripper {
  crux_gripper_node node{};
  crux_gripper_inputs inputs{.opening_m = 0.03F,
                             .speed_m_s = 0.0F,
                             .force_N = 0.0F,
                             .temperature_degC = 25.0F,
                             .wrench = {},
                             .wrench_valid = true,
                             .wrench_overloaded = false,
                             .bus_off = false,
                             .driver_fault = false,
                             .health = {}};
  std::uint8_t command_counter = 0;
  std::uint8_t sync_counter = 0;
  std::uint32_t cycle = 0;

  explicit Gripper(float opening_m = 0.03F) {
    const crux_gripper_parameters parameters = gripper_parameters();
    inputs.opening_m = opening_m;
    crux_gripper_node_init(&node, 2, 0xC0FFEE, &parameters);
  }
  void hear(const crux_frame& frame) { crux_gripper_node_on_frame(&node, &frame); }
  void sync() { hear(sync_frame(++cycle, ++sync_counter)); }
  void command(const GripperCommand& command) { hear(frame_of(command, ++command_counter)); }
  float tick(float dt_s = kDt) {
    crux_gripper_outputs outputs{};
    crux_gripper_node_tick(&node, dt_s, &inputs, &outputs);
    return outputs.force_N;
  }
  float run(const GripperCommand& wanted) {
    command(wanted);
    sync();
    return tick();
  }
};

}  // namespace crux::firmware
