// What a node believes: only whole, new, finite and sensible frames with its own identifier.
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

const JointCommand kMove{.position_rad = 0.25F, .torque_Nm = 2.0F};

// True when the frame, followed by a Sync, made the joint track.
bool obeys(Joint& joint, const crux_frame& frame) {
  joint.hear(frame);
  joint.sync();
  joint.tick();
  return joint.node.state == CRUX_STATE_TRACK;
}

TEST(Acceptance, TakesAWholeCommandWithItsSync) {
  Joint joint;
  EXPECT_TRUE(obeys(joint, frame_of(kMove, 77)));
  EXPECT_EQ(joint.node.link.counters.commands, 1U);
  EXPECT_EQ(joint.node.link.counters.syncs, 1U);
}

TEST(Acceptance, KnownCrcOfASealedFrame) {
  // Worked out by hand from the definition: an all-zero Sync of counter 0 covers 00 00 00 00 00 00 10 00.
  crux_frame frame = sync_frame(0, 0);
  unsigned crc = 0xFFFF;
  for (const unsigned byte : {0x00U, 0x00U, 0x00U, 0x00U, 0x00U, 0x00U, 0x10U, 0x00U}) {
    crc ^= byte << 8;
    for (int i = 0; i < 8; ++i) {
      crc = ((crc & 0x8000U) != 0U) ? ((crc << 1) ^ 0x1021U) & 0xFFFFU : (crc << 1) & 0xFFFFU;
    }
  }
  EXPECT_EQ(frame.data[0] | (frame.data[1] << 8), static_cast<int>(crc));
}

TEST(Acceptance, RejectsEveryFlippedBit) {
  const crux_frame whole = frame_of(kMove, 0);
  for (int bit = 0; bit < 16 * 8; ++bit) {
    Joint joint;
    crux_frame forged = whole;
    forged.data[bit / 8] = static_cast<std::uint8_t>(forged.data[bit / 8] ^ (1U << (bit % 8)));
    EXPECT_FALSE(obeys(joint, forged)) << "bit " << bit;
    EXPECT_EQ(joint.node.link.counters.rejected_crc, 1U) << "bit " << bit;
  }
}

TEST(Acceptance, RejectsEveryFlippedBitOfASync) {
  const crux_frame whole = sync_frame(9, 0);
  for (int bit = 0; bit < 8 * 8; ++bit) {
    Joint joint;
    crux_frame forged = whole;
    forged.data[bit / 8] = static_cast<std::uint8_t>(forged.data[bit / 8] ^ (1U << (bit % 8)));
    joint.command(kMove);
    joint.hear(forged);
    joint.tick();
    EXPECT_NE(joint.node.state, CRUX_STATE_TRACK) << "bit " << bit;
    EXPECT_FALSE(joint.node.guard.answer_due) << "bit " << bit;
  }
}

TEST(Acceptance, RejectsAFrameMeantForAnotherNode) {
  Joint joint;
  EXPECT_FALSE(obeys(joint, frame_of(kMove, 0, kJoint + 1)));
  EXPECT_EQ(joint.node.link.counters.rejected_crc, 0U) << "another node's frame is none of our business";
  crux_frame masquerade = frame_of(kMove, 0, kJoint + 1);
  masquerade.id = 0x100 + kJoint;
  EXPECT_FALSE(obeys(joint, masquerade));
  EXPECT_EQ(joint.node.link.counters.rejected_crc, 1U);
}

TEST(Acceptance, CounterMayStepOneToTheWindowAndNoFurther) {
  for (int step = 0; step < 256; ++step) {
    Joint joint;
    joint.hear(frame_of(JointCommand{.mode = CRUX_MODE_HOLD}, 200));
    joint.sync();
    joint.tick();
    const bool taken = obeys(joint, frame_of(kMove, static_cast<std::uint8_t>(200 + step)));
    EXPECT_EQ(taken, step >= 1 && step <= kWatchdogCycles) << "step " << step;
    EXPECT_EQ(joint.node.link.counters.rejected_counter, taken ? 0U : 1U) << "step " << step;
  }
}

TEST(Acceptance, AStaleFrameDoesNotMoveTheCounter) {
  Joint joint;
  joint.hear(frame_of(JointCommand{.mode = CRUX_MODE_HOLD}, 100));
  joint.sync();
  joint.tick();
  EXPECT_FALSE(obeys(joint, frame_of(kMove, 40)));
  EXPECT_TRUE(obeys(joint, frame_of(kMove, 101))) << "the sender's next frame must still fit";
}

