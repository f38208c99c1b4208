// The guard by itself, to the microsecond and to the last bit: what the nodes' tests are too coarse to see.
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

constexpr std::uint32_t kPeriod = 2000;
constexpr std::uint32_t kLimit = kPeriod * kWatchdogCycles;

struct Guard {
  crux_guard guard{};
  std::uint8_t counter = 0;

  Guard() { crux_guard_init(&guard, kPeriod, kWatchdogCycles); }
  void good_period(std::uint32_t dt_us = kPeriod) {
    ++counter;
    const crux_frame command = frame_of(JointCommand{}, counter);
    const crux_frame sync = sync_frame(counter, counter);
    ASSERT_EQ(crux_guard_command(&guard, &command, 16), CRUX_CAUSE_NONE);
    guard.command_waiting = true;
    ASSERT_EQ(crux_guard_sync(&guard, &sync), CRUX_CAUSE_NONE);
    ASSERT_FALSE(crux_guard_tick(&guard, dt_us));
  }
};

TEST(Guard, TripsInTheMicrosecondOfTheLimitAndInNoOther) {
  for (const std::uint32_t early : {1U, 17U, kPeriod, kLimit - 1}) {
    Guard guard;
    guard.good_period();
    EXPECT_FALSE(crux_guard_tick(&guard.guard, kLimit - early));
    EXPECT_EQ(guard.guard.silent_us, kLimit - early);
    EXPECT_TRUE(crux_guard_tick(&guard.guard, early));
    for (int i = 0; i < 20; ++i) {
      EXPECT_FALSE(crux_guard_tick(&guard.guard, kPeriod)) << "tripped twice";
    }
  }
}

TEST(Guard, IsCommandedUntilTheMicrosecondOfTheLimit) {
  Guard guard;
  guard.good_period();
  EXPECT_TRUE(crux_guard_is_commanded(&guard.guard));
  (void)crux_guard_tick(&guard.guard, kLimit - 1);
  EXPECT_TRUE(crux_guard_is_commanded(&guard.guard));
  (void)crux_guard_tick(&guard.guard, 1);
  EXPECT_FALSE(crux_guard_is_commanded(&guard.guard));
  guard.good_period();
  EXPECT_TRUE(crux_guard_is_commanded(&guard.guard));
}

TEST(Guard, SilenceSaturatesAtTheLimit) {
  Guard guard;
  guard.good_period();
  for (int i = 0; i < 50; ++i) {
    (void)crux_guard_tick(&guard.guard, 3000);
    EXPECT_LE(guard.guard.silent_us, kLimit);
    EXPECT_LE(guard.guard.sync.silent_us, kLimit);
  }
  (void)crux_guard_tick(&guard.guard, UINT32_MAX);
  EXPECT_EQ(guard.guard.command.silent_us, kLimit);
}

TEST(Guard, ForgetsACounterInTheMicrosecondOfTheLimit) {
  const crux_frame restarted = sync_frame(9, 200);
  Guard guard;
  guard.good_period();
  (void)crux_guard_tick(&guard.guard, kLimit - 1);
  EXPECT_EQ(crux_guard_sync(&guard.guard, &restarted), CRUX_CAUSE_E2E_COUNTER);
  (void)crux_guard_tick(&guard.guard, 1);
  EXPECT_EQ(crux_guard_sync(&guard.guard, &restarted), CRUX_CAUSE_NONE);
}

TEST(Guard, ASyncIsAnsweredWithItsOwnCycle) {
  Guard guard;
  const crux_frame sync = sync_frame(0xABCD1234, 7);
  EXPECT_FALSE(guard.guard.answer_due);
  EXPECT_EQ(crux_guard_sync(&guard.guard, &sync), CRUX_CAUSE_NONE);
  EXPECT_TRUE(guard.guard.answer_due);
  EXPECT_EQ(guard.guard.cycle, 0xABCD1234U);
}

TEST(Guard, AFrameOfNothingButItsProtectionIsWhole) {
  crux_frame frame{};
  frame.id = 0x123;
  frame.length = 3;
  seal(frame, 42);
  crux_e2e_receiver receiver{};
  EXPECT_EQ(crux_e2e_check(frame.id, frame.data, frame.length, &receiver), CRUX_E2E_OK);
  EXPECT_EQ(receiver.counter, 42);
}

