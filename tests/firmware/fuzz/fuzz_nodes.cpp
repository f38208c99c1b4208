// libFuzzer drives a joint and a gripper with whatever it can think of: frames of noise, whole frames with senseless
// content, forged counters, lost sensors, strange ticks. The bytes are a program; each step is judged:
//   joint    torque is a number within the limit, and stiff: pushed away it pushes back more, in every state but FAULT
//            (position lost), where it keeps its torque
//   gripper  force is a number within the limit; outside of TRACK it never opens and never squeezes less for being
//            pried open; within TRACK it opens only towards an opening that a whole command asked for
// CRUX_FUZZ_FRAMES: ends, with status 0, after so many frames.
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

[[noreturn]] void unsafe(const char* what) {
  std::fprintf(stderr, "UNSAFE: %s\n", what);
  std::abort();
}

void require(bool good, const char* what) {
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

unsigned long long frames_sent = 0;

void count_frame() {
  static const char* const limit = std::getenv("CRUX_FUZZ_FRAMES");
  static const unsigned long long last = (limit != nullptr) ? std::strtoull(limit, nullptr, 10) : 0;
  ++frames_sent;
  if (last != 0 && frames_sent >= last) {
    std::printf("fuzzed %llu frames\n", frames_sent);
    std::fflush(stdout);
    std::_Exit(0);
  }
}

template <typename Node>
void hear(Node& node, const crux_frame& frame) {
  node.hear(frame);
  count_frame();
}

crux_frame noise(Bytes& bytes) {
  crux_frame frame{};
  frame.id = static_cast<std::uint16_t>(bytes.take<std::uint16_t>() & 0x7FFU);
  frame.length = static_cast<std::uint8_t>(bytes.take<std::uint8_t>() % 65U);
  for (int i = 0; i < std::min<int>(frame.length, 16); ++i) {
    frame.data[i] = bytes.take<std::uint8_t>();
  }
  return frame;
}

// Counter of the host: mostly the next one.
std::uint8_t counter(Bytes& bytes, std::uint8_t& last) {
  const auto skip = bytes.take<std::uint8_t>();
  last = static_cast<std::uint8_t>(last + ((skip < 200) ? 1 : skip));
  return last;
}

float tick_s(Bytes& bytes) {
  static constexpr float kTicks[] = {0.001F, 0.002F, 0.0001F, 0.01F};
  return kTicks[bytes.take<std::uint8_t>() % 4U];
}

float torque_when_at(const Joint& joint, float position_rad, float dt_s) {
  crux_joint_node copy = joint.node;
  crux_joint_inputs inputs = joint.inputs;
  inputs.position_rad = position_rad;
  inputs.velocity_rad_s = 0.0F;
  crux_joint_outputs outputs{};
  crux_joint_node_tick(&copy, dt_s, &inputs, &outputs);
  return outputs.torque_Nm;
}

void judge(Joint& joint, float dt_s, const crux_joint_parameters& limits) {
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

void play_joint(Bytes& bytes) {
  const crux_joint_parameters limits = joint_parameters();
  Joint joint(limits, bytes.number(-2.0F, 1.5F));
  std::uint8_t commands = 0;
  std::uint8_t syncs = 0;
  while (!bytes.empty()) {
    const auto step = bytes.take<std::uint8_t>() % 8U;
    if (step == 0) {
      hear(joint, noise(bytes));
    } else if (step <= 2) {
      JointCommand command;
      command.mode = bytes.take<std::uint8_t>() % 5U;
      command.position_rad = bytes.number(-3.0F, 3.0F);
      command.velocity_rad_s = bytes.number(-10.0F, 10.0F);
      command.torque_Nm = bytes.number(-20.0F, 20.0F);
      command.kp = bytes.number(0.0F, 400.0F);
      command.kd = bytes.number(0.0F, 20.0F);
      command.kp = std::isfinite(command.kp) ? command.kp : 0.0F;
      command.kd = std::isfinite(command.kd) ? command.kd : 0.0F;
      command.velocity_rad_s = std::isfinite(command.velocity_rad_s) ? command.velocity_rad_s : 0.0F;
      command.torque_Nm = std::isfinite(command.torque_Nm) ? command.torque_Nm : 0.0F;
      hear(joint, frame_of(command, counter(bytes, commands)));
    } else if (step <= 4) {
      hear(joint, sync_frame(bytes.take<std::uint32_t>(), counter(bytes, syncs)));
    } else {
      if (step == 5) {
        joint.inputs.position_rad = bytes.number(-2.5F, 2.0F);
        joint.inputs.velocity_rad_s = bytes.number(-6.0F, 6.0F);
        joint.inputs.temperature_degC = bytes.number(-50.0F, 200.0F);
        joint.inputs.bus_off = bytes.take<std::uint8_t>() < 16;
      }
      judge(joint, tick_s(bytes), limits);
      crux_joint_node_publish(&joint.node, &joint.inputs);
      crux_frame frame;
      while (crux_link_take_frame(&joint.node.link, &frame)) {
      }
    }
  }
}

float force_when_at(const Gripper& gripper, float opening_m, float dt_s) {
  crux_gripper_node copy = gripper.node;
  crux_gripper_inputs inputs = gripper.inputs;
  inputs.opening_m = opening_m;
  inputs.speed_m_s = 0.0F;
  crux_gripper_outputs outputs{};
  crux_gripper_node_tick(&copy, dt_s, &inputs, &outputs);
  return outputs.force_N;
}

void judge(Gripper& gripper, float dt_s, float widest_asked_m, const crux_gripper_parameters& limits) {
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

void play_gripper(Bytes& bytes) {
  const crux_gripper_parameters limits = gripper_parameters();
  Gripper gripper(bytes.number(0.008F, 0.066F));
  float widest_asked_m = 0.0F;
  std::uint8_t commands = 0;
  std::uint8_t syncs = 0;
  while (!bytes.empty()) {
    const auto step = bytes.take<std::uint8_t>() % 8U;
    if (step == 0) {
      hear(gripper, noise(bytes));
    } else if (step <= 2) {
      GripperCommand command;
      command.mode = bytes.take<std::uint8_t>() % 5U;
      command.opening_m = bytes.number(0.0F, 0.08F);
      command.speed_limit_m_s = bytes.number(0.0F, 0.05F);
      command.force_limit_N = bytes.number(0.0F, 100.0F);
      command.speed_limit_m_s = std::isfinite(command.speed_limit_m_s) ? command.speed_limit_m_s : 0.0F;
      command.force_limit_N = std::isfinite(command.force_limit_N) ? command.force_limit_N : 0.0F;
      if (std::isfinite(command.opening_m)) {
        widest_asked_m =
            std::max(widest_asked_m, std::clamp(command.opening_m, limits.opening_min_m, limits.opening_max_m));
      }
      hear(gripper, frame_of(command, counter(bytes, commands)));
    } else if (step <= 4) {
      hear(gripper, sync_frame(bytes.take<std::uint32_t>(), counter(bytes, syncs)));
    } else {
      if (step == 5) {
        gripper.inputs.opening_m = bytes.number(0.0F, 0.08F);
        gripper.inputs.speed_m_s = bytes.number(-0.05F, 0.05F);
        gripper.inputs.temperature_degC = bytes.number(-50.0F, 200.0F);
        gripper.inputs.wrench[0] = bytes.number(-300.0F, 300.0F);
      }
      judge(gripper, tick_s(bytes), widest_asked_m, limits);
      crux_gripper_node_publish(&gripper.node, &gripper.inputs);
      crux_frame frame;
      while (crux_link_take_frame(&gripper.node.link, &frame)) {
      }
    }
  }
}

}  // namespace
}  // namespace crux::firmware

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  crux::firmware::Bytes bytes(data, size);
  if (bytes.take<std::uint8_t>() % 2U == 0) {
    crux::firmware::play_joint(bytes);
  } else {
    crux::firmware::play_gripper(bytes);
  }
  return 0;
}