TEST(Acceptance, AnyCounterIsTakenAfterTheWatchdogsTimeOfSilence) {
  for (const bool long_enough : {false, true}) {
    Joint joint;
    joint.run({.mode = CRUX_MODE_HOLD});
    for (int i = 0; i < kWatchdogCycles - (long_enough ? 0 : 1); ++i) {
      joint.sync();
      joint.tick();
    }
    EXPECT_EQ(obeys(joint, frame_of(kMove, 150)), long_enough);
  }
}

TEST(Acceptance, RejectsWrongLengths) {
  for (int length = 0; length <= 64; ++length) {
    Joint joint;
    crux_frame frame = frame_of(kMove, 0);
    frame.length = static_cast<std::uint8_t>(length);
    if (length >= 3) {
      seal(frame, 0);
    }
    EXPECT_EQ(obeys(joint, frame), length == 16) << "length " << length;
  }
}

TEST(Acceptance, DecodesNothingFromAFrameTooShort) {
  const crux_joint_parameters joint_limits = joint_parameters();
  const crux_gripper_parameters gripper_limits = gripper_parameters();
  for (std::uint8_t length = 0; length < 16; ++length) {
    crux_frame joint_frame = frame_of(kMove, 0);
    crux_frame gripper_frame = frame_of(GripperCommand{}, 0);
    joint_frame.length = length;
    gripper_frame.length = length;
    crux_joint_command joint_command{};
    crux_gripper_command gripper_command{};
    EXPECT_EQ(crux_joint_command_accept(&joint_frame, &joint_limits, &joint_command), CRUX_CAUSE_INVALID_COMMAND);
    EXPECT_EQ(crux_gripper_command_accept(&gripper_frame, &gripper_limits, &gripper_command),
              CRUX_CAUSE_INVALID_COMMAND);
  }
}

TEST(Acceptance, RejectsWhatIsNoPosition) {
  for (const float bad : {kNaN, std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()}) {
    Joint joint;
    EXPECT_FALSE(obeys(joint, frame_of(JointCommand{.position_rad = bad}, 0)));
    EXPECT_EQ(joint.node.link.counters.rejected_invalid, 1U);
    Gripper gripper;
    gripper.run({.opening_m = bad});
    EXPECT_NE(gripper.node.state, CRUX_STATE_TRACK);
    EXPECT_EQ(gripper.node.link.counters.rejected_invalid, 1U);
  }
}

TEST(Acceptance, RejectsUnknownModes) {
  for (unsigned mode = 3; mode < 16; ++mode) {
    Joint joint;
    EXPECT_FALSE(obeys(joint, frame_of(JointCommand{.mode = mode}, 0)));
    Gripper gripper;
    gripper.run({.mode = mode});
    EXPECT_EQ(gripper.node.state, CRUX_STATE_BOOT) << "mode " << mode;
  }
}

TEST(Acceptance, RejectsCommandsThatWouldLetGo) {
  Joint joint;
  EXPECT_FALSE(obeys(joint, frame_of(JointCommand{.kp = 0.0F}, 0)));
  Gripper gripper;
  gripper.run({.force_limit_N = 0.0F});
  EXPECT_NE(gripper.node.state, CRUX_STATE_TRACK);
}

TEST(Acceptance, ClampsToTheRangeAndSaysSo) {
  const crux_joint_parameters limits = joint_parameters();
  Joint joint;
  for (int i = 0; i < 2000; ++i) {
    joint.run({.position_rad = 9.0F, .velocity_rad_s = -30.0F});
    EXPECT_LE(joint.node.setpoint_rad, limits.position_max_rad);
  }
  EXPECT_NEAR(joint.node.setpoint_rad, limits.position_max_rad, 1e-5F);
  EXPECT_NEAR(joint.node.velocity_setpoint_rad_s, -limits.velocity_limit_rad_s, 1e-5F);
  EXPECT_EQ(joint.node.link.faults, 0x08 | 0x10);
  joint.run({.position_rad = 1.0F});
  EXPECT_EQ(joint.node.link.faults, 0) << "the bits last as long as the cause";
}

TEST(Acceptance, RoundingAtTheLimitIsNoFault) {
  Joint joint;
  joint.run({.position_rad = 1.5001F, .velocity_rad_s = 4.001F});
  EXPECT_EQ(joint.node.link.faults, 0);
}

