// Whole climbs on a plant that obeys at once.
#include <cstring>

#include "core/robot/node_protocol.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr int kSettle = 1000;
constexpr int kClimb = 15000;

TEST(Climb, ReachesThePlansEndAndHolds) {
  Climber run(sample_plan());
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(kSettle);
  EXPECT_EQ(run.step(command_t::START).command_verdict, CommandVerdict::kAccepted);
  double last_time_s = 0.0, largest_joint_step = 0.0;
  // Commands lead by what the nodes' filter lags: what comes out of it must not jump.
  const double* setpoint_rad = run.plant.input().joint_position_rad;
  std::vector<double> before(setpoint_rad, setpoint_rad + kAllJoints);
  for (int i = 0; i < kClimb && run.core.state() == SupervisorState::kClimbing; ++i) {
    run.step();
    ASSERT_FALSE(run.result.has_fault) << "code " << run.result.fault.code;
    ASSERT_GE(run.result.state.plan_time_s, last_time_s);
    last_time_s = run.result.state.plan_time_s;
    for (int j = 0; j < kAllJoints; ++j) {
      largest_joint_step = std::max(largest_joint_step, std::abs(setpoint_rad[j] - before[j]));
      before[j] = setpoint_rad[j];
    }
  }
  EXPECT_EQ(run.core.state(), SupervisorState::kHolding);
  EXPECT_EQ(run.result.state.plan_complete, 1);
  EXPECT_EQ(run.result.state.plan_time_s, run.result.state.plan_end_s);
  // The body ends where the plan ends, LF on its new hold; commands never jumped.
  EXPECT_NEAR(run.result.state.body_position_w_m[0], 0.01, 1e-3);
  EXPECT_NEAR(run.result.telemetry[0].gripper_position_w_m[0], 0.20, 2e-3);
  EXPECT_LT(largest_joint_step, 1.0 * 0.002);
}

TEST(Climb, FingersThatGripAWiderHoldThanPlannedComeOffItBeforeTheyLift) {
  crux_msgs::plan_t plan = sample_plan();
  for (crux_msgs::plan_knot_t& knot : plan.knots) knot.limbs[0].finger_separation_m -= 0.034;
  sign(plan);
  const crux_msgs::limb_knot_t &grip = plan.knots[0].limbs[0], &air = plan.knots[4].limbs[0];
  const double opens_m = (air.finger_separation_m - grip.finger_separation_m) / 2;
  Climber run(plan);
  const double hold_m = run.plant.input().finger_opening_m[0];
  ASSERT_LT(air.finger_separation_m / 2, hold_m) << "open as planned they would still press";
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(kSettle);
  run.step(command_t::START);
  const auto lifts = [&] { return run.result.reference[0].phase == static_cast<int>(LimbPhase::kLift); };
  for (int i = 0; i < kClimb && !lifts(); ++i) run.step();
  ASSERT_TRUE(lifts());
  EXPECT_NEAR(run.plant.input().finger_opening_m[0], hold_m + opens_m, robot().supervisor.open_tolerance_m);
}

TEST(Climb, TheSameInputsGiveTheSameBits) {
  Climber a(sample_plan()), b(sample_plan());
  for (int i = 0; i < 6000; ++i) {
    const int command = i == 1200 ? command_t::START : command_t::NONE;
    a.step(command);
    b.step(command);
    ASSERT_EQ(std::memcmp(&a.result.output, &b.result.output, sizeof(a.result.output)), 0) << "cycle " << i;
    ASSERT_EQ(std::memcmp(&a.result.telemetry, &b.result.telemetry, sizeof(a.result.telemetry)), 0) << "cycle " << i;
  }
  EXPECT_EQ(a.core.state(), SupervisorState::kClimbing);
}

TEST(Climb, TakesOverWithoutAJolt) {
  Climber run(sample_plan());
  const std::vector<double> start(run.plant.input().joint_position_rad,
                                  run.plant.input().joint_position_rad + kAllJoints);
  for (double& torque : run.plant.input().joint_torque_nm) torque = 0.0;
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  for (int j = 0; j < kAllJoints; ++j) {
    EXPECT_NEAR(run.result.output.joint_position_rad[j], start[j], 1e-4);
    EXPECT_NEAR(run.result.output.joint_torque_nm[j], 0.0, 1e-3);
  }
  constexpr double kProbe_Nm = 0.2;  // to and fro, to measure how late the drives are
  double largest = 0.0;
  std::vector<double> before(run.result.output.joint_torque_nm, run.result.output.joint_torque_nm + kAllJoints);
  for (int i = 0; i < 500; ++i) {
    run.step();
    for (int j = 0; j < kAllJoints; ++j) {
      largest = std::max(largest, std::abs(run.result.output.joint_torque_nm[j] - before[j]));
      before[j] = run.result.output.joint_torque_nm[j];
    }
  }
  EXPECT_LT(largest, 2.0 * kProbe_Nm + 0.1);  // Nm a cycle, on the way to several Nm
}

