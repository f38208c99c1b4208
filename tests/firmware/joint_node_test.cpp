// Control law and status of the joint node against closed forms.
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

TEST(JointNode, PdWithFeedForwardIsTheClosedForm) {
  crux_joint_parameters parameters = joint_parameters();
  parameters.setpoint_time_constant_s = 0.0F;
  parameters.velocity_limit_rad_s = 1000.0F;
  for (const float error_rad : {-0.05F, -0.01F, 0.0F, 0.02F, 0.06F}) {
    for (const float velocity_rad_s : {-1.0F, 0.0F, 0.7F}) {
      Joint joint(parameters, 0.3F);
      joint.inputs.velocity_rad_s = velocity_rad_s;
      const float torque_Nm = joint.run(
          {.position_rad = 0.3F + error_rad, .velocity_rad_s = 0.25F, .torque_Nm = -1.5F, .kp = 80.0F, .kd = 1.25F});
      EXPECT_NEAR(torque_Nm, 80.0F * error_rad + 1.25F * (0.25F - velocity_rad_s) - 1.5F, 1e-4F);
    }
  }
}

TEST(JointNode, TorqueIsLimitedBothWays) {
  for (const float sign : {-1.0F, 1.0F}) {
    Joint joint;
    for (int i = 0; i < 100; ++i) {
      EXPECT_LE(std::abs(joint.run({.position_rad = sign * 1.4F, .torque_Nm = sign * 9.0F, .kp = 600.0F})), 10.0F);
    }
    EXPECT_FLOAT_EQ(joint.run({.position_rad = sign * 1.4F, .torque_Nm = sign * 30.0F}), sign * 10.0F);
  }
}

TEST(JointNode, SetpointFollowsAFirstOrderLag) {
  // Step response 1 - exp(-t/T), whatever the tick.
  for (const float dt_s : {0.002F, 0.001F, 0.0005F}) {
    Joint joint;
    joint.command({.position_rad = 0.05F, .velocity_rad_s = 0.4F});
    joint.sync();
    for (int i = 1; static_cast<float>(i) * dt_s < 0.0095F; ++i) {
      joint.tick(dt_s);
      const float share = 1.0F - std::exp(-static_cast<float>(i) * dt_s / 0.02F);
      EXPECT_NEAR(joint.node.setpoint_rad, 0.05F * share, 1e-6F);
      EXPECT_NEAR(joint.node.velocity_setpoint_rad_s, 0.4F * share, 1e-5F);
    }
  }
}

TEST(JointNode, SetpointLagsARampByTheTimeConstant) {
  Joint joint;
  float target_rad = 0.0F;
  for (int i = 0; i < 400; ++i) {
    target_rad += 0.5F * kDt;
    joint.run({.position_rad = target_rad, .velocity_rad_s = 0.5F});
  }
  // A lag sampled with the command known at the end of the period trails by T minus about half a period.
  EXPECT_NEAR(target_rad - joint.node.setpoint_rad, 0.5F * 0.02F, 0.5F * kDt);
}

TEST(JointNode, SetpointNeverMovesFasterThanTheJoint) {
  Joint joint;
  float before_rad = 0.0F;
  for (int i = 0; i < 500; ++i) {
    joint.run({.position_rad = (i / 100) % 2 == 0 ? 1.5F : -2.0F});
    EXPECT_LE(std::abs(joint.node.setpoint_rad - before_rad), 4.0F * kDt * 1.0001F);
    before_rad = joint.node.setpoint_rad;
  }
}

TEST(JointNode, HoldsTheFirstMeasuredPositionFromPowerUp) {
  Joint joint(joint_parameters(), 0.7F);
  EXPECT_FLOAT_EQ(joint.tick(), 0.0F);
  joint.inputs.position_rad = 0.68F;
  joint.inputs.velocity_rad_s = -0.1F;
  EXPECT_NEAR(joint.tick(), 100.0F * 0.02F + 4.0F * 0.1F, 1e-4F);
  EXPECT_EQ(joint.node.state, CRUX_STATE_BOOT);
}

