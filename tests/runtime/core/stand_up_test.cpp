// A robot whose nodes have had no power: what is told, and how it stands up from where it hangs.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/robot/inverse_kinematics.hpp"
#include "core/robot/node_protocol.hpp"
#include "core/stand_up.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr int kSilentCycles = 250;
constexpr double kSunk_m = 0.06, kTilted_rad = 0.12;
constexpr int kStandUpCycles = 2000;

class StandingUp : public testing::Test {
 protected:
  explicit StandingUp(const RobotDescription& climbs = robot()) : run_(sample_plan(), climbs) {}
  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
    run_.step(command_t::START);
    run_.steps(400);
    ASSERT_EQ(run_.core.state(), SupervisorState::kClimbing);
  }
  crux_msgs::control_input_t& input() { return run_.plant.input(); }

  void silence(int limb) {
    std::fill_n(input().joint_fresh + kJoints * limb, kJoints, 0);
    input().gripper_fresh[limb] = input().ft_fresh[limb] = 0;
  }

  /// The limb's nodes are back: they have restarted.
  void restart(int limb) {
    const int first = kJoints * limb;
    std::fill_n(input().joint_fresh + first, kJoints, 1);
    input().gripper_fresh[limb] = input().ft_fresh[limb] = 1;
    std::fill_n(input().joint_state + first, kJoints, static_cast<std::int8_t>(NodeState::kBoot));
    input().gripper_state[limb] = static_cast<std::int8_t>(NodeState::kBoot);
    std::fill_n(input().joint_torque_nm + first, kJoints, 0.0);
    input().finger_force_n[limb] = 0.0;
  }

  void cut_power(int cycles) {
    for (int i = 0; i < cycles; ++i) {
      for (int l = 0; l < kLimbs; ++l) silence(l);
      run_.step();
    }
    sink();
    for (int l = 0; l < kLimbs; ++l) restart(l);
  }

  /// Joints as they are where the body has sunk with all grippers on their holds.
  void sink() {
    const crux_msgs::robot_state_t& state = run_.result.state;
    const double* q = state.body_quaternion_w;
    plan_W_m_ = Vector3(state.body_position_w_m);
    const Pose body_W{Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix(), Vector3(state.body_position_w_m)};
    const Pose sunk_W{rotation_exp({0.0, kTilted_rad, 0.0}) * body_W.rotation,
                      body_W.position_m + kSunk_m * Vector3(-std::sqrt(0.5), 0.0, -std::sqrt(0.5))};
    for (int l = 0; l < kLimbs; ++l) {
      LimbKinematics kinematics(robot().limbs[l]);
      InverseKinematics inverse(robot().limbs[l], kinematics);
      const JointVector at_rad(input().joint_position_rad + kJoints * l);
      LimbState limb;
      kinematics.evaluate(at_rad, limb);
      const IkResult result = inverse.solve(sunk_W.inverse() * (body_W * limb.gripper_B), at_rad, 100);
      ASSERT_LT(result.position_error_m, 1e-4);
      std::copy_n(result.q_rad.data(), kJoints, input().joint_position_rad + kJoints * l);
    }
  }

  bool stands_up() const { return run_.result.state.waiting_for == static_cast<int>(WaitingFor::kStandUp); }

  /// Of the body from where the plan has it, as far as it is to be there already.
  double off_m() const {
    const crux_msgs::robot_state_t& state = run_.result.state;
    return (Vector3(state.body_position_w_m) - Vector3(state.body_reference_position_w_m)).norm();
  }

  double off_plan_m() const { return (plan_W_m_ - Vector3(run_.result.state.body_position_w_m)).norm(); }

  Vector3 plan_W_m_ = Vector3::Zero();  ///< where the body was as it sank
  Climber run_;
};

RobotDescription weak_robot() {
  RobotDescription weak = robot();
  weak.limbs[2].joints[1].effort_Nm = 6.8;
  return weak;
}

/// A joint would need all its torque where the robot hangs, if the others did not take over.
class WeaklyStandingUp : public StandingUp {
 protected:
  WeaklyStandingUp() : StandingUp(weak_robot()) {}
};

TEST_F(StandingUp, FromWhereItHangsSlowlyAndThenGoesOn) {
  cut_power(kSilentCycles);
  ASSERT_EQ(run_.core.state(), SupervisorState::kFault);
  EXPECT_EQ(run_.result.state.fault_code, static_cast<int>(FaultCode::kAllNodesSilent));
  ASSERT_TRUE(run_.until(SupervisorState::kHolding, 1000));
  ASSERT_TRUE(run_.result.has_fault);
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kPowerLost));
  EXPECT_EQ(run_.result.fault.limb, -1);
  EXPECT_NEAR(run_.result.fault.value, kSilentCycles * 0.002, 0.003);

  std::vector<double> before(input().joint_position_rad, input().joint_position_rad + kAllJoints);
  const Vector3 body_m(run_.result.state.body_position_w_m);
  int rising = 0;
  for (int i = 0; i < 300 + kStandUpCycles && (i < 300 || stands_up()); ++i) {
    rising += stands_up() ? 1 : 0;
    const bool asks = i == 500;
    run_.step(asks ? command_t::RESUME : command_t::NONE);
    EXPECT_EQ(std::string(asks ? run_.result.command_refusal.text : ""), asks ? "a fault stands; clear it first" : "");
    for (int j = 0; j < kAllJoints; ++j) {
      ASSERT_LT(std::abs(input().joint_position_rad[j] - before[j]), 0.5 * 0.002) << "joint " << j << " cycle " << i;
      before[j] = input().joint_position_rad[j];
    }
  }
  EXPECT_FALSE(stands_up());
  EXPECT_GT(rising, static_cast<int>(kSunk_m / 0.02 / 0.002)) << "no faster than 2 cm/s";
  EXPECT_LT(off_m(), 0.003);
  EXPECT_GT((Vector3(run_.result.state.body_position_w_m) - body_m).norm(), 0.9 * kSunk_m);
  EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);

  EXPECT_EQ(run_.step(command_t::CLEAR_FAULT).command_verdict, CommandVerdict::kAccepted);
  run_.steps(100);
  EXPECT_EQ(run_.step(command_t::RESUME).command_verdict, CommandVerdict::kAccepted);
  EXPECT_TRUE(run_.until(SupervisorState::kHolding, 20000));
  EXPECT_EQ(run_.result.state.plan_complete, 1);
}

