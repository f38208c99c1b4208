// The broadcast, command and Sync in one: what a node takes out of it, what it answers, and whom it does not believe.
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

constexpr std::uint32_t kPeriod = 2000;

template <typename Node>
void broadcast(Node& node, const Broadcast& all, std::uint16_t cycle, std::uint8_t counter) {
  node.hear(frame_of(all, cycle, counter));
}

crux_joint_command accepted(const Broadcast& all, std::uint8_t node, std::uint8_t cause = CRUX_CAUSE_NONE) {
  const crux_joint_parameters parameters = joint_parameters();
  const crux_frame frame = frame_of(all, 1, 1);
  crux_joint_command command{};
  EXPECT_EQ(crux_joint_broadcast_accept(&frame, node, &parameters, &command), cause);
  return command;
}

TEST(Broadcast, EveryJointTakesItsOwnPart) {
  for (std::uint8_t node = 1; node <= 6; ++node) {
    const JointCommand asked{
        .position_rad = 0.12345F, .velocity_rad_s = -1.5F, .torque_Nm = -2.345F, .kp = 60.0F, .kd = 1.05F};
    const crux_joint_command command = accepted({.joint = asked, .node = node, .gripper = {}}, node);
    EXPECT_EQ(command.mode, CRUX_MODE_TRACK);
    EXPECT_FLOAT_EQ(command.position_rad, 0.12345F);
    EXPECT_FLOAT_EQ(command.velocity_rad_s, -1.5F);
    EXPECT_FLOAT_EQ(command.torque_Nm, -2.345F);
    EXPECT_FLOAT_EQ(command.position_gain_Nm_rad, 60.0F);
    EXPECT_FLOAT_EQ(command.velocity_gain_Nms_rad, 1.05F);
    EXPECT_FALSE(command.position_clamped || command.velocity_clamped);
    const std::uint8_t other = static_cast<std::uint8_t>(1 + (node % 6));
    EXPECT_EQ(accepted({.joint = asked, .node = node, .gripper = {}}, other).mode, CRUX_MODE_REARM);
  }
}

TEST(Broadcast, HasNoPartForASeventhJoint) {
  accepted({.joint = {}, .gripper = {}}, CRUX_CAN_NODE_OF_JOINT(6U), CRUX_CAUSE_INVALID_COMMAND);
}

TEST(Broadcast, AJointsPartIsJudgedAsACommandOfItsOwn) {
  EXPECT_EQ(accepted({.joint = {.position_rad = -3.0F, .velocity_rad_s = 5.0F, .torque_Nm = 20.0F}}, kJoint).torque_Nm,
            10.0F);
  const crux_joint_command clamped = accepted({.joint = {.position_rad = -3.0F, .velocity_rad_s = 5.0F}}, kJoint);
  EXPECT_EQ(clamped.position_rad, -2.0F);
  EXPECT_EQ(clamped.velocity_rad_s, 4.0F);
  EXPECT_TRUE(clamped.position_clamped && clamped.velocity_clamped);
  accepted({.joint = {.kp = 0.0F}}, kJoint, CRUX_CAUSE_INVALID_COMMAND);
  accepted({.joint = {.mode = CRUX_MODE_HOLD, .kp = 0.0F}}, kJoint);
  accepted({.joint = {.mode = 3}}, kJoint, CRUX_CAUSE_INVALID_COMMAND);
}

TEST(Broadcast, TheGrippersPartIsJudgedAsACommandOfItsOwn) {
  const crux_gripper_parameters parameters = gripper_parameters();
  const auto judged = [&](const GripperCommand& asked, std::uint8_t cause) {
    const crux_frame frame = frame_of(Broadcast{.joint = {}, .gripper = asked}, 1, 1);
    crux_gripper_command command{};
    EXPECT_EQ(crux_gripper_broadcast_accept(&frame, &parameters, &command), cause);
    return command;
  };
  const crux_gripper_command good =
      judged({.opening_m = 0.030005F, .speed_limit_m_s = 0.0123F, .force_limit_N = 30.02F}, CRUX_CAUSE_NONE);
  EXPECT_EQ(good.mode, CRUX_MODE_TRACK);
  EXPECT_FLOAT_EQ(good.opening_m, 0.030005F);
  EXPECT_FLOAT_EQ(good.speed_limit_m_s, 0.0123F);
  EXPECT_FLOAT_EQ(good.force_limit_N, 30.02F);
  const crux_gripper_command clamped =
      judged({.opening_m = 0.08F, .speed_limit_m_s = 0.1F, .force_limit_N = 300.0F}, CRUX_CAUSE_NONE);
  EXPECT_TRUE(clamped.opening_clamped);
  EXPECT_EQ(clamped.speed_limit_m_s, 0.02F);
  EXPECT_EQ(clamped.force_limit_N, 60.0F);
  judged({.force_limit_N = 0.0F}, CRUX_CAUSE_INVALID_COMMAND);
  judged({.mode = 3}, CRUX_CAUSE_INVALID_COMMAND);
  judged({.mode = CRUX_MODE_REARM, .force_limit_N = 0.0F}, CRUX_CAUSE_NONE);
}