TEST(JointNode, HoldOnCommandIgnoresTheFramesNumbers) {
  Joint joint;
  for (int i = 0; i < 300; ++i) {
    joint.run({.position_rad = 0.01F, .torque_Nm = 4.0F});
  }
  for (int i = 0; i < 50; ++i) {
    const float torque_Nm =
        joint.run({.mode = CRUX_MODE_HOLD, .position_rad = -1.0F, .torque_Nm = -9.0F, .kp = 1.0F, .kd = 0.0F});
    EXPECT_NEAR(torque_Nm, 100.0F * 0.01F + 4.0F, 1e-3F);
  }
  EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
}

TEST(JointNode, ALostEncoderKeepsTheTorqueUntilRearmed) {
  Joint joint;
  for (int i = 0; i < 300; ++i) {
    joint.run({.position_rad = 0.02F, .torque_Nm = 3.0F});
  }
  take_all(joint.node.link);
  joint.inputs.position_rad = kNaN;
  for (int i = 0; i < 100; ++i) {
    EXPECT_NEAR(joint.run({.position_rad = -1.0F, .torque_Nm = -3.0F}), 5.0F, 1e-3F);
    EXPECT_EQ(joint.node.state, CRUX_STATE_FAULT);
  }
  joint.run({.mode = CRUX_MODE_REARM});
  EXPECT_EQ(joint.node.state, CRUX_STATE_FAULT) << "still blind";
  joint.inputs.position_rad = 0.5F;
  EXPECT_NEAR(joint.tick(), 5.0F, 1e-3F) << "seeing again is not enough";
  EXPECT_NEAR(joint.run({.mode = CRUX_MODE_REARM}), 5.0F, 1e-3F);
  EXPECT_EQ(joint.node.state, CRUX_STATE_HOLD);
  EXPECT_NEAR(joint.node.setpoint_rad, 0.5F, 1e-6F);
  bool reported = false;
  for (const auto& [id, frame] : take_all(joint.node.link)) {
    crux_can_joint_emergency_t raw{};
    crux_can_joint_emergency_unpack(&raw, frame.data, frame.length);
    reported = reported || (id == 0x080 + kJoint && raw.cause == CRUX_CAUSE_SENSOR);
  }
  EXPECT_TRUE(reported);
}

TEST(JointNode, TemperatureIsReportedWithHysteresisAndNeverCutsTorque) {
  Joint joint;
  const auto faults_at = [&joint](float temperature_degC) {
    joint.inputs.temperature_degC = temperature_degC;
    EXPECT_NEAR(joint.run({.torque_Nm = 2.0F}), 2.0F, 1e-4F);
    return joint.node.link.faults;
  };
  EXPECT_EQ(faults_at(79.0F), 0);
  EXPECT_EQ(faults_at(80.0F), 0x20);
  EXPECT_EQ(faults_at(76.0F), 0x20);
  EXPECT_EQ(faults_at(74.0F), 0);
  EXPECT_EQ(faults_at(81.0F), 0x20);
  EXPECT_EQ(faults_at(kNaN), 0x04) << "a lost thermometer is one, neither hot nor cold";
  EXPECT_EQ(faults_at(25.0F), 0);
  int lost = 0;
  for (const auto& [id, frame] : take_all(joint.node.link)) {
    crux_can_joint_emergency_t raw{};
    crux_can_joint_emergency_unpack(&raw, frame.data, frame.length);
    lost += (id == 0x080 + kJoint && raw.cause == CRUX_CAUSE_THERMOMETER) ? 1 : 0;
  }
  EXPECT_EQ(lost, 1);
}