TEST_F(StandingUp, IsNotInterruptedByResume) {
  cut_power(kSilentCycles);
  ASSERT_TRUE(run_.until(SupervisorState::kHolding, 1000));
  run_.steps(500);
  ASSERT_TRUE(stands_up());
  EXPECT_EQ(run_.step(command_t::CLEAR_FAULT).command_verdict, CommandVerdict::kAccepted);
  run_.steps(100);
  ASSERT_TRUE(stands_up());
  EXPECT_EQ(run_.step(command_t::RESUME).command_verdict, CommandVerdict::kRefused);
  EXPECT_STREQ(run_.result.command_refusal.text,
               "the robot stands up to where it was before; try again when it stands");
  run_.steps(kStandUpCycles);
  EXPECT_FALSE(stands_up());
  EXPECT_EQ(run_.step(command_t::RESUME).command_verdict, CommandVerdict::kAccepted);
}

TEST_F(StandingUp, StopsWhereAJointBearsNoMoreAndSaysSo) {
  cut_power(kSilentCycles);
  ASSERT_TRUE(run_.until(SupervisorState::kHolding, 1000));
  run_.steps(700);
  ASSERT_TRUE(stands_up());
  const double reached_m = off_plan_m();
  const double effort_Nm = robot().limbs[1].joints[2].effort_Nm;
  for (int i = 0; i < 4000 && run_.result.state.fault_code != static_cast<int>(FaultCode::kStandsNoFurther); ++i) {
    input().joint_torque_nm[kJoints + 2] = effort_Nm;
    run_.step();
  }
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kStandsNoFurther));
  EXPECT_NEAR(run_.result.fault.value, off_plan_m(), 0.005);
  EXPECT_NEAR(off_plan_m(), reached_m, 0.002);
  EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
  run_.steps(kStandUpCycles);
  EXPECT_FALSE(stands_up()) << "goes on once it can";
}

TEST_F(WeaklyStandingUp, OthersTakeOverFromAJointThatBearsNoMore) {
  cut_power(kSilentCycles);
  ASSERT_TRUE(run_.until(SupervisorState::kHolding, 1000));
  for (int i = 0; i < 300 + kStandUpCycles && (i < 300 || stands_up()); ++i) run_.step();
  EXPECT_FALSE(stands_up());
  EXPECT_NE(run_.result.state.fault_code, static_cast<int>(FaultCode::kStandsNoFurther));
}

TEST(StandUp, GoesOnAsLongAsALimbComesNoFurtherFromWhereItShouldBe) {
  StandUp rise;
  rise.begin({Matrix3::Identity(), {0.0, 0.0, 0.1}}, {Matrix3::Identity(), {0.0, 0.0, 0.2}});
  EXPECT_TRUE(rise.follows(1, 0.008)) << "further than it may be, but as it was";
  EXPECT_TRUE(rise.follows(1, 0.004));
  EXPECT_TRUE(rise.follows(1, 0.0043));
  EXPECT_FALSE(rise.follows(1, 0.008)) << "further than it was";
  EXPECT_TRUE(rise.follows(1, 0.003));
  EXPECT_TRUE(rise.follows(2, 0.0)) << "of another limb";
  EXPECT_TRUE(rise.follows(2, 0.0015));
  EXPECT_FALSE(rise.follows(2, 0.0025));
}

TEST_F(StandingUp, ALimbWithoutPowerIsNamed) {
  for (int i = 0; i < kSilentCycles; ++i) {
    silence(2);
    run_.step();
  }
  EXPECT_EQ(run_.result.state.fault_code, static_cast<int>(FaultCode::kNodeSilent));
  restart(2);
  ASSERT_TRUE(run_.until(SupervisorState::kHolding, 1000));
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kPowerLost));
  EXPECT_EQ(run_.result.fault.limb, 2);
  EXPECT_EQ(run_.result.fault.node, 0);
}

TEST_F(StandingUp, NodesThatWereSilentAndHaveNotRestartedHadPower) {
  for (int i = 0; i < kSilentCycles; ++i) {
    for (int l = 0; l < kLimbs; ++l) silence(l);
    run_.step();
  }
  for (int l = 0; l < kLimbs; ++l) {
    std::fill_n(input().joint_fresh + kJoints * l, kJoints, 1);
    input().gripper_fresh[l] = input().ft_fresh[l] = 1;
  }
  ASSERT_TRUE(run_.until(SupervisorState::kHolding, 1000));
  EXPECT_EQ(run_.result.state.fault_code, static_cast<int>(FaultCode::kAllNodesSilent));
}

}  // namespace
}  // namespace crux_test
