// When a node stops by itself, how, and how it comes back.
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

constexpr std::uint8_t kTimeoutBit = 0x01;

TEST(Watchdog, FiresInExactlyTheLastAllowedPeriod) {
  Joint joint;
  joint.run({.position_rad = 0.0F});
  for (int missed = 1; missed < kWatchdogCycles; ++missed) {
    joint.tick();
    EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK) << missed << " missed";
  }
  joint.tick();
  EXPECT_NE(joint.node.state, CRUX_STATE_TRACK);
  EXPECT_EQ(joint.node.link.faults, kTimeoutBit);
  EXPECT_EQ(joint.node.link.counters.timeouts, 1U);
}

TEST(Watchdog, CountsTimeNotTicks) {
  // The same 10 ms in ticks of 1 ms and of 0.25 ms.
  for (const int parts : {2, 8}) {
    Joint joint;
    joint.run({});
    const float dt_s = kDt / static_cast<float>(parts);
    for (int i = 0; i < kWatchdogCycles * parts - 1; ++i) {
      joint.tick(dt_s);
    }
    EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
    joint.tick(dt_s);
    EXPECT_NE(joint.node.state, CRUX_STATE_TRACK);
  }
}

TEST(Watchdog, OneGoodCycleStartsTheCountAnew) {
  Joint joint;
  for (int round = 0; round < 20; ++round) {
    joint.run({});
    for (int missed = 1; missed < kWatchdogCycles; ++missed) {
      joint.tick();
    }
    EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
  }
}

TEST(Watchdog, SyncWithoutCommandAndCommandWithoutSyncAreSilence) {
  Joint without_command;
  Joint without_sync;
  without_command.run({});
  without_sync.run({});
  for (int i = 0; i < kWatchdogCycles; ++i) {
    without_command.sync();
    without_command.tick();
    without_sync.command({});
    without_sync.tick();
  }
  EXPECT_EQ(without_command.node.link.faults, kTimeoutBit);
  EXPECT_EQ(without_sync.node.link.faults, kTimeoutBit);
}

TEST(Watchdog, OnlyRearmLeadsBackToTrack) {
  Joint joint;
  joint.run({.torque_Nm = 3.0F});
  for (int i = 0; i < 100; ++i) {
    joint.tick();
  }
  ASSERT_EQ(joint.node.state, CRUX_STATE_HOLD);
  for (int i = 0; i < 10; ++i) {
    joint.run({.position_rad = 1.0F, .torque_Nm = -5.0F});
    EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
    joint.run({.mode = CRUX_MODE_HOLD});
    EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
  }
  EXPECT_EQ(joint.node.link.faults, kTimeoutBit);
  const float torque_Nm = joint.run({.mode = CRUX_MODE_REARM, .torque_Nm = -5.0F});
  EXPECT_FLOAT_EQ(torque_Nm, 3.0F) << "re-arming changes nothing about the hold";
  EXPECT_EQ(joint.node.link.faults, 0);
  EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
  joint.run({});
  EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
}

TEST(Watchdog, DoesNotLatchBeforeTrackingNorInAHoldThatWasAskedFor) {
  Joint joint;
  for (int i = 0; i < 50; ++i) {
    joint.tick();
  }
  EXPECT_EQ(joint.node.state, CRUX_STATE_BOOT);
  EXPECT_EQ(joint.node.link.faults, 0);
  joint.run({.mode = CRUX_MODE_HOLD});
  for (int i = 0; i < 50; ++i) {
    joint.tick();
  }
  EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
  EXPECT_EQ(joint.node.link.faults, 0);
  joint.run({});
  EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
}

// The way to rest after `velocity_rad_s`, with the joint following its setpoint.
struct Stop {
  int ticks = 0;
  float way_rad = 0.0F;
  float hardest_rad_s2 = 0.0F;
};

Stop stop_from(float velocity_rad_s, bool by_watchdog) {
  Joint joint;
  float target_rad = -1.5F;
  joint.inputs.position_rad = target_rad;
  for (int i = 0; i < 300; ++i) {
    target_rad += velocity_rad_s * kDt;
    joint.run({.position_rad = target_rad, .velocity_rad_s = velocity_rad_s});
  }
  EXPECT_NEAR(joint.node.setpoint_rate_rad_s, velocity_rad_s, 0.01F);
  for (int i = 1; by_watchdog && i < kWatchdogCycles; ++i) {
    joint.tick();
  }
  Stop stop;
  float before_rad = joint.node.setpoint_rad;
  float rate_rad_s = joint.node.setpoint_rate_rad_s;
  const float start_rad = before_rad;
  while (joint.node.state != CRUX_STATE_HOLD && stop.ticks < 1000) {
    if (by_watchdog) {
      joint.tick();
    } else {
      joint.run({.mode = CRUX_MODE_HOLD});
    }
    const float next_rate_rad_s = (joint.node.setpoint_rad - before_rad) / kDt;
    stop.hardest_rad_s2 = std::max(stop.hardest_rad_s2, std::abs(next_rate_rad_s - rate_rad_s) / kDt);
    rate_rad_s = next_rate_rad_s;
    before_rad = joint.node.setpoint_rad;
    ++stop.ticks;
  }
  stop.way_rad = joint.node.setpoint_rad - start_rad;
  return stop;
}