TEST(Acceptance, ACommandWaitsForItsSync) {
  Joint joint;
  joint.tick();
  joint.command(kMove);
  EXPECT_FLOAT_EQ(joint.tick(), 0.0F);
  EXPECT_EQ(joint.node.state, CRUX_STATE_BOOT);
  joint.sync();
  EXPECT_GT(joint.tick(), 2.0F);
  EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
}

TEST(Acceptance, OfTwoCommandsForOneSyncNoneIsBelieved) {
  Joint joint;
  joint.run({.position_rad = 0.5F});
  joint.command({.position_rad = -1.0F});
  joint.command({.position_rad = 1.0F});
  joint.sync();
  joint.tick();
  EXPECT_FLOAT_EQ(joint.node.taken.position_rad, 0.5F);
  EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
  joint.run({.position_rad = -0.5F});
  EXPECT_FLOAT_EQ(joint.node.taken.position_rad, -0.5F) << "one for one again";
}

TEST(Acceptance, CommandsOfLostSyncsAreNoStrangers) {
  for (int lost = 0; lost < kWatchdogCycles - 1; ++lost) {
    Joint joint;
    joint.run({.position_rad = 0.5F});
    for (int i = 0; i < lost; ++i) {
      joint.command({.position_rad = 0.1F});
      ++joint.sync_counter;
      joint.tick();
    }
    joint.command({.position_rad = -1.0F});
    joint.sync();
    joint.tick();
    EXPECT_FLOAT_EQ(joint.node.taken.position_rad, -1.0F) << lost << " lost";
  }
}

TEST(Acceptance, AStrangerOnTheBusEndsInTheWatchdogsHold) {
  // Somebody else sends whole commands with counters of all kinds beside the host's: some fall into the window.
  Joint joint;
  Gripper gripper(0.02F);
  for (int cycle = 0; cycle < 20; ++cycle) {
    joint.run({.position_rad = 0.3F});
    gripper.run({.opening_m = 0.01F});
  }
  const float squeeze_N = gripper.tick();
  for (int cycle = 0; cycle < 256; ++cycle) {
    const auto guess = static_cast<std::uint8_t>(7 * cycle);
    joint.command({.position_rad = 0.3F});
    joint.hear(frame_of(JointCommand{.position_rad = -2.0F, .kp = 1.0F, .kd = 0.0F}, guess));
    joint.sync();
    joint.tick();
    gripper.command({.opening_m = 0.01F});
    gripper.hear(frame_of(GripperCommand{.opening_m = 0.066F, .force_limit_N = 60.0F}, guess));
    gripper.sync();
    EXPECT_GE(gripper.tick(), squeeze_N * 0.99F) << "cycle " << cycle;
    EXPECT_FLOAT_EQ(joint.node.position_gain_Nm_rad, 100.0F) << "cycle " << cycle;
  }
  EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
  EXPECT_TRUE(joint.node.latched);
  EXPECT_TRUE(gripper.node.latched);
}

TEST(Acceptance, TwoSyncsInAPeriodDoNotLetAStrangerIn) {
  Joint joint;
  joint.command({.position_rad = 0.4F});
  joint.sync();
  joint.command({.position_rad = 0.4F});
  joint.command({.position_rad = -2.0F});
  joint.sync();
  joint.tick();
  EXPECT_FLOAT_EQ(joint.node.taken.position_rad, 0.4F);
}

constexpr JointCommand kRogue{.torque_Nm = -12.0F, .kp = 0.01F, .kd = 0.0F};
constexpr GripperCommand kOpen{.opening_m = 0.066F, .force_limit_N = 0.02F};

// A second sender `ahead` of the host's next counter, before or after the host's command, with its own Sync or without.
struct SecondSender {
  int ahead;
  bool first;
  bool syncs;
};

class AgainstASecondSender : public testing::TestWithParam<SecondSender> {};

