#include "bus/limb_bus.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "bus/bus.hpp"
#include "core/robot/node_protocol.hpp"
#include "crux_can.h"

namespace crux {
namespace {

constexpr int kLimb = 2;  // LR: not the first, so that a forgotten offset shows
constexpr std::uint32_t kParameterHash = 0x89abcdef;

RobotDescription test_robot() {
  RobotDescription robot;
  robot.name = "test";
  robot.sha256 = "89abcdef" + std::string(56, '0');
  for (int joint = 0; joint < kPlacing; ++joint) {
    robot.can.nodes.joints[static_cast<std::size_t>(joint)] = joint + 1;
    robot.servo.position_gain_Nm_rad[static_cast<std::size_t>(joint)] = 100.0 + joint;
    robot.servo.velocity_gain_Nms_rad[static_cast<std::size_t>(joint)] = 4.0;
  }
  robot.can.nodes.gripper = 7;
  robot.supervisor.silent_cycles = 5;
  return robot;
}

/// The nodes of one limb, as far as a bus sees them.
class Nodes {
 public:
  Frame joint_status(std::uint8_t node, std::uint16_t echo, float position_rad = 0.5F) {
    crux_can_joint_status_t status{};
    status.state = 2;
    status.position_rad = position_rad;
    status.velocity_rad_s = -1500;
    status.torque_nm = 2500;
    status.cycle_echo = echo;
    status.faults = 0x81;
    Frame frame = start(CRUX_CAN_ID_JOINT_STATUS(node), CRUX_CAN_LENGTH_JOINT_STATUS);
    crux_can_joint_status_pack(frame.data.data(), &status, frame.length);
    return finish(frame);
  }
  Frame gripper_status(std::uint16_t echo) {
    crux_can_gripper_status_t status{};
    status.state = 1;
    status.opening_m = 0.03F;
    status.speed_m_s = -100;
    status.force_n = 1234;
    status.cycle_echo = echo;
    Frame frame = start(CRUX_CAN_ID_GRIPPER_STATUS, CRUX_CAN_LENGTH_GRIPPER_STATUS);
    crux_can_gripper_status_pack(frame.data.data(), &status, frame.length);
    return finish(frame);
  }
  Frame force_torque(std::uint16_t echo) {
    crux_can_force_torque_t sample{};
    sample.status = 1;
    sample.force_x_n = 100;
    sample.force_y_n = -200;
    sample.force_z_n = 300;
    sample.moment_x_nm = 1000;
    sample.moment_y_nm = -2000;
    sample.moment_z_nm = 3000;
    sample.cycle_echo = echo;
    Frame frame = start(CRUX_CAN_ID_FORCE_TORQUE, CRUX_CAN_LENGTH_FORCE_TORQUE);
    crux_can_force_torque_pack(frame.data.data(), &sample, frame.length);
    return finish(frame);
  }
  Frame identity(std::uint8_t node, std::uint8_t protocol, std::uint8_t limb, std::uint32_t hash) {
    crux_can_joint_identity_t identity{};
    identity.protocol = protocol;
    identity.node_id = node;
    identity.limb = limb;
    identity.parameter_hash = hash;
    Frame frame = start(CRUX_CAN_ID_JOINT_IDENTITY(node), CRUX_CAN_LENGTH_JOINT_IDENTITY);
    crux_can_joint_identity_pack(frame.data.data(), &identity, frame.length);
    return finish(frame);
  }
  Frame emergency(std::uint8_t node, std::uint8_t cause, std::uint32_t detail) {
    crux_can_joint_emergency_t emergency{};
    emergency.cause = cause;
    emergency.detail = detail;
    Frame frame = start(CRUX_CAN_ID_JOINT_EMERGENCY(node), CRUX_CAN_LENGTH_JOINT_EMERGENCY);
    crux_can_joint_emergency_pack(frame.data.data(), &emergency, frame.length);
    return finish(frame);
  }
  std::vector<Frame> all(std::uint16_t echo) {
    std::vector<Frame> frames;
    for (std::uint8_t node = 1; node <= 6; ++node) frames.push_back(joint_status(node, echo));
    frames.push_back(gripper_status(echo));
    frames.push_back(force_torque(echo));
    return frames;
  }

