// A plan that begins with a limb in the air: how it is read, and taken over by a robot that holds without its stance
// being dropped.
#include <algorithm>
#include <cmath>

#include "core/robot/node_protocol.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;
using crux_msgs::plan_t;

constexpr double kNewHold_m = 0.20;  // x of the hold that LF goes to

/// The sample without what comes before LF lets go, the body where the sample begins.
plan_t plan_from_air() {
  plan_t plan = sample_plan();
  plan.format = plan_t::FORMAT_FROM_AIR;
  const crux_msgs::plan_knot_t first = plan.knots.front();
  plan.knots.erase(plan.knots.begin(), plan.knots.begin() + 3);
  for (std::size_t k = 0; k < plan.knots.size(); ++k) {
    plan.knots[k].time_s = plan.dt_s * static_cast<double>(k);
    std::copy_n(first.body_position_w_m, 3, plan.knots[k].body_position_w_m);
  }
  sign(plan);
  return plan;
}

TEST(FromAir, TheSwingBeginsWithOpenFingersAtTheFirstKnot) {
  const std::unique_ptr<PreparedPlan> plan = tabulate(plan_from_air());
  std::vector<LimbPhase> seen;
  for (int i = 0; i < 100 * plan->intervals(); ++i) {
    const LimbReference limb = play(*plan, {i / 100, (i % 100) * plan->step_s[i / 100] / 100}).limbs[0];
    if (seen.empty() || seen.back() != limb.phase) seen.push_back(limb.phase);
    if (limb.phase == LimbPhase::kOpen) {
      EXPECT_EQ(limb.finger_opening_m, plan->limbs[1][0].finger_opening_m);
      EXPECT_EQ(limb.gripper_position_W_m, plan->limbs[0][0].gripper_position_W_m);
      EXPECT_EQ(limb.load, 0.0);
    }
  }
  using enum LimbPhase;
  EXPECT_EQ(seen, (std::vector<LimbPhase>{kOpen, kLift, kSwing, kDescend, kClose, kLoad, kStance}));
}

TEST(FromAir, TheClockWaitsForTheFingersBeforeTheGripperMoves) {
  const std::unique_ptr<PreparedPlan> plan = tabulate(plan_from_air());
  PlanClock clock;
  PerLimb<LimbEvents> events;  // nothing is seen
  for (int i = 0; i < 5000; ++i) clock.advance(*plan, events, 0.002, 1.0);
  EXPECT_EQ(clock.waiting_for(), WaitingFor::kOpen);
  EXPECT_EQ(clock.waiting_limb(), 0);
  EXPECT_NEAR(clock.now().seconds(*plan), 0.5 * plan->step_s[0], 1e-9);
  EXPECT_FALSE(clock.can_reverse(*plan));
}

TEST(FromAir, ARobotThatHasJustBeenSwitchedOnTakesItToo) {
  Climber run(sample_plan());
  ASSERT_EQ(run.core.load_plan(plan_from_air()), "");
  EXPECT_TRUE(run.until(SupervisorState::kReady, 20));
}

/// LF has lost its hold in stance and the robot holds.
class HandOver : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
    run_.step(command_t::START);
    run_.steps(100);
    for (int i = 0; i < 100 && !run_.result.has_fault; ++i) loose_step();
    ASSERT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kGripLost));
    for (int i = 0; i < 500; ++i) loose_step();
    ASSERT_EQ(run_.core.state(), SupervisorState::kHolding);
  }
  /// LF's fingers have nothing between them before they come to the new hold.
  void loose_step(int command = command_t::NONE) {
    if (run_.result.telemetry[0].gripper_position_w_m[0] < kNewHold_m - 0.02) loosen(run_.plant.input(), 0);
    run_.step(command);
  }
  /// The same, with every joint tracking and none of them jumping.
  void watched_step(int command = command_t::NONE) {
    const double* joint_rad = run_.plant.input().joint_position_rad;
    const std::vector<double> before_rad(joint_rad, joint_rad + kAllJoints);
    const std::vector<double> before_Nm(run_.result.output.joint_torque_nm,
                                        run_.result.output.joint_torque_nm + kAllJoints);
    loose_step(command);
    for (int j = 0; j < kAllJoints; ++j) {
      ASSERT_EQ(run_.result.output.joint_mode[j], static_cast<int>(NodeMode::kTrack)) << "joint " << j;
      ASSERT_LT(std::abs(joint_rad[j] - before_rad[j]), 0.002) << "joint " << j;
      ASSERT_LT(std::abs(run_.result.output.joint_torque_nm[j] - before_Nm[j]), 0.4) << "joint " << j;
    }
    for (int l = 1; l < kLimbs; ++l) ASSERT_GT(run_.plant.input().finger_force_n[l], 5.0) << "limb " << l;
  }
  Climber run_{sample_plan()};
};

