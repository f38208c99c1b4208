// libFuzzer writes parameters of a joint and a gripper and sends them new firmware while they are commanded, stopped,
// restarted, and while their flash loses power: any bits, any parameter, any image, in whole requests and as noise in
// frames of ISO-TP. Each tick is judged (judge.hpp); no request may change the torque or force of the moment, none the
// flash of a node that moves or the image that runs, and a node always starts from a whole image somebody has signed.
// CRUX_FUZZ_WRITES: ends, with status 0, after so many writes.
#include <array>
#include <cstdio>
#include <cstdlib>

#include "judge.hpp"
#include "updates.hpp"

namespace crux::firmware {
namespace {

constexpr std::uint8_t kGripper = 7;
constexpr std::uint8_t kNumbers = 13;  // of parameters; the first and the last do not exist

struct Tally {
  unsigned long long writes = 0;
  unsigned long long accepted = 0;
} tally;

void count_write(bool accepted) {
  static const char* const limit = std::getenv("CRUX_FUZZ_WRITES");
  static const unsigned long long last = (limit != nullptr) ? std::strtoull(limit, nullptr, 10) : 0;
  ++tally.writes;
  tally.accepted += accepted ? 1 : 0;
  if (last != 0 && tally.writes >= last) {
    std::printf("fuzzed %llu writes, %llu accepted, %llu images taken, %llu started\n", tally.writes, tally.accepted,
                updates_tally.taken, updates_tally.started);
    std::fflush(stdout);
    std::_Exit(0);
  }
}

std::uint32_t value_for(Bytes& bytes, const crux_service& service, std::uint8_t number) {
  const std::uint8_t index = crux_overrides_find(&service.overrides, number);
  const auto kind = bytes.take<std::uint8_t>();
  if (index >= service.overrides.count || kind < 64) return bytes.take<std::uint32_t>();
  // Near what is allowed, on either side.
  const std::uint32_t described = service.overrides.described[index];
  const float share = 4.0F * static_cast<float>(bytes.take<std::uint16_t>()) / 65535.0F;
  if (service.overrides.table[index].is_integer)
    return static_cast<std::uint32_t>(share * static_cast<float>(described));
  float value = 0.0F;
  std::memcpy(&value, &described, sizeof value);
  value *= share;
  std::uint32_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

// What a fuzzed host asks for; `probe` gives the torque (force) the node would put out now.
template <typename Probe>
void ask(Bytes& bytes, Services& services, std::uint8_t node, std::uint8_t state, const Probe& probe) {
  const float before = probe();
  const unsigned long long operations = services.operations();
  const auto what = bytes.take<std::uint8_t>() % 16U;
  if (what < 11) {
    const auto number = static_cast<std::uint8_t>(bytes.take<std::uint8_t>() % kNumbers);
    const std::uint32_t bits = value_for(bytes, services.service, number);
    const auto byte = [bits](int i) { return static_cast<std::uint8_t>(bits >> (8 * i)); };
    count_write(services.request(node, state, {CRUX_SERVICE_WRITE, 2, number, byte(0), byte(1), byte(2), byte(3)}));
  } else if (what == 11) {
    const Host host = (bytes.take<std::uint8_t>() < 128) ? Host::kTool : Host::kFickle;
    for (int left = 1 + bytes.take<std::uint8_t>() % 12; left > 0 && !services.model.off; --left) {
      update(bytes, services, node, state, host);
    }
  } else if (what < 14) {
    services.power(bytes.take<std::uint8_t>() % 16U, static_cast<crux_flash_cut>(bytes.take<std::uint8_t>() % 3U));
    services.request(node, state, {CRUX_SERVICE_ROUTINE, 1, 2, static_cast<std::uint8_t>((what == 12) ? 1 : 2)});
    services.power();
  } else {
    crux_frame frame{};
    frame.id = static_cast<std::uint16_t>(CRUX_CAN_ID_JOINT_REQUEST(node));
    frame.length = static_cast<std::uint8_t>(bytes.take<std::uint8_t>() % 65U);
    for (int i = 0; i < frame.length; ++i) frame.data[i] = bytes.take<std::uint8_t>();
    services.hear(frame, state);
  }
  require(is_at_rest(state) || services.operations() == operations, "a request changes the flash of a moving node");
  require(services.running_is_whole(), "a request changes the image that runs");
  const float after = probe();
  require(before == after || (std::isnan(before) && std::isnan(after)), "a request changes what a node does now");
}

// Now and then a second at once, after which a healthy image keeps itself.
void serve(Bytes& bytes, Services& services, std::uint8_t state, const crux_guard& guard) {
  const float dt_s = (bytes.take<std::uint8_t>() < 32) ? 1.0F : kDt;
  crux_service_tick(&services.service, crux_microseconds(dt_s), state, crux_guard_is_commanded(&guard));
  crux_frame frame{};
  crux_service_take_frame(&services.service, &frame);
}

void start(Services& services, Joint& joint, float position_rad) {
  crux_joint_parameters parameters = joint_parameters();
  services.boot();
  crux_service_init(&services.service, kJoint, services.running.version, 0, &parameters, &services.store);
  crux_service_offer_update(&services.service, &services.update);
  require(crux_joint_parameters_fault(&parameters) == nullptr, "a joint starts with senseless parameters");
  joint = Joint(parameters, position_rad);
  crux_service_attach(&services.service, &joint.node.parameters);
}

void play_joint(Bytes& bytes) {
  static Services services(CRUX_KIND_JOINT);
  services.renew();
  const crux_joint_parameters limits = joint_parameters();
  Joint joint;
  start(services, joint, bytes.number(-2.0F, 1.5F));
  while (!bytes.empty()) {
    const auto step = bytes.take<std::uint8_t>() % 16U;
    if (step == 0 || services.restarts()) {
      start(services, joint, bytes.number(-2.0F, 1.5F));
    } else if (step <= 2) {
      JointCommand command;
      command.mode = bytes.take<std::uint8_t>() % 3U;
      command.position_rad = std::clamp(bytes.number(-3.0F, 3.0F), -3.0F, 3.0F);
      joint.run(command);
    } else if (step <= 4) {
      // Near the setpoint, where torque is not at its limit and a changed gain would show.
      joint.inputs.position_rad = joint.node.setpoint_rad + std::clamp(bytes.number(-0.2F, 0.2F), -0.2F, 0.2F);
      joint.inputs.velocity_rad_s = bytes.number(-6.0F, 6.0F);
      judge(joint, tick_s(bytes), limits);
      serve(bytes, services, joint.node.state, joint.node.guard);
    } else {
      ask(bytes, services, kJoint, joint.node.state,
          [&joint] { return torque_when_at(joint, joint.inputs.position_rad, kDt); });
    }
  }
}

void start(Services& services, Gripper& gripper, float opening_m) {
  crux_gripper_parameters parameters = gripper_parameters();
  services.boot();
  crux_service_init(&services.service, kGripper, services.running.version, 0, &parameters, &services.store);
  crux_service_offer_update(&services.service, &services.update);
  require(crux_gripper_parameters_fault(&parameters) == nullptr, "a gripper starts with senseless parameters");
  gripper = Gripper(opening_m);
  crux_gripper_node_init(&gripper.node, 2, 0, &parameters);
  crux_service_attach(&services.service, &gripper.node.parameters);
}

void play_gripper(Bytes& bytes) {
  static Services services(CRUX_KIND_GRIPPER);
  services.renew();
  Gripper gripper;
  start(services, gripper, bytes.number(0.008F, 0.066F));
  float widest_asked_m = 0.0F;
  while (!bytes.empty()) {
    const auto step = bytes.take<std::uint8_t>() % 16U;
    if (step == 0 || services.restarts()) {
      start(services, gripper, bytes.number(0.008F, 0.066F));
      widest_asked_m = 0.0F;
    } else if (step <= 2) {
      GripperCommand command;
      command.mode = bytes.take<std::uint8_t>() % 3U;
      command.opening_m = std::clamp(bytes.number(0.0F, 0.08F), 0.008F, 0.066F);
      command.opening_m = std::isfinite(command.opening_m) ? command.opening_m : 0.03F;
      widest_asked_m = std::max(widest_asked_m, command.opening_m);
      gripper.run(command);
    } else if (step <= 4) {
      gripper.inputs.opening_m = gripper.node.setpoint_m + std::clamp(bytes.number(-0.004F, 0.004F), -0.004F, 0.004F);
      gripper.inputs.speed_m_s = bytes.number(-0.05F, 0.05F);
      judge(gripper, tick_s(bytes), widest_asked_m, gripper.node.parameters);
      serve(bytes, services, gripper.node.state, gripper.node.guard);
    } else {
      ask(bytes, services, kGripper, gripper.node.state,
          [&gripper] { return force_when_at(gripper, gripper.inputs.opening_m, kDt); });
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