TEST(Guard, AMeasurementMakesSenseWithinItsLimitsOnly) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (const float good : {-1.0F, 0.0F, 2.0F}) {
    EXPECT_TRUE(crux_makes_sense(good, -1.0F, 2.0F)) << good;
  }
  for (const float bad : {-1.0001F, 2.0001F, 1e38F, kNaN, kInfinity, -kInfinity}) {
    EXPECT_FALSE(crux_makes_sense(bad, -1.0F, 2.0F)) << bad;
  }
}

TEST(Guard, ASecondSenderStopsTheNodeAtOnceAndForTheWatchdogsTime) {
  // Counters the last good one is ahead of by no more than the window show a second sender, others are only stale.
  for (const int behind : {0, 1, kWatchdogCycles, kWatchdogCycles + 1}) {
    Guard guard;
    for (int i = 0; i < 10; ++i) {
      guard.good_period();
    }
    const bool shown = behind <= kWatchdogCycles;
    const crux_frame other =
        frame_of(JointCommand{.torque_Nm = 1.0F}, static_cast<std::uint8_t>(guard.counter - behind));
    EXPECT_EQ(crux_guard_command(&guard.guard, &other, 16), CRUX_CAUSE_E2E_COUNTER);
    EXPECT_EQ(crux_guard_has_rival(&guard.guard), shown);
    EXPECT_EQ(crux_guard_tick(&guard.guard, kPeriod), shown) << behind;
    EXPECT_EQ(crux_guard_is_commanded(&guard.guard), true) << "two command";
    if (shown) {
      EXPECT_FALSE(crux_guard_tick(&guard.guard, kLimit - kPeriod - 1)) << "tripped twice";
      EXPECT_TRUE(crux_guard_has_rival(&guard.guard));
      EXPECT_TRUE(crux_guard_is_commanded(&guard.guard));
      EXPECT_FALSE(crux_guard_tick(&guard.guard, 1));
      EXPECT_FALSE(crux_guard_has_rival(&guard.guard));
      EXPECT_FALSE(crux_guard_is_commanded(&guard.guard));
    }
  }
}

TEST(Guard, SensorsThatReadNonsenseAreLostAndTheHoldStays) {
  Joint joint;
  joint.run({.position_rad = 0.0F, .torque_Nm = 3.0F});
  const float torque = joint.run({.position_rad = 0.0F, .torque_Nm = 3.0F});
  joint.inputs.position_rad = 1e30F;
  EXPECT_NEAR(joint.run({.position_rad = 0.0F}), torque, 1e-3F);
  EXPECT_EQ(joint.node.state, CRUX_STATE_FAULT);
  Gripper gripper(0.02F);
  for (int i = 0; i < 200; ++i) {
    gripper.run({.opening_m = 0.01F});
  }
  const float squeeze = gripper.tick();
  gripper.inputs.speed_m_s = -1e30F;
  EXPECT_NEAR(gripper.run({.opening_m = 0.01F}), squeeze, 1e-3F);
  EXPECT_EQ(gripper.node.state, CRUX_STATE_FAULT);
}

struct Excess {
  float asked;
  bool reported;
};

TEST(Guard, ClampsByMoreThanAThousandthOfTheRangeAreReported) {
  const crux_joint_parameters joint = joint_parameters();  // range 3.5 rad
  for (const Excess excess :
       {Excess{1.5F + 0.0030F, false}, {1.5F + 0.0040F, true}, {-2.0F - 0.0030F, false}, {-2.0F - 0.0040F, true}}) {
    const crux_frame frame = frame_of(JointCommand{.position_rad = excess.asked}, 0);
    crux_joint_command command{};
    ASSERT_EQ(crux_joint_command_accept(&frame, &joint, &command), CRUX_CAUSE_NONE);
    EXPECT_EQ(command.position_clamped, excess.reported) << excess.asked;
    EXPECT_GE(command.position_rad, joint.position_min_rad);
    EXPECT_LE(command.position_rad, joint.position_max_rad);
  }
  const crux_gripper_parameters gripper = gripper_parameters();  // range 58 mm
  for (const Excess excess : {Excess{0.066F + 50e-6F, false},
                              {0.066F + 66e-6F, true},
                              {0.07F, true},
                              {0.008F - 50e-6F, false},
                              {0.008F - 66e-6F, true},
                              {0.03F, false}}) {
    const crux_frame frame = frame_of(GripperCommand{.opening_m = excess.asked}, 0);
    crux_gripper_command command{};
    ASSERT_EQ(crux_gripper_command_accept(&frame, &gripper, &command), CRUX_CAUSE_NONE);
    EXPECT_EQ(command.opening_clamped, excess.reported) << excess.asked;
  }
}

}  // namespace
}  // namespace crux::firmware