 private:
  static Frame start(std::uint32_t id, std::uint8_t length) {
    Frame frame;
    frame.id = id;
    frame.length = length;
    return frame;
  }
  Frame finish(Frame frame) {
    crux_e2e_protect(frame.id, counters_[frame.id]++, frame.data.data(), frame.length);
    return frame;
  }
  std::array<std::uint8_t, kStandardIds> counters_{};
};

class LimbBusTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (std::uint8_t node = 1; node <= 7; ++node)
      take(nodes_.identity(node, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash));
  }
  bool take(const Frame& frame) { return limb_.take(frame, notice_); }
  void take(const std::vector<Frame>& frames) {
    for (const Frame& frame : frames) take(frame);
  }
  crux_msgs::control_input_t input() const {
    crux_msgs::control_input_t input{};
    limb_.fill(input);
    return input;
  }
  std::span<const Frame> cycle(std::uint32_t n, const HostHeartbeat* heartbeat = nullptr) {
    return limb_.pack_cycle(output_, n, heartbeat);
  }

  RobotDescription robot_ = test_robot();
  LimbBus limb_{kLimb, robot_};
  Nodes nodes_;
  NodeNotice notice_;
  crux_msgs::control_output_t output_{};
};

TEST_F(LimbBusTest, SendsCommandsThenSyncEachProtected) {
  for (int joint = 0; joint < 6; ++joint) {
    output_.joint_mode[kJoints * kLimb + joint] = 1;
    output_.joint_position_rad[kJoints * kLimb + joint] = 0.1 * joint;
    output_.joint_velocity_rad_s[kJoints * kLimb + joint] = -0.25;
    output_.joint_torque_nm[kJoints * kLimb + joint] = 1e6;  // beyond what the signal can carry
  }
  output_.gripper_mode[kLimb] = 1;
  output_.finger_opening_m[kLimb] = 0.04;
  output_.finger_speed_limit_m_s[kLimb] = 0.02;
  output_.finger_force_limit_n[kLimb] = 25.5;
  const HostHeartbeat heartbeat{0x13, 1234};
  const auto frames = cycle(70000, &heartbeat);
  ASSERT_EQ(frames.size(), 9U);
  for (const Frame& frame : frames) {
    crux_e2e_receiver receiver{};
    EXPECT_EQ(crux_e2e_check(frame.id, frame.data.data(), frame.length, &receiver), CRUX_E2E_OK) << frame.id;
    EXPECT_TRUE(frame.fd && frame.bit_rate_switch && !frame.extended);
  }
  crux_can_host_heartbeat_t beat{};
  crux_can_host_heartbeat_unpack(&beat, frames[0].data.data(), frames[0].length);
  EXPECT_EQ(frames[0].id, CRUX_CAN_ID_HOST_HEARTBEAT);
  EXPECT_EQ(beat.host_state, 0x13);
  EXPECT_EQ(beat.uptime_ms, 1234U);
  for (std::uint8_t joint = 0; joint < 6; ++joint) {
    const Frame& frame = frames[1U + joint];
    EXPECT_EQ(frame.id, CRUX_CAN_ID_JOINT_COMMAND(joint + 1));
    crux_can_joint_command_t command{};
    crux_can_joint_command_unpack(&command, frame.data.data(), frame.length);
    EXPECT_EQ(command.mode, 1);
    EXPECT_FLOAT_EQ(command.position_rad, 0.1F * joint);
    EXPECT_EQ(command.velocity_rad_s, -250);
    EXPECT_EQ(command.torque_nm, 32767);
    EXPECT_EQ(command.kp_nm_rad, 10000 + 100 * joint);
    EXPECT_EQ(command.kd_nms_rad, 4000);
  }
  crux_can_gripper_command_t grip{};
  crux_can_gripper_command_unpack(&grip, frames[7].data.data(), frames[7].length);
  EXPECT_EQ(frames[7].id, CRUX_CAN_ID_GRIPPER_COMMAND);
  EXPECT_FLOAT_EQ(grip.opening_m, 0.04F);
  EXPECT_EQ(grip.speed_limit_m_s, 2000);
  EXPECT_EQ(grip.force_limit_n, 2550);
  crux_can_sync_t sync{};
  crux_can_sync_unpack(&sync, frames[8].data.data(), frames[8].length);
  EXPECT_EQ(frames[8].id, CRUX_CAN_ID_SYNC);
  EXPECT_EQ(sync.cycle, 70000U);
}