TEST_P(AgainstASecondSender, JointAndGripperHoldAndKeepWhatHeldThem) {
  const SecondSender sender = GetParam();
  Joint joint;
  Gripper gripper(0.02F);
  for (int cycle = 0; cycle < 200; ++cycle) {  // until the squeeze is there
    joint.run({.torque_Nm = 3.0F});
    gripper.run({.opening_m = 0.01F});
  }
  const float squeeze_N = gripper.tick();
  const auto disturb = [&](auto& node, const auto& rogue, bool first) {
    const auto counter = static_cast<std::uint8_t>(node.sync_counter + 1 + sender.ahead);  // the host's are alike
    if (first == sender.first) {
      node.hear(frame_of(rogue, counter));
    }
    if (first == sender.first && sender.syncs) {
      node.hear(sync_frame(node.cycle + 1, counter));
    }
  };
  const auto run = [&](auto& node, const auto& wanted, const auto& rogue) {
    disturb(node, rogue, true);
    node.command(wanted);
    disturb(node, rogue, false);
    node.sync();
    return node.tick();
  };
  for (int cycle = 0; cycle < 1500; ++cycle) {
    run(joint, JointCommand{.torque_Nm = 3.0F}, kRogue);
    const float force_N = run(gripper, GripperCommand{.opening_m = 0.01F}, kOpen);
    if (cycle > 0 || !sender.syncs) {  // its first command with a Sync of its own cannot be told from the host's
      ASSERT_FLOAT_EQ(joint.node.position_gain_Nm_rad, 100.0F) << "cycle " << cycle;
      ASSERT_FLOAT_EQ(joint.node.feedforward_Nm, 3.0F) << "cycle " << cycle;
      ASSERT_GE(force_N, squeeze_N * 0.99F) << "cycle " << cycle;
    }
  }
  EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
  EXPECT_TRUE(joint.node.latched);
  EXPECT_TRUE(gripper.node.latched);
  // It goes away: the host takes the nodes up again.
  for (int cycle = 0; cycle < 3 * kWatchdogCycles; ++cycle) {
    joint.run({.mode = CRUX_MODE_REARM});
    gripper.run({.mode = CRUX_MODE_REARM});
  }
  joint.run({.torque_Nm = 1.0F});
  gripper.run({.opening_m = 0.01F});
  EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
  EXPECT_FLOAT_EQ(joint.node.feedforward_Nm, 1.0F);
  EXPECT_EQ(gripper.node.state, CRUX_STATE_TRACK);
}

INSTANTIATE_TEST_SUITE_P(AllOrders, AgainstASecondSender,
                         testing::Values(SecondSender{0, true, false}, SecondSender{1, true, false},
                                         SecondSender{2, true, false}, SecondSender{4, true, false},
                                         SecondSender{0, false, false}, SecondSender{1, false, false},
                                         SecondSender{2, false, false}, SecondSender{0, true, true},
                                         SecondSender{1, true, true}, SecondSender{2, true, true},
                                         SecondSender{1, false, true}));

TEST(Acceptance, ASecondSenderIsShutOutWhereTheHostsCommandsAreLost) {
  Joint joint;
  joint.run({.torque_Nm = 3.0F});
  joint.hear(frame_of(kRogue, 2));
  joint.command({.torque_Nm = 3.0F});
  joint.sync();
  joint.tick();
  for (std::uint8_t counter = 3; counter < 3 + kWatchdogCycles - 1; ++counter) {
    joint.hear(frame_of(kRogue, counter));
    joint.sync();
    joint.tick();
    EXPECT_FLOAT_EQ(joint.node.position_gain_Nm_rad, 100.0F) << int{counter};
  }
  EXPECT_TRUE(joint.node.latched);
}

TEST(Acceptance, AFrameThatTheBusDeliversTwiceIsNoSecondSender) {
  Joint joint;
  for (std::uint8_t cycle = 1; cycle < 20; ++cycle) {
    const crux_frame command = frame_of(JointCommand{.torque_Nm = 0.1F * cycle}, cycle);
    const crux_frame sync = sync_frame(cycle, cycle);
    for (const crux_frame& frame : {command, command, sync, sync, command}) {
      joint.hear(frame);
    }
    joint.tick();
    EXPECT_FLOAT_EQ(joint.node.feedforward_Nm, 0.1F * cycle);
  }
  EXPECT_FALSE(joint.node.latched);
}

TEST(Acceptance, TheHostAloneOnALossyBusIsNoSecondSender) {
  for (unsigned lost = 0; lost < 1U << 8U; ++lost) {  // which of four commands and four Syncs
    Joint joint;
    joint.run({});
    for (unsigned cycle = 0; cycle < 4; ++cycle) {
      const JointCommand wanted{.torque_Nm = 1.0F + static_cast<float>(cycle)};
      ++joint.command_counter;
      ++joint.sync_counter;
      const bool heard = ((lost >> cycle) & 1U) == 0;
      if (heard) {
        joint.hear(frame_of(wanted, joint.command_counter));
      }
      if (((lost >> (4 + cycle)) & 1U) == 0) {
        joint.hear(sync_frame(cycle, joint.sync_counter));
        EXPECT_TRUE(!heard || joint.node.guard.take) << lost;
      }
      joint.tick();
    }
    EXPECT_FALSE(joint.node.latched) << lost;
  }
}

}  // namespace
}  // namespace crux::firmware
