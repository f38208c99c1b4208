// Nodes that hold by themselves while the robot is HOLDING: what their limb cannot yield to does not add up in the
// commands, and the commands do not follow a joint that sags.
#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "core/robot/node_protocol.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;
using crux_msgs::control_input_t;

constexpr int kJoint = 2 * kJoints + 1;  // LR's second
constexpr int kLimb = kJoint / kJoints;
constexpr int kLong = 2500;  // cycles
constexpr double kSag_rad = 0.002;

class StandingNode : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
    run_.step(command_t::START);
    run_.steps(100);
    ASSERT_EQ(run_.core.state(), SupervisorState::kClimbing);
    began_rad_ = in().joint_position_rad[kJoint];
  }

  control_input_t& in() { return run_.plant.input(); }
  std::vector<double> commands_rad() const {
    return {std::begin(run_.result.output.joint_position_rad), std::end(run_.result.output.joint_position_rad)};
  }
  std::vector<double> joints_rad() { return {std::begin(in().joint_position_rad), std::end(in().joint_position_rad)}; }

  /// The limbs feel what they cannot all yield to.
  void press(double force_N) {
    for (int l = 0; l < kLimbs; ++l) in().ft_force_g_n[3 * l + 1] += l % 2 == 0 ? force_N : -force_N;
  }

  /// One cycle in which the joint's node holds it and says `state`.
  void step_held(NodeState state) {
    in().joint_position_rad[kJoint] = began_rad_;
    in().joint_state[kJoint] = static_cast<std::int8_t>(state);
    run_.step();
  }

  void expect_held_for(FaultCode code, int limb) {
    EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
    ASSERT_EQ(run_.core.standing().size(), 1U) << "nothing follows from it";
    EXPECT_EQ(run_.core.standing()[0].code, code);
    EXPECT_EQ(run_.core.standing()[0].limb, limb);
  }

  Climber run_{sample_plan()};
  double began_rad_ = 0.0;
};

double largest_change(const std::vector<double>& before, const std::vector<double>& after, int first, int last) {
  double most = 0.0;
  for (int i = first; i < last; ++i) most = std::max(most, std::abs(after[i] - before[i]));
  return most;
}

TEST_F(StandingNode, CommandsStayWhereAllNodesHaveLatchedTheirHold) {
  std::ranges::fill(in().joint_faults, kFaultCommandTimeout);
  std::ranges::fill(in().gripper_faults, kFaultCommandTimeout);
  run_.step();
  const std::vector<double> commands = commands_rad(), joints = joints_rad();
  const std::vector<double> openings(run_.result.output.finger_opening_m, run_.result.output.finger_opening_m + kLimbs);
  for (int i = 0; i < kLong; ++i) {
    press(6.0);
    run_.step();
  }
  expect_held_for(FaultCode::kAllNodesHold, -1);
  EXPECT_LT(largest_change(commands, commands_rad(), 0, kAllJoints), 1e-3);
  for (int l = 0; l < kLimbs; ++l) EXPECT_NEAR(run_.result.output.finger_opening_m[l], openings[l], 1e-4) << l;
  run_.step(command_t::CLEAR_FAULT);
  run_.steps(100);
  EXPECT_EQ(in().joint_faults[0], 0) << "armed again";
  EXPECT_LT(largest_change(joints, joints_rad(), 0, kAllJoints), 0.01);
  EXPECT_EQ(run_.step(command_t::RESUME).command_verdict, CommandVerdict::kAccepted);
}

TEST_F(StandingNode, ItsLimbStandsStillAndTheOthersYield) {
  in().joint_faults[kJoint] = kFaultCommandTimeout;
  run_.step();
  const std::vector<double> before = commands_rad();
  for (int i = 0; i < 50; ++i) {
    press(2.0);
    run_.step();
  }
  expect_held_for(FaultCode::kNodeHolds, kLimb);
  const std::vector<double> after = commands_rad();
  EXPECT_LT(largest_change(before, after, kLimb * kJoints, (kLimb + 1) * kJoints), 1e-4);
  EXPECT_GT(largest_change(before, after, 0, kLimb * kJoints), 1e-3);
}

TEST_F(StandingNode, WhatFollowsAgainDoesNotJump) {
  for (int i = 0; i < kLong; ++i) {
    in().ft_force_g_n[3 * kLimb + 1] += 3.0;
    step_held(i < 5 ? NodeState::kDecelerate : NodeState::kHold);
  }
  expect_held_for(FaultCode::kNodeHolds, kLimb);
  in().joint_position_rad[kJoint] = began_rad_;
  const std::vector<double> before = joints_rad();
  run_.steps(20);
  EXPECT_LT(largest_change(before, joints_rad(), kLimb * kJoints, (kLimb + 1) * kJoints), 2e-3);
}

TEST_F(StandingNode, CommandsDoNotFollowAJointThatSags) {
  in().joint_faults[kJoint] = kFaultCommandTimeout;
  run_.step();
  const std::vector<double> before = commands_rad();
  for (int i = 0; i < kLong; ++i) {
    in().joint_position_rad[kJoint] = began_rad_ - kSag_rad * std::min(i / 500.0, 1.0);
    run_.step();
  }
  EXPECT_LT(largest_change(before, commands_rad(), kJoint, kJoint + 1), 1e-4);
}

TEST_F(StandingNode, OneThatRestartsAndHangsBelowItsSetpointDoesNotTakeTheBodyAlong) {
  const Vector3 body_m(run_.result.state.body_position_w_m);
  double setpoint_rad = began_rad_, body_moved_m = 0.0, joint_moved_rad = 0.0;
  for (int i = 0; i < kLong; ++i) {
    // It has started with its setpoint where it was, and follows; without its feed-forward it hangs lower.
    if (i > 0)
      setpoint_rad += setpoint_share(in().dt_s) * (run_.result.output.joint_position_rad[kJoint] - setpoint_rad);
    in().joint_position_rad[kJoint] = setpoint_rad - kSag_rad;
    if (i == 0) in().joint_state[kJoint] = static_cast<std::int8_t>(NodeState::kBoot);
    run_.step();
    body_moved_m = std::max(body_moved_m, (Vector3(run_.result.state.body_position_w_m) - body_m).norm());
    joint_moved_rad = std::max(joint_moved_rad, std::abs(in().joint_position_rad[kJoint] - began_rad_));
  }
  expect_held_for(FaultCode::kNodeHolds, kLimb);
  EXPECT_LT(body_moved_m, 5e-4);
  EXPECT_LT(joint_moved_rad, 2.0 * kSag_rad);
}

}  // namespace
}  // namespace crux_test