TEST_F(LimbBusTest, CountersStepByOneFromFrameToFrame) {
  std::array<crux_e2e_receiver, kStandardIds> receivers{};
  for (std::uint32_t n = 1; n <= 600; ++n) {  // more than the counter's 256
    for (const Frame& frame : cycle(n))
      ASSERT_EQ(crux_e2e_check(frame.id, frame.data.data(), frame.length, &receivers[frame.id]), CRUX_E2E_OK);
  }
}

TEST_F(LimbBusTest, AnswersFillTheInputOfTheirLimbOnly) {
  cycle(65537);  // echoes as 1
  take(nodes_.all(1));
  EXPECT_TRUE(limb_.complete());
  const auto in = input();
  for (int i = 0; i < kAllJoints; ++i) EXPECT_EQ(in.joint_fresh[i], i / kJoints == kLimb ? 1 : 0) << i;
  const int i = kJoints * kLimb + 3;
  EXPECT_EQ(in.joint_state[i], 2);
  EXPECT_EQ(in.joint_faults[i], 0x81);
  EXPECT_DOUBLE_EQ(in.joint_position_rad[i], 0.5);
  EXPECT_NEAR(in.joint_velocity_rad_s[i], -1.5, 1e-6);
  EXPECT_NEAR(in.joint_torque_nm[i], 2.5, 1e-6);
  EXPECT_EQ(in.gripper_fresh[kLimb], 1);
  EXPECT_EQ(in.gripper_state[kLimb], 1);
  EXPECT_NEAR(in.finger_opening_m[kLimb], 0.03, 1e-6);
  EXPECT_NEAR(in.finger_speed_m_s[kLimb], -0.001, 1e-6);
  EXPECT_NEAR(in.finger_force_n[kLimb], 12.34, 1e-5);
  EXPECT_EQ(in.ft_fresh[kLimb], 1);
  EXPECT_EQ(in.ft_status[kLimb], 1);
  EXPECT_NEAR(in.ft_force_g_n[3 * kLimb + 1], -2.0, 1e-6);
  EXPECT_NEAR(in.ft_moment_g_nm[3 * kLimb + 2], 1.5, 1e-6);
}

TEST_F(LimbBusTest, CompleteNeedsEveryNodeAndTheForceTorqueSensor) {
  const auto frames = nodes_.all(1);
  for (std::size_t missing = 0; missing < frames.size(); ++missing) {
    LimbBus limb(kLimb, robot_);
    limb.pack_cycle(output_, 1, nullptr);
    for (std::size_t i = 0; i < frames.size(); ++i) {
      if (i != missing) limb.take(frames[i], notice_);
    }
    EXPECT_FALSE(limb.complete()) << missing;
    const int silent = missing < 6 ? static_cast<int>(missing) + 1 : 7;
    EXPECT_EQ(limb.silent_nodes(), std::vector<int>{silent});
    limb.take(frames[missing], notice_);
    EXPECT_TRUE(limb.complete());
  }
}

TEST_F(LimbBusTest, EverySingleBitErrorIsRejected) {
  cycle(1);
  const Frame good = nodes_.joint_status(1, 1, 0.7F);
  for (std::size_t bit = 0; bit < 8U * good.length; ++bit) {
    Frame bad = good;
    bad.data[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    take(bad);
  }
  EXPECT_EQ(limb_.statistics().crc_errors, 8U * good.length);
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 0);
  take(good);
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 1);
}

