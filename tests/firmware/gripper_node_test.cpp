// Position loop of the gripper, its holds, and the F/T sensor's way to the bus.
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

TEST(GripperNode, ForceIsTheClosedForm) {
  Gripper gripper(0.03F);
  gripper.inputs.speed_m_s = 0.005F;
  // After n periods the setpoint has moved by n * speed limit * dt: F = K (o - s) + D v.
  for (int n = 1; n <= 20; ++n) {
    const float force_N = gripper.run({.opening_m = 0.02F, .speed_limit_m_s = 0.01F, .force_limit_N = 50.0F});
    EXPECT_NEAR(force_N, 20000.0F * 0.01F * static_cast<float>(n) * kDt + 200.0F * 0.005F, 0.02F);
  }
}

TEST(GripperNode, SpeedIsLimitedByCommandAndByActuator) {
  for (const float asked_m_s : {0.004F, 0.5F}) {
    Gripper gripper(0.03F);
    const float allowed_m_s = std::min(asked_m_s, 0.02F);
    float before_m = 0.03F;
    for (int i = 0; i < 50; ++i) {
      gripper.run({.opening_m = 0.06F, .speed_limit_m_s = asked_m_s, .force_limit_N = 60.0F});
      EXPECT_NEAR(gripper.node.setpoint_m - before_m, allowed_m_s * kDt, 1e-7F);
      before_m = gripper.node.setpoint_m;
      gripper.inputs.opening_m = before_m;
    }
  }
}

TEST(GripperNode, ForceIsLimitedByCommandAndByActuator) {
  for (const float asked_N : {12.0F, 500.0F}) {
    Gripper gripper(0.03F);
    float force_N = 0.0F;
    for (int i = 0; i < 2000; ++i) {
      force_N = gripper.run({.opening_m = 0.008F, .force_limit_N = asked_N});
    }
    EXPECT_NEAR(force_N, std::min(asked_N, 60.0F), 1e-3F);
  }
}

TEST(GripperNode, AReleaseDoesNotWaitForAWoundUpSetpoint) {
  Gripper gripper(0.03F);
  for (int i = 0; i < 2000; ++i) {
    gripper.run({.opening_m = 0.008F, .force_limit_N = 30.0F});
  }
  // 30 N at 20 kN/m are 1.5 mm; at 20 mm/s the force is gone after 75 ms, 38 periods.
  int periods = 0;
  while (gripper.run({.opening_m = 0.048F, .force_limit_N = 30.0F}) > 0.0F) {
    ASSERT_LE(++periods, 38);
  }
  EXPECT_GE(periods, 36);
}

TEST(GripperNode, HoldNeverPushesOpen) {
  Gripper gripper(0.03F);
  for (int i = 0; i < 50; ++i) {
    gripper.run({.opening_m = 0.06F});
    gripper.inputs.opening_m = gripper.node.setpoint_m - 0.0005F;
  }
  EXPECT_LT(gripper.run({.opening_m = 0.06F}), 0.0F) << "an opening gripper pushes";
  for (int i = 0; i < 50; ++i) {
    EXPECT_GE(gripper.run({.mode = CRUX_MODE_HOLD, .opening_m = 0.06F}), 0.0F);
  }
  gripper.inputs.opening_m = gripper.node.setpoint_m + 0.0005F;
  EXPECT_NEAR(gripper.tick(), 10.0F, 0.1F) << "but it resists being pried open";
}

TEST(GripperNode, BootHoldsTheFirstOpeningMeasured) {
  Gripper gripper(0.03F);
  EXPECT_FLOAT_EQ(gripper.tick(), 0.0F);
  gripper.inputs.opening_m = 0.0305F;
  EXPECT_NEAR(gripper.tick(), 10.0F, 0.1F);
}

TEST(GripperNode, ALostSensorKeepsTheSqueezeUntilRearmed) {
  Gripper gripper(0.03F);
  for (int i = 0; i < 500; ++i) {
    gripper.run({.opening_m = 0.029F});
  }
  gripper.inputs.opening_m = kNaN;
  for (int i = 0; i < 100; ++i) {
    EXPECT_NEAR(gripper.run({.opening_m = 0.06F}), 20.0F, 0.05F);
    EXPECT_EQ(gripper.node.state, CRUX_STATE_FAULT);
  }
  gripper.inputs.opening_m = 0.0295F;
  EXPECT_NEAR(gripper.run({.mode = CRUX_MODE_REARM}), 20.0F, 0.05F);
  EXPECT_EQ(gripper.node.state, CRUX_STATE_HOLD);
}

crux_can_force_torque_t sample_of(Gripper& gripper) {
  gripper.sync();
  crux_gripper_node_publish(&gripper.node, &gripper.inputs);
  const auto frames = take_all(gripper.node.link);
  EXPECT_EQ(frames.count(0x1C7), 1U);
  EXPECT_EQ(frames.count(0x187), 1U);
  const crux_frame& frame = frames.find(0x1C7)->second;
  EXPECT_EQ(frame.data[0] | (frame.data[1] << 8), reference_crc(frame));
  crux_can_force_torque_t raw{};
  crux_can_force_torque_unpack(&raw, frame.data, frame.length);
  return raw;
}

TEST(GripperNode, ForwardsTheWrench) {
  Gripper gripper;
  const float wrench[6] = {12.34F, -56.78F, 100.0F, 1.5F, -2.25F, 0.0005F};
  std::copy(std::begin(wrench), std::end(wrench), gripper.inputs.wrench);
  const crux_can_force_torque_t raw = sample_of(gripper);
  EXPECT_EQ(raw.status, 0);
  EXPECT_EQ(raw.force_x_n, 1234);
  EXPECT_EQ(raw.force_y_n, -5678);
  EXPECT_EQ(raw.force_z_n, 10000);
  EXPECT_EQ(raw.moment_x_nm, 3000);
  EXPECT_EQ(raw.moment_y_nm, -4500);
  EXPECT_EQ(raw.moment_z_nm, 1);
  EXPECT_EQ(raw.cycle_echo, gripper.cycle);
}

TEST(GripperNode, MarksOverloadAndMissingSamples) {
  for (int axis = 0; axis < 6; ++axis) {
    Gripper gripper;
    gripper.inputs.wrench[axis] = axis < 3 ? -200.5F : 8.1F;
    EXPECT_EQ(sample_of(gripper).status, CRUX_FT_OVERLOAD) << "axis " << axis;
    gripper.inputs.wrench[axis] = axis < 3 ? -199.5F : 7.9F;
    EXPECT_EQ(sample_of(gripper).status, 0) << "axis " << axis;
    gripper.inputs.wrench[axis] = kNaN;
    EXPECT_EQ(sample_of(gripper).status, CRUX_FT_NOT_READY) << "axis " << axis;
  }
  Gripper gripper;
  gripper.inputs.wrench_valid = false;
  EXPECT_EQ(sample_of(gripper).status, CRUX_FT_NOT_READY);
}

}  // namespace
}  // namespace crux::firmware