TEST_F(HandOver, TheStanceIsHeldOnAndTheLimbGoesToAnotherHold) {
  ASSERT_EQ(run_.core.load_plan(plan_from_air()), "");
  EXPECT_EQ(run_.core.state(), SupervisorState::kReady);
  watched_step();
  EXPECT_EQ(run_.core.state(), SupervisorState::kReady);
  EXPECT_EQ(run_.result.state.fault_code, 0);
  for (int i = 0; i < 1000; ++i) watched_step();
  watched_step(command_t::START);
  ASSERT_EQ(run_.result.command_verdict, CommandVerdict::kAccepted);
  for (int i = 0; i < 20000 && run_.core.state() == SupervisorState::kClimbing; ++i) watched_step();
  EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
  EXPECT_EQ(run_.result.state.plan_complete, 1) << "fault " << run_.result.state.fault_code;
  EXPECT_NEAR(run_.result.telemetry[0].gripper_position_w_m[0], kNewHold_m, 3e-3);
  EXPECT_GT(run_.plant.input().finger_force_n[0], 5.0);
}

TEST_F(HandOver, AnotherHoldThatGoesBeforeTheStartIsTold) {
  ASSERT_EQ(run_.core.load_plan(plan_from_air()), "");
  for (int i = 0; i < 200 && !run_.result.has_fault; ++i) {
    loosen(run_.plant.input(), 3);
    loose_step();
  }
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kGripLost));
  EXPECT_EQ(run_.result.fault.limb, 3);
  EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
}

TEST_F(HandOver, APlanThatCountsOnTheLostHoldIsRefused) {
  const std::string reason = run_.core.load_plan(sample_plan());
  EXPECT_NE(reason.find("LF: the plan starts with this gripper on a hold, but it is in the air"), std::string::npos)
      << reason;
  loose_step();
  EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
  EXPECT_EQ(run_.result.state.fault_code, static_cast<int>(FaultCode::kGripLost));
}

TEST_F(HandOver, APlanThatBeginsElsewhereIsRefusedWithLimbAndAmount) {
  plan_t plan = plan_from_air();
  for (crux_msgs::plan_knot_t& knot : plan.knots) knot.limbs[3].gripper_position_w_m[0] += 0.034;
  sign(plan);
  const std::string reason = run_.core.load_plan(plan);
  const std::string told = "RR: the gripper is ";
  ASSERT_EQ(reason.substr(0, told.size()), told) << reason;
  EXPECT_NEAR(std::stod(reason.substr(told.size())), 0.034, 1e-3) << reason;
}

TEST(FromStance, ALimbWhoseForceTorqueSensorIsDeadClimbsAnotherPlanAllTheSame) {
  Climber run(sample_plan());
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(1000);
  run.step(command_t::START);
  run.steps(200);
  const auto dead_step = [&](int command = command_t::NONE) {
    std::fill_n(run.plant.input().ft_force_g_n, 3, 30.0);  // LF feels a load all the time
    std::fill_n(run.plant.input().ft_moment_g_nm, 3, 0.0);
    run.step(command);
  };
  for (int i = 0; i < 1000 && !run.result.has_fault; ++i) dead_step();
  ASSERT_EQ(run.result.fault.code, static_cast<int>(FaultCode::kFtImplausible));
  ASSERT_EQ(run.result.fault.limb, 0);
  plan_t plan = sample_plan();
  plan.cost = 1.0;  // another plan
  sign(plan);
  ASSERT_EQ(run.core.load_plan(plan), "");
  for (int i = 0; i < 500; ++i) dead_step();
  ASSERT_EQ(run.core.state(), SupervisorState::kReady) << "told of the same sensor again";
  dead_step(command_t::START);
  for (int i = 0; i < 20000 && run.core.state() == SupervisorState::kClimbing; ++i) dead_step();
  EXPECT_EQ(run.result.state.plan_complete, 1) << "fault " << run.result.state.fault_code;
  EXPECT_NEAR(run.result.telemetry[0].gripper_position_w_m[0], kNewHold_m, 3e-3);
}

TEST(FromAir, ALimbThatBearsIsNotTakenForOneInTheAir) {
  Climber run(sample_plan());
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(1000);
  const std::string reason = run.core.load_plan(plan_from_air());
  EXPECT_NE(reason.find("LF: the plan starts with this gripper in the air, but it is on its hold"), std::string::npos)
      << reason;
}

}  // namespace
}  // namespace crux_test
