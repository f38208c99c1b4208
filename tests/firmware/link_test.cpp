// What a node says on its own: identity, heartbeat, emergencies, and what happens when nobody fetches it.
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

TEST(Link, IntroducesItselfAtTheStart) {
  Joint joint;
  const auto frames = take_all(joint.node.link);
  ASSERT_EQ(frames.size(), 2U);
  crux_can_joint_identity_t identity{};
  const crux_frame& frame = frames.find(0x710 + kJoint)->second;
  crux_can_joint_identity_unpack(&identity, frame.data, frame.length);
  EXPECT_EQ(identity.protocol, CRUX_CAN_PROTOCOL_VERSION);
  EXPECT_EQ(identity.node_kind, CRUX_KIND_JOINT);
  EXPECT_EQ(identity.node_id, kJoint);
  EXPECT_EQ(identity.limb, 1);
  EXPECT_EQ(identity.parameter_hash, 0xC0FFEEU);
  crux_can_joint_emergency_t emergency{};
  crux_can_joint_emergency_unpack(&emergency, frames.find(0x080 + kJoint)->second.data, 8);
  EXPECT_EQ(emergency.cause, CRUX_CAUSE_RESTARTED);
}

TEST(Link, HeartbeatIsTenAsecondWhateverTheTick) {
  for (const float dt_s : {0.002F, 0.001F, 0.003F, 0.007F}) {
    Joint joint;
    const int ticks = static_cast<int>(std::lround(10.0 / static_cast<double>(dt_s)));
    std::size_t beats = 0;
    std::uint32_t uptime_ms = 0;
    for (int i = 0; i < ticks; ++i) {
      joint.tick(dt_s);
      for (const auto& [id, frame] : take_all(joint.node.link)) {
        if (id == 0x700 + kJoint) {
          crux_can_joint_heartbeat_t raw{};
          crux_can_joint_heartbeat_unpack(&raw, frame.data, frame.length);
          EXPECT_GT(raw.uptime_ms, uptime_ms);
          uptime_ms = raw.uptime_ms;
          ++beats;
        }
      }
    }
    EXPECT_NEAR(static_cast<double>(beats), 100.0, 1.0) << "dt " << dt_s;
    EXPECT_NEAR(uptime_ms, 10000.0, 110.0);
  }
}

TEST(Link, NodesOfABusDoNotBeatInTheSameCycle) {
  std::map<int, int> beats;
  for (std::uint8_t number = 1; number <= CRUX_CAN_NODES; ++number) {
    crux_link link{};
    crux_link_init(&link, CRUX_KIND_JOINT, 0, number, 0);
    for (int i = 0; i < 50; ++i) {
      take_all(link);
      crux_link_tick(&link, 2000, CRUX_STATE_HOLD);
      beats[i] += static_cast<int>(take_all(link).size());
    }
  }
  int total = 0;
  for (const auto& [tick, count] : beats) {
    EXPECT_LE(count, 1) << "tick " << tick;
    total += count;
  }
  EXPECT_EQ(total, static_cast<int>(CRUX_CAN_NODES));
}

TEST(Link, ANodeIsAskedByItsNumberAndNodeEightWithTheGripper) {
  for (std::uint8_t asked = 0; asked <= 7; ++asked) {
    std::vector<int> answer;
    for (std::uint8_t node = 1; node <= CRUX_CAN_NODES; ++node) {
      if (crux_link_is_asked(asked, node)) {
        answer.push_back(node);
      }
    }
    std::vector<int> right;
    if (asked != 0) {
      right.push_back(asked);
    }
    if (asked == 7) {
      right.push_back(8);
    }
    EXPECT_EQ(answer, right);
  }
}

TEST(Link, EmergenciesOfOneCauseAreRationed) {
  Joint joint;
  joint.run({});
  take_all(joint.node.link);
  std::size_t emergencies = 0;
  crux_frame forged = frame_of(JointCommand{}, 50);
  forged.data[0] ^= 1U;
  for (int i = 0; i < 500; ++i) {  // a second of forged frames
    for (int k = 0; k < 10; ++k) {
      joint.hear(forged);
    }
    joint.run({});
    emergencies += take_all(joint.node.link).count(0x080 + kJoint);
  }
  EXPECT_GE(emergencies, 9U);
  EXPECT_LE(emergencies, 11U);
  EXPECT_EQ(joint.node.link.counters.rejected_crc, 5000U);
  EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK) << "forged frames do not disturb good ones";
}

TEST(Link, CountersOfAnIdentifierStepByOne) {
  Joint joint;
  std::map<std::uint16_t, std::uint8_t> next;
  for (int i = 0; i < 1000; ++i) {
    joint.run({});
    crux_joint_node_publish(&joint.node, &joint.inputs);
    for (const auto& [id, frame] : take_all(joint.node.link)) {
      EXPECT_EQ(frame.data[2], next[id]) << std::hex << id;
      ++next[id];
      EXPECT_EQ(frame.data[0] | (frame.data[1] << 8), reference_crc(frame)) << std::hex << id;
    }
  }
  EXPECT_EQ(next[0x180 + kJoint], 1000 % 256);
}

TEST(Link, AFullQueueLosesTheOldestAndCounts) {
  Joint joint;
  for (int i = 0; i < 100; ++i) {
    joint.run({});
    crux_joint_node_publish(&joint.node, &joint.inputs);
  }
  EXPECT_GT(joint.node.link.counters.queue_overflows, 80U);
  crux_frame last{};
  crux_frame frame{};
  while (crux_link_take_frame(&joint.node.link, &frame)) {
    last = frame;
  }
  crux_can_joint_status_t raw{};
  crux_can_joint_status_unpack(&raw, last.data, last.length);
  EXPECT_EQ(raw.cycle_echo, joint.cycle) << "the newest status is there";
}

TEST(Parameters, NonsenseIsNamed) {
  crux_joint_parameters joint = joint_parameters();
  EXPECT_EQ(crux_joint_parameters_fault(&joint), nullptr);
  joint.torque_limit_Nm = 0.0F;
  EXPECT_STREQ(crux_joint_parameters_fault(&joint), "torque_limit_Nm");
  joint = joint_parameters();
  joint.position_max_rad = kNaN;
  EXPECT_STREQ(crux_joint_parameters_fault(&joint), "position_min_rad, position_max_rad");
  joint = joint_parameters();
  joint.watchdog_cycles = 0;
  EXPECT_STREQ(crux_joint_parameters_fault(&joint), "watchdog_cycles");
  crux_gripper_parameters gripper = gripper_parameters();
  EXPECT_EQ(crux_gripper_parameters_fault(&gripper), nullptr);
  gripper.stiffness_N_m = -1.0F;
  EXPECT_STREQ(crux_gripper_parameters_fault(&gripper), "stiffness_N_m");
}

}  // namespace
}  // namespace crux::firmware