TEST_F(LimbBusTest, AFrameUnderAnotherIdentifierIsRejected) {
  cycle(1);
  Frame stolen = nodes_.joint_status(1, 1);
  stolen.id = CRUX_CAN_ID_JOINT_STATUS(2);
  take(stolen);
  EXPECT_EQ(limb_.statistics().crc_errors, 1U);
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb + 1], 0);
}

TEST_F(LimbBusTest, RepeatsAreDroppedAndGapsAreCounted) {
  cycle(1);
  const Frame first = nodes_.joint_status(1, 1);
  take(first);
  cycle(2);
  take(first);
  cycle(65537);  // echoes as 1 again
  take(first);
  EXPECT_EQ(limb_.statistics().repeated, 2U);
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 0);
  cycle(2);
  nodes_.joint_status(1, 2);  // lost
  take(nodes_.joint_status(1, 2));
  EXPECT_EQ(limb_.statistics().lost, 1U);
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 1);
}

// Two boards with one number: each answers every Sync, with a counter of its own.
TEST_F(LimbBusTest, BelievesNeitherOfTwoSendersUnderOneNumber) {
  constexpr float kTrue = 0.5F, kFalse = -1.0F;
  for (const bool second_first : {false, true}) {
    for (const int ahead : {0, 1, 2, 5, 6, 100, 200, 250, 254}) {
      LimbBus limb(kLimb, robot_);
      Nodes right, wrong;
      limb.take(right.identity(2, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash), notice_);
      for (int k = 0; k < ahead; ++k) wrong.joint_status(2, 0);
      std::uint16_t n = 1;
      crux_msgs::control_input_t input{};
      for (; n <= 20; ++n) {  // alone
        limb.pack_cycle(output_, n, nullptr);
        limb.take(right.joint_status(2, n, kTrue), notice_);
        limb.fill(input);
        ASSERT_EQ(input.joint_fresh[kJoints * kLimb + 1], 1);
        ASSERT_EQ(input.joint_faults[kJoints * kLimb + 1] & kFaultTwoSenders, 0);
        wrong.joint_status(2, n);
      }
      int cycles = 0;  // until it is told
      for (; n <= 60; ++n) {
        limb.pack_cycle(output_, n, nullptr);
        const Frame one = right.joint_status(2, n, kTrue), other = wrong.joint_status(2, n, kFalse);
        limb.take(second_first ? other : one, notice_);
        limb.take(second_first ? one : other, notice_);
        limb.fill(input);
        if ((input.joint_faults[kJoints * kLimb + 1] & kFaultTwoSenders) == 0) {
          ASSERT_LE(++cycles, 4) << ahead;  // 10 ms at 500 Hz are five
        } else {
          ASSERT_EQ(input.joint_fresh[kJoints * kLimb + 1], 0) << ahead;
        }
      }
      EXPECT_NE(input.joint_faults[kJoints * kLimb + 1] & kFaultTwoSenders, 0) << ahead;
      for (; n <= 80; ++n) {  // alone again
        limb.pack_cycle(output_, n, nullptr);
        limb.take(right.joint_status(2, n, kTrue), notice_);
        limb.take(right.identity(2, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash), notice_);
      }
      limb.fill(input);
      EXPECT_EQ(input.joint_fresh[kJoints * kLimb + 1], 1) << ahead;
      EXPECT_EQ(input.joint_faults[kJoints * kLimb + 1] & kFaultTwoSenders, 0) << ahead;
    }
  }
}