TEST(JointNode, ABridgeThatItsDriverStoppedIsAFaultBitAndTheNodeGoesOn) {
  Joint joint;
  joint.run({.torque_Nm = 2.0F});
  joint.inputs.driver_fault = true;
  EXPECT_NEAR(joint.run({.torque_Nm = 2.0F}), 2.0F, 1e-4F);
  EXPECT_EQ(joint.node.link.faults, 0x02);
  EXPECT_EQ(joint.node.state, CRUX_STATE_TRACK);
  joint.inputs.driver_fault = false;
  joint.run({.torque_Nm = 2.0F});
  EXPECT_EQ(joint.node.link.faults, 0);
  Gripper gripper;
  gripper.inputs.driver_fault = true;
  gripper.inputs.temperature_degC = kNaN;
  gripper.run({});
  EXPECT_EQ(gripper.node.link.faults, 0x06);
}

TEST(JointNode, AnUnknownTemperatureIsToldFromAllOthers) {
  for (const auto& [degC, told] : {std::pair{kNaN, -128}, {-300.0F, -127}, {-127.6F, -127}, {126.7F, 127}}) {
    EXPECT_EQ(crux_whole_degrees(degC), told);
  }
}

TEST(JointNode, BusOffIsAFaultBitWhileItLasts) {
  Joint joint;
  joint.inputs.bus_off = true;
  joint.tick();
  EXPECT_EQ(joint.node.link.faults, 0x40);
  joint.inputs.bus_off = false;
  joint.tick();
  EXPECT_EQ(joint.node.link.faults, 0);
}

TEST(JointNode, AnswersEverySyncOnce) {
  Joint joint;
  joint.inputs = {.position_rad = 0.125F,
                  .velocity_rad_s = -1.5F,
                  .torque_Nm = 2.0625F,
                  .temperature_degC = 41.4F,
                  .bus_off = false,
                  .driver_fault = false,
                  .health = {}};
  joint.run({});
  take_all(joint.node.link);
  joint.cycle = 0x12344;
  joint.run({});
  crux_joint_node_publish(&joint.node, &joint.inputs);
  crux_joint_node_publish(&joint.node, &joint.inputs);
  auto frames = take_all(joint.node.link);
  ASSERT_EQ(frames.count(0x180 + kJoint), 1U);
  const crux_frame frame = frames.find(0x180 + kJoint)->second;
  crux_can_joint_status_t raw{};
  crux_can_joint_status_unpack(&raw, frame.data, frame.length);
  EXPECT_EQ(raw.crc, reference_crc(frame));
  EXPECT_EQ(raw.state, CRUX_STATE_TRACK);
  EXPECT_EQ(raw.cycle_echo, 0x2345);
  EXPECT_FLOAT_EQ(raw.position_rad, 0.125F);
  EXPECT_EQ(raw.velocity_rad_s, -1500);
  EXPECT_NEAR(raw.torque_nm, 2062.5, 0.5);
  EXPECT_EQ(raw.temperature_deg_c, 41);
}

TEST(JointNode, StatusSaturatesAndStaysFinite) {
  Joint joint;
  joint.run({});
  joint.inputs = {.position_rad = kNaN,
                  .velocity_rad_s = 1e9F,
                  .torque_Nm = -1e9F,
                  .temperature_degC = 1e9F,
                  .bus_off = false,
                  .driver_fault = false,
                  .health = {}};
  crux_joint_node_publish(&joint.node, &joint.inputs);
  const auto frames = take_all(joint.node.link);
  const crux_frame frame = frames.find(0x180 + kJoint)->second;
  crux_can_joint_status_t raw{};
  crux_can_joint_status_unpack(&raw, frame.data, frame.length);
  EXPECT_FLOAT_EQ(raw.position_rad, 0.0F) << "the last position that was one";
  EXPECT_EQ(raw.velocity_rad_s, 32767);
  EXPECT_EQ(raw.torque_nm, -32768);
  EXPECT_EQ(raw.temperature_deg_c, 127);
}

}  // namespace
}  // namespace crux::firmware
