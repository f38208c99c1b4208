// What a safe node is, and bytes as a program for one: shared by the fuzzers.
//   joint    torque is a number within the limit, and stiff: pushed away it pushes back more, in every state but FAULT
//            (position lost), where it keeps its torque
//   gripper  force is a number within the limit; outside of TRACK it never opens and never squeezes less for being
//            pried open; within TRACK it opens only towards an opening that a whole command asked for
#pragma once

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "node_fixture.hpp"

namespace crux::firmware {

[[noreturn]] inline void unsafe(const char* what) {
  std::fprintf(stderr, "UNSAFE: %s\n", what);
  std::abort();
}

inline void require(bool good, const char* what) {
  if (!good) {
    unsafe(what);
  }
}

class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), left_(size) {}
  [[nodiscard]] bool empty() const { return left_ == 0; }
  template <typename T>
  T take() {
    T value{};
    const std::size_t count = std::min(sizeof(T), left_);
    std::memcpy(&value, data_, count);
    data_ += count;
    left_ -= count;
    return value;
  }
  // Any bit pattern, or a sensible number.
  float number(float low, float high) {
    const auto kind = take<std::uint8_t>();
    return (kind < 32) ? take<float>() : low + (high - low) * static_cast<float>(take<std::uint16_t>()) / 65535.0F;
  }

 private:
  const std::uint8_t* data_;
  std::size_t left_;
};

// Counter of the host: mostly the next one.
inline std::uint8_t counter(Bytes& bytes, std::uint8_t& last) {
  const auto skip = bytes.take<std::uint8_t>();
  last = static_cast<std::uint8_t>(last + ((skip < 200) ? 1 : skip));
  return last;
}

inline float tick_s(Bytes& bytes) {
  static constexpr float kTicks[] = {0.001F, 0.002F, 0.0001F, 0.01F};
  return kTicks[bytes.take<std::uint8_t>() % 4U];
}

inline float torque_when_at(const Joint& joint, float position_rad, float dt_s) {
  crux_joint_node copy = joint.node;
  crux_joint_inputs inputs = joint.inputs;
  inputs.position_rad = position_rad;
  inputs.velocity_rad_s = 0.0F;
  crux_joint_outputs outputs{};
  crux_joint_node_tick(&copy, dt_s, &inputs, &outputs);
  return outputs.torque_Nm;
}

inline void judge(Joint& joint, float dt_s, const crux_joint_parameters& limits) {
  const bool held = joint.node.has_seen && std::abs(joint.inputs.position_rad) < 3.0F;
  const std::uint8_t before = joint.node.state;
  const float below = held ? torque_when_at(joint, joint.inputs.position_rad - 0.5F, dt_s) : 0.0F;
  const float above = held ? torque_when_at(joint, joint.inputs.position_rad + 0.5F, dt_s) : 0.0F;
  const float torque = joint.tick(dt_s);
  require(std::isfinite(torque), "a joint's torque is no number");
  require(std::abs(torque) <= limits.torque_limit_Nm, "a joint's torque is beyond its limit");
  require(std::isfinite(joint.node.setpoint_rad), "a joint's setpoint is no number");
  if (held && before != CRUX_STATE_FAULT && joint.node.state != CRUX_STATE_FAULT) {
    const bool saturated = std::abs(below) >= limits.torque_limit_Nm && below == above;
    require(below > above || saturated, "a joint is limp");
  }
}

inline float force_when_at(const Gripper& gripper, float opening_m, float dt_s) {
  crux_gripper_node copy = gripper.node;
  crux_gripper_inputs inputs = gripper.inputs;
  inputs.opening_m = opening_m;
  inputs.speed_m_s = 0.0F;
  crux_gripper_outputs outputs{};
  crux_gripper_node_tick(&copy, dt_s, &inputs, &outputs);
  return outputs.force_N;
}

inline void judge(Gripper& gripper, float dt_s, float widest_asked_m, const crux_gripper_parameters& limits) {
  const bool held = gripper.node.has_seen && std::abs(gripper.inputs.opening_m) < 0.1F;
  const float pried = held ? force_when_at(gripper, gripper.inputs.opening_m + 1e-3F, dt_s) : 0.0F;
  const float still = held ? force_when_at(gripper, gripper.inputs.opening_m, dt_s) : 0.0F;
  const std::uint8_t before = gripper.node.state;
  const float setpoint_before_m = gripper.node.has_seen ? gripper.node.setpoint_m : gripper.inputs.opening_m;
  const float force = gripper.tick(dt_s);
  require(std::isfinite(force), "a gripper's force is no number");
  require(std::abs(force) <= limits.force_limit_N, "a gripper's force is beyond its limit");
  if (gripper.node.state != CRUX_STATE_TRACK) {
    require(force >= 0.0F, "a gripper opens by itself");
    require(pried >= still - 0.01F || before == CRUX_STATE_TRACK, "a gripper squeezes less for being pried open");
  }
  if (gripper.node.state == CRUX_STATE_TRACK && gripper.node.setpoint_m > setpoint_before_m + 1e-6F) {
    // Dragged along by a load beyond the force limit, or asked to.
    const float lead_m = gripper.node.force_limit_N / limits.stiffness_N_m;
    const bool dragged = gripper.node.setpoint_m <= gripper.inputs.opening_m - lead_m + 1e-6F;
    require(dragged || gripper.node.setpoint_m <= widest_asked_m + 1e-6F, "a gripper opens wider than it was asked to");
  }
}

}  // namespace crux::firmware
