// A limb's bus in broadcast mode: one frame out, its bits where the database has them, and the gripper's single answer.
#include <gtest/gtest.h>

#include <string>

#include "bus/bus.hpp"
#include "bus/limb_bus.hpp"
#include "crux_can.h"

namespace crux {
namespace {

constexpr int kLimb = 1;  // RF: not the first, so that a forgotten offset shows

RobotDescription test_robot(double kp = 100.0, double kd = 4.0) {
  RobotDescription robot;
  robot.name = "test";
  robot.sha256 = std::string(64, '0');
  for (std::size_t joint = 0; joint < kPlacing; ++joint) {
    robot.can.nodes.joints[joint] = static_cast<int>(kPlacing - joint);  // backwards: joint 1 is node 6
    robot.servo.position_gain_Nm_rad[joint] = kp;
    robot.servo.velocity_gain_Nms_rad[joint] = kd;
  }
  robot.can.nodes.gripper = 7;
  robot.supervisor.silent_cycles = 10;
  return robot;
}

std::int64_t bits(const Frame& frame, unsigned first, unsigned count, bool is_signed = false) {
  std::int64_t value = 0;
  for (unsigned i = 0; i < count; ++i)
    value |= static_cast<std::int64_t>(frame.data[(first + i) / 8] >> ((first + i) % 8) & 1U) << i;
  return is_signed && (value >> (count - 1) & 1) != 0 ? value - (std::int64_t{1} << count) : value;
}

TEST(LimbBroadcast, OneFrameCarriesEverythingOfALimb) {
  LimbBus limb(kLimb, test_robot(), CommandFrames::kBroadcast);
  crux_msgs::control_output_t output{};
  for (int joint = 0; joint < 6; ++joint) {
    const int i = kJoints * kLimb + joint;
    output.joint_mode[i] = 1;
    output.joint_position_rad[i] = -0.1 * (joint + 1);
    output.joint_velocity_rad_s[i] = 0.25;
    output.joint_torque_nm[i] = joint == 5 ? 1e6 : -1.5;  // beyond what the signal can carry
  }
  output.gripper_mode[kLimb] = 2;
  output.finger_opening_m[kLimb] = 0.04;
  output.finger_speed_limit_m_s[kLimb] = 0.02;
  output.finger_force_limit_n[kLimb] = 25.5;
  const auto frames = limb.pack_cycle(output, 0x12345, nullptr);
  ASSERT_EQ(frames.size(), 1U);
  const Frame& frame = frames[0];
  EXPECT_EQ(frame.id, 0x011U);
  EXPECT_EQ(frame.length, 64);
  crux_e2e_receiver receiver{};
  EXPECT_EQ(crux_e2e_check(frame.id, frame.data.data(), frame.length, &receiver), CRUX_E2E_OK);
  EXPECT_EQ(bits(frame, 24, 16), 0x2345);
  for (unsigned joint = 0; joint < 6; ++joint) {
    const unsigned start = 40 + 72 * (5 - joint);
    EXPECT_EQ(bits(frame, start, 4), 1);
    EXPECT_EQ(bits(frame, start + 4, 20, true), -10000 * static_cast<int>(joint + 1));
    EXPECT_EQ(bits(frame, start + 24, 16, true), 250);
    EXPECT_EQ(bits(frame, start + 40, 16, true), joint == 5 ? 32767 : -1500);
    EXPECT_EQ(bits(frame, start + 56, 8), 50);
    EXPECT_EQ(bits(frame, start + 64, 8), 80);
  }
  EXPECT_EQ(bits(frame, 472, 2), 2);
  EXPECT_EQ(bits(frame, 474, 14), 8000);
  EXPECT_EQ(bits(frame, 488, 10), 200);
  EXPECT_EQ(bits(frame, 498, 14), 1275);
}

TEST(LimbBroadcast, CountersGoOnAndAHeartbeatGoesFirst) {
  LimbBus limb(kLimb, test_robot(), CommandFrames::kBroadcast);
  const crux_msgs::control_output_t output{};
  const std::uint8_t counter = limb.pack_cycle(output, 1, nullptr)[0].data[2];
  const HostHeartbeat heartbeat{1, 2};
  const auto frames = limb.pack_cycle(output, 2, &heartbeat);
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[0].id, CRUX_CAN_ID_HOST_HEARTBEAT);
  EXPECT_EQ(frames[1].data[2], static_cast<std::uint8_t>(counter + 1));
}

TEST(LimbBroadcast, TheGrippersAnswerIsStatusAndWrench) {
  LimbBus limb(kLimb, test_robot(), CommandFrames::kBroadcast);
  limb.pack_cycle({}, 70000, nullptr);
  crux_can_gripper_identity_t identity{};
  identity.protocol = CRUX_CAN_PROTOCOL_VERSION;
  identity.node_id = CRUX_CAN_NODE_GRIPPER;
  identity.limb = kLimb;
  crux_can_gripper_answer_t answer{};
  answer.state = 2;
  answer.opening_m = 0.03F;
  answer.speed_m_s = -100;
  answer.force_n = 1234;
  answer.cycle_echo = 70000 - 65536;
  answer.faults = 4;
  answer.wrench_status = 1;
  answer.force_x_n = 100;
  answer.force_y_n = -200;
  answer.force_z_n = 300;
  answer.moment_x_nm = 1000;
  answer.moment_y_nm = -2000;
  answer.moment_z_nm = 3000;
  const auto take = [&](Frame frame, std::uint8_t counter) {
    crux_e2e_protect(frame.id, counter, frame.data.data(), frame.length);
    NodeNotice notice;
    limb.take(frame, notice);
  };
  const auto introduce = [&] {
    Frame frame{.id = CRUX_CAN_ID_GRIPPER_IDENTITY, .length = CRUX_CAN_LENGTH_GRIPPER_IDENTITY};
    crux_can_gripper_identity_pack(frame.data.data(), &identity, frame.length);
    take(frame, 0);
  };
  const auto send = [&](std::uint8_t counter) {
    Frame frame{.id = CRUX_CAN_ID_GRIPPER_ANSWER, .length = CRUX_CAN_LENGTH_GRIPPER_ANSWER};
    crux_can_gripper_answer_pack(frame.data.data(), &answer, frame.length);
    take(frame, counter);
  };
  crux_msgs::control_input_t in{};
  send(0);
  limb.fill(in);
  EXPECT_EQ(in.gripper_fresh[kLimb], 0);  // nobody is listened to who has not said who it is
  introduce();
  send(1);
  limb.fill(in);
  EXPECT_EQ(in.gripper_fresh[kLimb], 1);
  EXPECT_EQ(in.gripper_state[kLimb], 2);
  EXPECT_EQ(in.gripper_faults[kLimb], 4);
  EXPECT_NEAR(in.finger_opening_m[kLimb], 0.03, 1e-6);
  EXPECT_NEAR(in.finger_speed_m_s[kLimb], -0.001, 1e-6);
  EXPECT_NEAR(in.finger_force_n[kLimb], 12.34, 1e-5);
  EXPECT_EQ(in.ft_fresh[kLimb], 1);
  EXPECT_EQ(in.ft_status[kLimb], 1);
  EXPECT_NEAR(in.ft_force_g_n[3 * kLimb], 1.0, 1e-6);
  EXPECT_NEAR(in.ft_force_g_n[3 * kLimb + 1], -2.0, 1e-6);
  EXPECT_NEAR(in.ft_force_g_n[3 * kLimb + 2], 3.0, 1e-6);
  EXPECT_NEAR(in.ft_moment_g_nm[3 * kLimb], 0.5, 1e-6);
  EXPECT_NEAR(in.ft_moment_g_nm[3 * kLimb + 1], -1.0, 1e-6);
  EXPECT_NEAR(in.ft_moment_g_nm[3 * kLimb + 2], 1.5, 1e-6);
  EXPECT_EQ(limb.silent_nodes(), (std::vector<int>{1, 2, 3, 4, 5, 6}));
  limb.pack_cycle({}, 70001, nullptr);
  send(2);  // late: neither the gripper nor its sensor is fresh
  limb.fill(in);
  EXPECT_EQ(in.gripper_fresh[kLimb], 0);
  EXPECT_EQ(in.ft_fresh[kLimb], 0);
}

TEST(LimbBroadcast, AnotherHostsBroadcastIsNoticedItsEchoIsNot) {
  LimbBus limb(kLimb, test_robot(), CommandFrames::kBroadcast);
  const Frame own = limb.pack_cycle({}, 1, nullptr)[0];
  NodeNotice notice;
  limb.take(own, notice);
  EXPECT_FALSE(limb.foreign_host());
  Frame foreign = own;
  foreign.data[10] ^= 1U;
  limb.take(foreign, notice);
  EXPECT_TRUE(limb.foreign_host());
}

TEST(LimbBroadcast, GainsThatItCannotCarryAreRefused) {
  EXPECT_NO_THROW(LimbBus(0, test_robot(510.0, 12.75), CommandFrames::kBroadcast));
  EXPECT_NO_THROW(LimbBus(0, test_robot(600.0, 20.0)));
  EXPECT_THROW(LimbBus(0, test_robot(512.0), CommandFrames::kBroadcast), BusError);
  EXPECT_THROW(LimbBus(0, test_robot(0.5), CommandFrames::kBroadcast), BusError);
  EXPECT_THROW(LimbBus(0, test_robot(100.0, 13.0), CommandFrames::kBroadcast), BusError);
}

}  // namespace
}  // namespace crux
