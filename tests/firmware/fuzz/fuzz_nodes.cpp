// libFuzzer drives a joint and a gripper with whatever it can think of: frames of noise, whole frames with senseless
// content, forged counters, lost sensors, strange ticks. The bytes are a program; each step is judged (judge.hpp).
// CRUX_FUZZ_FRAMES: ends, with status 0, after so many frames.
#include <cstdio>
#include <cstdlib>

#include "judge.hpp"

namespace crux::firmware {
namespace {

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

// Whole, with any bits inside; half of them with a mode for everybody.
crux_frame broadcast(Bytes& bytes, std::uint8_t counter) {
  crux_frame frame = frame_of(Broadcast{}, bytes.take<std::uint16_t>(), counter);
  for (int i = 5; i < frame.length; ++i) {
    frame.data[i] = bytes.take<std::uint8_t>();
  }
  if (bytes.take<std::uint8_t>() < 128) {
    const auto mode = static_cast<std::uint8_t>(bytes.take<std::uint8_t>() % 3U);
    const std::size_t mine = 5 + (9 * (kJoint - 1));
    frame.data[mine] = static_cast<std::uint8_t>((frame.data[mine] & 0xF0U) | mode);
    frame.data[59] = static_cast<std::uint8_t>((frame.data[59] & 0xFCU) | mode);
  }
  seal(frame, counter);
  return frame;
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

void play_joint(Bytes& bytes) {
  const crux_joint_parameters limits = joint_parameters();
  Joint joint(limits, bytes.number(-2.0F, 1.5F));
  std::uint8_t commands = 0;
  std::uint8_t syncs = 0;
  std::uint8_t broadcasts = 0;
  while (!bytes.empty()) {
    const auto step = bytes.take<std::uint8_t>() % 10U;
    if (step == 0) {
      hear(joint, noise(bytes));
    } else if (step >= 8) {
      hear(joint, broadcast(bytes, counter(bytes, broadcasts)));
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

void play_gripper(Bytes& bytes) {
  const crux_gripper_parameters limits = gripper_parameters();
  Gripper gripper(bytes.number(0.008F, 0.066F));
  float widest_asked_m = 0.0F;
  std::uint8_t commands = 0;
  std::uint8_t syncs = 0;
  std::uint8_t broadcasts = 0;
  while (!bytes.empty()) {
    const auto step = bytes.take<std::uint8_t>() % 10U;
    if (step == 0) {
      hear(gripper, noise(bytes));
    } else if (step >= 8) {
      const crux_frame frame = broadcast(bytes, counter(bytes, broadcasts));
      crux_gripper_command command{};
      if (crux_gripper_broadcast_accept(&frame, &limits, &command) == CRUX_CAUSE_NONE) {
        widest_asked_m = std::max(widest_asked_m, command.opening_m);
      }
      hear(gripper, frame);
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