TEST(Broadcast, AShortOneIsNoCommand) {
  const crux_joint_parameters joint = joint_parameters();
  const crux_gripper_parameters gripper = gripper_parameters();
  crux_frame frame = frame_of(Broadcast{}, 1, 1);
  frame.length = 48;
  seal(frame, 1);
  crux_joint_command joint_command{};
  crux_gripper_command gripper_command{};
  EXPECT_EQ(crux_joint_broadcast_accept(&frame, 1, &joint, &joint_command), CRUX_CAUSE_INVALID_COMMAND);
  EXPECT_EQ(crux_gripper_broadcast_accept(&frame, &gripper, &gripper_command), CRUX_CAUSE_INVALID_COMMAND);
  Joint node;
  node.hear(frame);
  EXPECT_FALSE(node.node.guard.answer_due);
  EXPECT_EQ(node.node.link.counters.rejected_invalid, 1U);
}

TEST(Broadcast, IsTakenOverAtOnceAndAnsweredWithItsCycle) {
  Joint joint;
  broadcast(joint, {.joint = {.position_rad = 0.1F, .torque_Nm = 2.0F}}, 0xBEEF, 9);
  EXPECT_TRUE(joint.node.guard.take);
  EXPECT_GT(joint.tick(), 2.0F);
  EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
  crux_joint_node_publish(&joint.node, &joint.inputs);
  const auto frames = take_all(joint.node.link);
  ASSERT_EQ(frames.count(0x183), 1U);
  const crux_frame& status = frames.find(0x183)->second;
  EXPECT_EQ(status.data[12] | (status.data[13] << 8), 0xBEEF);
  EXPECT_EQ(joint.node.link.counters.syncs, 1U);
  EXPECT_EQ(joint.node.link.counters.commands, 1U);
}

TEST(Broadcast, TheGripperAnswersWithStatusAndWrenchInOneFrame) {
  Gripper gripper;
  gripper.inputs.wrench[2] = -12.5F;
  gripper.inputs.force_N = 3.0F;
  broadcast(gripper, {}, 77, 1);
  gripper.tick();
  crux_gripper_node_publish(&gripper.node, &gripper.inputs);
  auto frames = take_all(gripper.node.link);
  EXPECT_EQ(frames.count(0x187) + frames.count(0x1C7), 0U);
  ASSERT_EQ(frames.count(0x1A7), 1U);
  const crux_frame& frame = frames.find(0x1A7)->second;
  EXPECT_EQ(frame.length, 32);
  EXPECT_EQ(frame.data[3] & 0xF, CRUX_STATE_TRACK);
  EXPECT_EQ(frame.data[12], 77);
  EXPECT_EQ(frame.data[16], 0);
  EXPECT_EQ(static_cast<std::int16_t>(frame.data[10] | (frame.data[11] << 8)), 300);
  EXPECT_EQ(static_cast<std::int16_t>(frame.data[21] | (frame.data[22] << 8)), -1250);
  gripper.inputs.wrench_valid = false;
  gripper.sync();
  crux_gripper_node_publish(&gripper.node, &gripper.inputs);
  frames = take_all(gripper.node.link);
  EXPECT_EQ(frames.count(0x187) + frames.count(0x1C7), 2U);
  EXPECT_EQ(frames.count(0x1A7), 0U);
}

TEST(Broadcast, SenselessContentIsASyncAllTheSame) {
  Joint joint;
  broadcast(joint, {.joint = {.torque_Nm = 1.0F}}, 1, 1);
  joint.tick();
  broadcast(joint, {.joint = {.torque_Nm = 5.0F, .kp = 0.0F}}, 2, 2);
  EXPECT_FALSE(joint.node.guard.take);
  EXPECT_TRUE(joint.node.guard.answer_due);
  EXPECT_EQ(joint.node.guard.cycle, 2U);
  EXPECT_EQ(joint.node.taken.torque_Nm, 1.0F);
  EXPECT_EQ(joint.node.link.counters.rejected_invalid, 1U);
  Gripper gripper;
  broadcast(gripper, {.gripper = {.force_limit_N = 0.0F}}, 2, 2);
  EXPECT_FALSE(gripper.node.guard.take);
  EXPECT_EQ(gripper.node.link.counters.rejected_invalid, 1U);
}