// A forged wrench of zero beside the gripper's own.
TEST_F(LimbBusTest, BelievesNeitherOfTwoWrenches) {
  Nodes other;
  for (int k = 0; k < 77; ++k) other.force_torque(0);
  for (std::uint16_t n = 1; n <= 5; ++n) {
    cycle(n);
    take(nodes_.all(n));
    if (n > 1) take(other.force_torque(n));
  }
  EXPECT_EQ(input().ft_fresh[kLimb], 0);
  EXPECT_EQ(input().gripper_fresh[kLimb], 0);
  EXPECT_NE(input().gripper_faults[kLimb] & kFaultTwoSenders, 0);
  EXPECT_EQ(input().joint_faults[kJoints * kLimb] & kFaultTwoSenders, 0);
  EXPECT_TRUE(limb_.complete());  // the cycle goes on
}

TEST_F(LimbBusTest, ACounterThatJumpsIsNotUsedBeforeItsNodeHasSaidWhoItIs) {
  cycle(1);
  take(nodes_.joint_status(1, 1, 0.1F));
  for (int k = 0; k < 50; ++k) nodes_.joint_status(1, 1);
  for (std::uint16_t n = 2; n <= 4; ++n) {
    cycle(n);
    take(nodes_.joint_status(1, n, 0.2F));
    EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 0);
    EXPECT_EQ(input().joint_position_rad[kJoints * kLimb], static_cast<double>(0.1F));
    EXPECT_EQ(input().joint_faults[kJoints * kLimb] & kFaultTwoSenders, 0);
  }
  take(nodes_.identity(1, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash));
  cycle(5);
  take(nodes_.joint_status(1, 5, 0.2F));
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 1);
}

TEST_F(LimbBusTest, ARestartedNodeIsHeardAtOnce) {
  for (std::uint16_t n = 1; n <= 3; ++n) {
    cycle(n);
    take(nodes_.joint_status(1, n));
  }
  nodes_ = Nodes();
  take(nodes_.identity(1, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash));
  take(nodes_.emergency(1, CRUX_CAN_JOINT_EMERGENCY_CAUSE_RESTARTED_CHOICE, 0));
  cycle(4);
  take(nodes_.joint_status(1, 4, 0.3F));
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 1);
}

TEST_F(LimbBusTest, ALateAnswerIsNewsButNotFresh) {
  cycle(1);
  cycle(2);
  take(nodes_.joint_status(1, 1, 0.25F));
  EXPECT_EQ(limb_.statistics().late, 1U);
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 0);
  EXPECT_DOUBLE_EQ(input().joint_position_rad[kJoints * kLimb], 0.25);
  take(nodes_.joint_status(1, 2, 0.5F));
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 1);
  EXPECT_DOUBLE_EQ(input().joint_position_rad[kJoints * kLimb], 0.5);
}

TEST_F(LimbBusTest, RepeatedWakeUpsKeepTheFirstAnswers) {
  limb_.pack_wake_up();
  take(nodes_.joint_status(1, 0, 0.25F));
  EXPECT_EQ(limb_.pack_wake_up().size(), 1U);
  take(nodes_.joint_status(1, 0, 0.5F));
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 1);
  EXPECT_DOUBLE_EQ(input().joint_position_rad[kJoints * kLimb], 0.25);
  cycle(1);
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb], 0);
}

TEST_F(LimbBusTest, OwnAndForeignFramesChangeNothing) {
  const auto sent = cycle(1);
  const std::vector<Frame> own(sent.begin(), sent.end());
  take(own);
  Frame foreign = nodes_.joint_status(1, 1);
  foreign.extended = true;
  take(foreign);
  foreign = Frame();
  foreign.id = 0x555;
  take(foreign);
  foreign.id = 0x12345;
  take(foreign);
  Frame cut = nodes_.joint_status(1, 1);
  cut.length = 12;
  take(cut);
  EXPECT_EQ(limb_.statistics().unknown, 2U);
  EXPECT_EQ(limb_.statistics().wrong_size, 2U);
  EXPECT_EQ(limb_.statistics().crc_errors, 0U);
  EXPECT_EQ(limb_.silent_nodes().size(), 7U);
}