TEST(Climb, StaysIdleWhenTheRobotStandsElsewhere) {
  Climber run(sample_plan());
  run.plant.input().joint_position_rad[1] += 0.3;
  run.steps(50);
  EXPECT_EQ(run.core.state(), SupervisorState::kIdle);
  EXPECT_EQ(run.step(command_t::START).command_verdict, CommandVerdict::kRefused);
  EXPECT_NE(in_words(run.result.command_refusal).find("from the plan's start pose (limit: "), std::string::npos);
  for (const std::int8_t mode : run.result.output.joint_mode)
    EXPECT_EQ(mode, static_cast<std::int8_t>(NodeMode::kHold));
}

TEST(Climb, StaysIdleUntilAllNodesAnswer) {
  Climber run(sample_plan());
  run.plant.input().gripper_fresh[3] = 0;
  run.steps(50);
  EXPECT_EQ(run.core.state(), SupervisorState::kIdle);
  run.plant.input().gripper_fresh[3] = 1;
  EXPECT_TRUE(run.until(SupervisorState::kReady, 5));
}

TEST(Climb, NodesLatchedBeforeItsTimeAreRearmedOnTheOperatorsWordOnly) {
  Climber run(sample_plan());
  for (std::int16_t& faults : run.plant.input().joint_faults) faults = kFaultCommandTimeout;
  run.steps(100);
  EXPECT_EQ(run.core.state(), SupervisorState::kIdle);
  run.step(command_t::START);
  EXPECT_STREQ(run.result.command_refusal.text, "nodes hold by themselves; clear the fault to re-arm them");
  run.step(command_t::CLEAR_FAULT);
  EXPECT_TRUE(run.until(SupervisorState::kReady, 100));
}

TEST(Climb, ACarriedBodyIsNotPushedAgainst) {
  // Somebody holds the body 3 mm off its reference for ten seconds; the commands must not run away from it.
  crux_msgs::plan_t plan = sample_plan();
  Climber run(plan);
  for (crux_msgs::plan_knot_t& knot : plan.knots) knot.body_position_w_m[0] += 0.003;
  sign(plan);
  ASSERT_EQ(run.core.load_plan(plan), "");
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(100);
  const std::vector<double> start(run.result.output.joint_position_rad,
                                  run.result.output.joint_position_rad + kAllJoints);
  run.steps(5000);
  for (int j = 0; j < kAllJoints; ++j) EXPECT_NEAR(run.result.output.joint_position_rad[j], start[j], 2e-3);
}

TEST(Climb, TheClockWaitsForTheStartToSettle) {
  Climber run(sample_plan());
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.step(command_t::START);
  run.steps(100);
  EXPECT_EQ(run.result.state.plan_time_s, 0.0);
  EXPECT_EQ(run.result.state.waiting_for, static_cast<int>(WaitingFor::kSettle));
  run.steps(static_cast<int>(robot().supervisor.settle_time_s / 0.002));
  EXPECT_GT(run.result.state.plan_time_s, 0.0);
}

TEST(Climb, AGripThatIsLooseBeforeTheClockStartsIsWaitedForAndNotLost) {
  Climber run(sample_plan());
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.step(command_t::START);
  const int cycles = static_cast<int>(4.0 * robot().supervisor.persistence_s / 0.002);
  for (int i = 0; i < cycles; ++i) {
    loosen(run.plant.input(), 2);
    run.step();
  }
  EXPECT_FALSE(run.result.has_fault);
  EXPECT_EQ(run.core.state(), SupervisorState::kClimbing);
  EXPECT_EQ(run.result.state.plan_time_s, 0.0);
}

TEST(Climb, TakesNoOtherPlanWhileClimbing) {
  Climber run(sample_plan());
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(kSettle);
  run.step(command_t::START);
  run.steps(100);
  EXPECT_NE(run.core.load_plan(sample_plan()), "");
  EXPECT_EQ(run.core.state(), SupervisorState::kClimbing);
  run.step(command_t::HOLD);
  EXPECT_EQ(run.core.load_plan(sample_plan()), "");
  EXPECT_EQ(run.core.state(), SupervisorState::kReady);  // it still stands where that plan begins
}

TEST(Climb, WithoutAPlanItHoldsAndKeepsQuiet) {
  ControlCore core(robot());
  crux_msgs::control_input_t in = ObedientPlant(sample_plan()).input();
  CycleResult out;
  for (int i = 0; i < 10; ++i) core.step(in, out);
  EXPECT_EQ(core.state(), SupervisorState::kIdle);
  EXPECT_FALSE(out.has_fault);
}

}  // namespace
}  // namespace crux_test