TEST(Broadcast, EverySingleBitErrorIsRejected) {
  const crux_frame good = frame_of(Broadcast{}, 1, 1);
  Joint joint;
  Gripper gripper;
  for (unsigned bit = 0; bit < 512; ++bit) {
    crux_frame bad = good;
    bad.data[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    joint.hear(bad);
    gripper.hear(bad);
  }
  EXPECT_EQ(joint.node.link.counters.rejected_crc, 512U);
  EXPECT_EQ(gripper.node.link.counters.rejected_crc, 512U);
  EXPECT_FALSE(joint.node.guard.answer_due || gripper.node.guard.answer_due);
}

TEST(Broadcast, SilenceStopsTheNode) {
  Joint joint;
  broadcast(joint, {}, 1, 1);
  joint.tick();
  for (int i = 1; i < kWatchdogCycles; ++i) {
    joint.tick();
    EXPECT_FALSE(joint.node.latched);
  }
  joint.tick();
  EXPECT_TRUE(joint.node.latched);
}

TEST(Broadcast, ItsCounterIsForgottenInTheMicrosecondOfTheLimit) {
  const crux_frame first = frame_of(Broadcast{}, 1, 1);
  const crux_frame restarted = frame_of(Broadcast{}, 2, 200);
  crux_guard guard{};
  crux_guard_init(&guard, kPeriod, kWatchdogCycles);
  EXPECT_EQ(crux_guard_broadcast(&guard, &first, true), CRUX_CAUSE_NONE);
  (void)crux_guard_tick(&guard, kPeriod);
  (void)crux_guard_tick(&guard, (kPeriod * kWatchdogCycles) - 1);
  EXPECT_EQ(crux_guard_broadcast(&guard, &restarted, true), CRUX_CAUSE_E2E_COUNTER);
  EXPECT_EQ(crux_guard_broadcast(&guard, &first, true), CRUX_CAUSE_E2E_COUNTER);
  (void)crux_guard_tick(&guard, 1);
  EXPECT_EQ(crux_guard_broadcast(&guard, &restarted, true), CRUX_CAUSE_NONE);
}

TEST(Broadcast, AFreshOneStaysFreshWhateverComesInItsPeriod) {
  const crux_frame first = frame_of(Broadcast{}, 1, 1);
  const crux_frame second = frame_of(Broadcast{}, 2, 2);
  crux_guard guard{};
  crux_guard_init(&guard, kPeriod, kWatchdogCycles);
  (void)crux_guard_broadcast(&guard, &first, true);
  EXPECT_TRUE(guard.command_fresh);
  (void)crux_guard_broadcast(&guard, &second, false);
  EXPECT_FALSE(guard.take);
  EXPECT_TRUE(guard.command_fresh);
}

TEST(Broadcast, OfTwoThatBroadcastNoneIsObeyed) {
  Joint joint;
  broadcast(joint, {}, 1, 1);
  joint.tick();
  for (std::uint8_t i = 2; i < 12; ++i) {
    broadcast(joint, {.joint = {.torque_Nm = 9.0F}}, i, static_cast<std::uint8_t>(100 + i));
    broadcast(joint, {}, i, i);
    EXPECT_FALSE(joint.node.guard.take);
    EXPECT_EQ(joint.node.taken.torque_Nm, 0.0F);
    joint.tick();
  }
  EXPECT_TRUE(joint.node.latched);
}

TEST(Broadcast, ASecondSenderOneAheadIsNotObeyedAndLeavesNothingBehind) {
  for (const bool first : {true, false}) {
    Joint joint;
    Gripper gripper(0.02F);
    std::uint8_t counter = 1;
    const auto hear = [&](const Broadcast& all, int ahead) {
      const auto number = static_cast<std::uint8_t>(counter + ahead);
      broadcast(joint, all, number, number);
      broadcast(gripper, all, number, number);
    };
    const Broadcast host{.joint = {.torque_Nm = 3.0F}, .gripper = {.opening_m = 0.01F}};
    const Broadcast rogue{.joint = {.torque_Nm = -12.0F, .kp = 2.0F},
                          .gripper = {.opening_m = 0.066F, .force_limit_N = 0.02F}};
    for (; counter < 200; ++counter) {
      hear(host, 0);
      joint.tick();
      gripper.tick();
    }
    const float squeeze_N = gripper.tick();
    for (int cycle = 0; cycle < 300; ++cycle, ++counter) {
      if (first) {
        hear(rogue, 1);
      }
      hear(host, 0);
      if (!first) {
        hear(rogue, 1);
      }
      joint.tick();
      gripper.tick();
      if (cycle > 0) {  // the very first one after the host's own cannot be told from it
        ASSERT_FLOAT_EQ(joint.node.position_gain_Nm_rad, 100.0F) << cycle;
        ASSERT_FLOAT_EQ(joint.node.feedforward_Nm, 3.0F) << cycle;
        ASSERT_GE(gripper.tick(0.0001F), squeeze_N * 0.99F) << cycle;
      }
    }
    EXPECT_TRUE(joint.node.latched && gripper.node.latched);
  }
}

TEST(Broadcast, ARearmThatTheHostHasNotSentLeavesTheNodeLatched) {
  Joint joint;
  broadcast(joint, {}, 1, 1);
  for (int i = 0; i <= kWatchdogCycles; ++i) {
    joint.tick();
  }
  broadcast(joint, {}, 2, 2);
  joint.tick();
  EXPECT_TRUE(joint.node.latched);
  broadcast(joint, {.joint = {.mode = CRUX_MODE_REARM}}, 3, 3);
  EXPECT_TRUE(joint.node.guard.take);
  broadcast(joint, {}, 3, 3);  // the host's own, in the same period
  joint.tick();
  EXPECT_TRUE(joint.node.latched);
}

TEST(Broadcast, AfterASecondSenderNoneIsObeyedForTheWatchdogsTime) {
  Joint joint;
  broadcast(joint, {}, 1, 1);
  joint.tick();
  broadcast(joint, {.joint = {.torque_Nm = 9.0F}}, 1, 1);
  for (std::uint8_t i = 2; i < 2 + kWatchdogCycles; ++i) {
    broadcast(joint, {}, i, i);
    EXPECT_FALSE(joint.node.guard.take) << int{i};
    joint.tick();
  }
  broadcast(joint, {}, 2 + kWatchdogCycles, 2 + kWatchdogCycles);
  EXPECT_TRUE(joint.node.guard.take);
}

TEST(Broadcast, LostOnesAreNoStranger) {
  Joint joint;
  for (const std::uint8_t counter : {1, 2, 5, 10, 11}) {
    broadcast(joint, {}, counter, counter);
    EXPECT_TRUE(joint.node.guard.take) << int{counter};
    joint.tick();
  }
}

TEST(Broadcast, WhereCommandsComeBothWaysNoneIsObeyed) {
  Joint joint;
  joint.run({.torque_Nm = 1.0F});
  broadcast(joint, {.joint = {.torque_Nm = 9.0F}}, 9, 9);
  EXPECT_FALSE(joint.node.guard.take);
  EXPECT_EQ(joint.node.taken.torque_Nm, 1.0F);
  joint.command({.torque_Nm = 2.0F});
  joint.sync();
  EXPECT_FALSE(joint.node.guard.take);
  EXPECT_EQ(joint.node.taken.torque_Nm, 1.0F);
  Joint other;
  broadcast(other, {.joint = {.torque_Nm = 3.0F}}, 1, 1);
  other.tick();
  other.sync();  // a Sync alone is no command: it wakes nodes up
  EXPECT_FALSE(other.node.guard.take);
  broadcast(other, {.joint = {.torque_Nm = 4.0F}}, 2, 2);
  EXPECT_TRUE(other.node.guard.take);
  EXPECT_EQ(other.node.taken.torque_Nm, 4.0F);
}

TEST(Broadcast, TheWayMayChangeAfterTheWatchdogsTime) {
  Joint joint;
  joint.run({});
  for (int i = 0; i < kWatchdogCycles; ++i) {
    joint.tick();
  }
  broadcast(joint, {}, 1, 1);
  EXPECT_TRUE(joint.node.guard.take);
  for (int i = 0; i <= kWatchdogCycles; ++i) {
    joint.tick();
  }
  joint.command({});
  joint.sync();
  EXPECT_TRUE(joint.node.guard.take);
}

}  // namespace
}  // namespace crux::firmware