TEST_F(LimbBusTest, TellsAnotherHostFromItsOwnEcho) {
  const auto sent = cycle(1);
  const std::vector<Frame> own(sent.begin(), sent.end());
  take(own);
  EXPECT_FALSE(limb_.foreign_host());
  LimbBus second(kLimb, robot_);
  output_.joint_position_rad[kJoints * kLimb] = 0.5;
  for (int n = 1; n <= 7; ++n) second.pack_cycle(output_, static_cast<std::uint32_t>(n), nullptr);
  const auto foreign = second.pack_cycle(output_, 8, nullptr);
  take(std::vector<Frame>(foreign.begin(), foreign.end()));
  EXPECT_TRUE(limb_.foreign_host());
  EXPECT_EQ(limb_.statistics().foreign, foreign.size());
  cycle(2);
  EXPECT_FALSE(limb_.foreign_host());
  Frame confirmed = own[0];  // of a cycle long past, but the kernel says that it is ours
  confirmed.own = true;
  take(confirmed);
  EXPECT_FALSE(limb_.foreign_host());
}

TEST_F(LimbBusTest, MeasuresFromSyncOnTheWireToTheLastAnswer) {
  const auto sent = cycle(1);
  Frame sync = sent.back();
  sync.own = true;
  sync.stamp_ns = 1000;
  take(sync);
  std::int64_t stamp_ns = 2000;
  for (Frame& answer : nodes_.all(1)) {
    EXPECT_EQ(limb_.answer_time_ns(), 0) << "not all have answered";
    answer.stamp_ns = stamp_ns += 10;
    take(answer);
  }
  EXPECT_EQ(limb_.answer_time_ns(), stamp_ns - 1000);
  cycle(2);
  EXPECT_EQ(limb_.answer_time_ns(), 0);
}

TEST_F(LimbBusTest, ANodeThatIsNotWhatItShouldBeIsNotListenedTo) {
  struct Case {
    std::uint8_t protocol, limb;
    std::uint32_t hash;
    NodeNotice::Kind kind;
  };
  const Case cases[] = {{CRUX_CAN_PROTOCOL_VERSION + 1, kLimb, kParameterHash, NodeNotice::Kind::kWrongProtocol},
                        {CRUX_CAN_PROTOCOL_VERSION, kLimb + 1, kParameterHash, NodeNotice::Kind::kWrongPlace},
                        {CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash + 1, NodeNotice::Kind::kWrongParameters}};
  std::uint16_t n = 0;
  for (const Case& c : cases) {
    cycle(++n);
    ASSERT_TRUE(take(nodes_.identity(4, c.protocol, c.limb, c.hash)));
    EXPECT_EQ(notice_.kind, c.kind);
    EXPECT_EQ(notice_.node, 4);
    take(nodes_.all(n));
    EXPECT_EQ(input().joint_fresh[kJoints * kLimb + 3], 0);
    EXPECT_FALSE(limb_.identified());
    EXPECT_FALSE(take(nodes_.identity(4, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash)));
    take(nodes_.joint_status(4, n));
    EXPECT_EQ(input().joint_fresh[kJoints * kLimb + 3], 1);
    EXPECT_TRUE(limb_.identified());
  }
  EXPECT_EQ(limb_.statistics().distrusted, 3U);
}

TEST_F(LimbBusTest, WhoWasSilentIsAskedAgain) {
  const HostHeartbeat heartbeat{0, 0};
  std::uint16_t n = 0;
  for (; n < 7; ++n) {
    cycle(n + 1U);
    for (const Frame& frame : nodes_.all(static_cast<std::uint16_t>(n + 1)))
      if (frame.id != CRUX_CAN_ID_JOINT_STATUS(3)) take(frame);
  }
  EXPECT_FALSE(limb_.identified());
  const auto frames = cycle(++n, &heartbeat);
  EXPECT_EQ(frames[0].data[3] >> 5, 3) << "Identify";
  take(nodes_.all(n));
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb + 2], 0);
  take(nodes_.identity(3, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash));
  EXPECT_EQ(cycle(++n, &heartbeat)[0].data[3] >> 5, 0);
  take(nodes_.all(n));
  EXPECT_EQ(input().joint_fresh[kJoints * kLimb + 2], 1);
}