TEST(Watchdog, DeceleratesAsTheLimitSaysAndComesToRest) {
  // v^2 / 2a and v / a: 1 rad/s at 50 rad/s^2 stops in 10 mrad and 20 ms.
  const Stop watchdog = stop_from(1.0F, true);
  EXPECT_LE(watchdog.hardest_rad_s2, 50.0F * 1.01F);
  // While the commands are missing the lag filter has already slowed the setpoint: it stops within the bound.
  EXPECT_GT(watchdog.way_rad, 0.0F);
  EXPECT_LE(watchdog.way_rad, 0.0105F);
  EXPECT_LE(watchdog.ticks, 11);
  const Stop asked = stop_from(1.0F, false);
  EXPECT_LE(asked.hardest_rad_s2, 50.0F * 1.01F);
  EXPECT_NEAR(asked.way_rad, 0.01F, 0.0003F);
  EXPECT_NEAR(asked.ticks, 10, 1);
}

TEST(Watchdog, TheStopNeverLeavesTheRangeOfTheJoint) {
  Joint joint;
  joint.inputs.position_rad = 0.0F;
  for (int i = 0; i < 100000 && joint.node.setpoint_rad < 1.45F; ++i) {
    joint.run({.position_rad = 1.5F, .velocity_rad_s = 4.0F});
  }
  for (int i = 0; i < 500; ++i) {
    joint.tick();
    EXPECT_LE(joint.node.setpoint_rad, 1.5F);
  }
  EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
}

TEST(Watchdog, HoldKeepsFeedForwardAndGains) {
  Joint joint;
  joint.inputs.position_rad = 0.1F;
  float tracking_Nm = 0.0F;
  for (int i = 0; i < 200; ++i) {
    tracking_Nm = joint.run({.position_rad = 0.12F, .torque_Nm = 5.0F, .kp = 150.0F, .kd = 2.0F});
  }
  EXPECT_NEAR(tracking_Nm, 150.0F * 0.02F + 5.0F, 1e-3F);
  for (int i = 0; i < 5000; ++i) {
    const float torque_Nm = joint.tick();
    EXPECT_NEAR(torque_Nm, tracking_Nm, 1e-3F) << "the hold takes over without a step and never lets go";
  }
  joint.inputs.velocity_rad_s = 0.5F;
  EXPECT_NEAR(joint.tick(), tracking_Nm - 2.0F * 0.5F, 1e-3F);
}

TEST(Watchdog, TimeoutIsReportedOnceWithTheMissedTime) {
  Joint joint;
  joint.run({});
  take_all(joint.node.link);
  for (int i = 0; i < 500; ++i) {
    joint.tick();
    const auto frames = take_all(joint.node.link);
    const auto emergency = frames.find(0x080 + kJoint);
    EXPECT_EQ(emergency != frames.end(), i == kWatchdogCycles - 1) << "tick " << i;
    if (emergency != frames.end()) {
      crux_can_joint_emergency_t raw{};
      crux_can_joint_emergency_unpack(&raw, emergency->second.data, emergency->second.length);
      EXPECT_EQ(raw.cause, CRUX_CAUSE_COMMAND_TIMEOUT);
      EXPECT_EQ(raw.detail, 10000U);
    }
  }
}

TEST(Watchdog, GripperKeepsSqueezingAndWaitsForRearm) {
  Gripper gripper;
  float tracking_N = 0.0F;
  for (int i = 0; i < 200; ++i) {
    tracking_N = gripper.run({.opening_m = 0.0288F, .force_limit_N = 40.0F});
  }
  EXPECT_NEAR(tracking_N, 20000.0F * 0.0012F, 0.05F);
  for (int i = 0; i < 5000; ++i) {
    EXPECT_NEAR(gripper.tick(), tracking_N, 0.05F);
  }
  EXPECT_EQ(gripper.node.state, CRUX_STATE_HOLD);
  EXPECT_EQ(gripper.node.link.faults, kTimeoutBit);
  EXPECT_NEAR(gripper.run({.opening_m = 0.06F}), tracking_N, 0.05F) << "latched: no command opens it";
  gripper.run({.mode = CRUX_MODE_REARM});
  EXPECT_EQ(gripper.node.link.faults, 0);
  gripper.run({.opening_m = 0.06F});
  EXPECT_EQ(gripper.node.state, CRUX_STATE_TRACK);
}

}  // namespace
}  // namespace crux::firmware