RobotDescription robot_of_seven() {
  RobotDescription robot = test_robot();
  robot.limbs[kLimb].driven = 7;
  robot.can.nodes.joints[6] = 8;
  return robot;
}

TEST_F(LimbBusTest, ASeventhJointIsNodeEight) {
  LimbBus limb(kLimb, robot_of_seven());
  output_.joint_position_rad[kJoints * kLimb + 6] = 0.75;
  const std::span<const Frame> frames = limb.pack_cycle(output_, 1, nullptr);
  ASSERT_EQ(frames.size(), 9U);  // seven joints, gripper, Sync
  EXPECT_EQ(frames[6].id, 0x108U);
  crux_can_joint_command_t command{};
  crux_can_joint_command_unpack(&command, frames[6].data.data(), frames[6].length);
  EXPECT_EQ(command.position_rad, 0.75F);
  for (std::uint8_t node = 1; node <= 8; ++node)
    limb.take(nodes_.identity(node, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash), notice_);
  EXPECT_TRUE(limb.identified());
  limb.take(nodes_.joint_status(8, 1, 0.25F), notice_);
  crux_msgs::control_input_t input{};
  limb.fill(input);
  EXPECT_EQ(input.joint_fresh[kJoints * kLimb + 6], 1);
  EXPECT_EQ(input.joint_position_rad[kJoints * kLimb + 6], 0.25);
  EXPECT_EQ(input.joint_fresh[kJoints * kLimb + 5], 0);
  EXPECT_EQ(limb.silent_nodes(), (std::vector<int>{1, 2, 3, 4, 5, 6, 7}));
}

TEST_F(LimbBusTest, NodeEightIsAskedWithTheGripper) {
  LimbBus limb(kLimb, robot_of_seven());
  for (std::uint8_t node = 1; node <= 7; ++node)
    limb.take(nodes_.identity(node, CRUX_CAN_PROTOCOL_VERSION, kLimb, kParameterHash), notice_);
  EXPECT_FALSE(limb.identified());
  const HostHeartbeat heartbeat{0, 0};
  EXPECT_EQ(limb.pack_cycle(output_, 1, &heartbeat)[0].data[3] >> 5, 7) << "Identify";
}

TEST(LimbBus, ABroadcastHasNoRoomForSevenJoints) {
  EXPECT_THROW(LimbBus(kLimb, robot_of_seven(), CommandFrames::kBroadcast), BusError);
}

TEST_F(LimbBusTest, EmergenciesAreForwarded) {
  ASSERT_TRUE(take(nodes_.emergency(3, 6, 77)));
  EXPECT_EQ(notice_.kind, NodeNotice::Kind::kEmergency);
  EXPECT_EQ(notice_.limb, kLimb);
  EXPECT_EQ(notice_.node, 3);
  EXPECT_EQ(notice_.cause, 6);
  EXPECT_EQ(notice_.detail, 77U);
  nodes_ = Nodes();  // restarted: counts anew
  EXPECT_TRUE(take(nodes_.emergency(3, CRUX_CAN_JOINT_EMERGENCY_CAUSE_RESTARTED_CHOICE, 0)));
  EXPECT_EQ(input().joint_state[kLimb * kJoints + 2], 0);  // BOOT
}

TEST_F(LimbBusTest, NodeNumbersOutsideTheDatabaseAreRefused) {
  for (const int wrong : {0, 7, -1, 2}) {
    RobotDescription robot = test_robot();
    robot.can.nodes.joints[0] = wrong;
    EXPECT_THROW(LimbBus(0, robot), BusError) << wrong;
  }
  RobotDescription robot = test_robot();
  robot.can.nodes.gripper = 8;
  EXPECT_THROW(LimbBus(0, robot), BusError);
}

}  // namespace
}  // namespace crux
