// An operator who slows a climb down, takes it step by step and back, on a plant that obeys at once.
#include <cmath>

#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;
using crux_msgs::robot_state_t;

constexpr int kLong = 15000;         // more cycles than the plan has
constexpr double kOldHold_m = 0.14;  // x of the hold that LF leaves
constexpr double kNewHold_m = 0.20;  // and of the one it takes
constexpr double kMidSwing_s = 9.0;  // of the plan
constexpr double kOnNewHold_s = 13.5;

class Operator : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
  }
  CommandVerdict order(int command, double value = 0.0) {
    run_.plant.input().command_value = value;
    run_.step(command);
    run_.plant.input().command_value = 0.0;
    return run_.result.command_verdict;
  }
  double plan_time_s() const { return run_.result.state.plan_time_s; }
  double lf_x_m() const { return run_.result.telemetry[0].gripper_position_w_m[0]; }
  /// Climbs until plan time, then holds.
  void climb_to(double time_s) {
    for (int i = 0; i < kLong && plan_time_s() < time_s; ++i) watched_step();
    ASSERT_GE(plan_time_s(), time_s);
    ASSERT_EQ(order(command_t::HOLD), CommandVerdict::kAccepted);
  }
  void until_holding() {
    for (int i = 0; i < 2 * kLong && run_.core.state() == SupervisorState::kClimbing; ++i) watched_step();
    ASSERT_EQ(run_.core.state(), SupervisorState::kHolding);
  }
  void expect_all_bear() const {
    for (int l = 0; l < kLimbs; ++l) {
      EXPECT_EQ(run_.result.reference[l].phase, static_cast<int>(LimbPhase::kStance)) << "limb " << l;
      EXPECT_NEAR(run_.result.reference[l].load, 1.0, 1e-9) << "limb " << l;
      EXPECT_GT(run_.result.telemetry[l].grasp_force_n, robot().control.contact_force_N) << "limb " << l;
    }
  }
  /// No fault, no jump of a joint, and no open finger under load.
  void watched_step() {
    const double* setpoint_rad = run_.plant.input().joint_position_rad;
    const std::vector<double> before(setpoint_rad, setpoint_rad + kAllJoints);
    run_.step();
    ASSERT_FALSE(run_.result.has_fault) << "code " << run_.result.fault.code << " at " << plan_time_s();
    for (int j = 0; j < kAllJoints; ++j) ASSERT_LT(std::abs(setpoint_rad[j] - before[j]), 1.0 * 0.002) << "joint " << j;
    for (int l = 0; l < kLimbs; ++l) {
      if (run_.result.reference[l].load > 0.0) {
        ASSERT_GT(run_.plant.input().finger_force_n[l], 0.0) << "limb " << l;
      }
    }
  }

  Climber run_{sample_plan()};
};

TEST_F(Operator, HalfTheSpeedIsTheSamePathAtHalfTheVelocity) {
  Climber full(sample_plan());
  ASSERT_TRUE(full.until(SupervisorState::kReady, 20));
  full.steps(1001);
  full.step(command_t::START);
  ASSERT_EQ(order(command_t::SPEED, 0.5), CommandVerdict::kAccepted);
  EXPECT_EQ(run_.result.state.speed_scale, 0.5);
  run_.step(command_t::START);
  for (const double at_s : {2.9, 8.2, 9.3}) {  // the body moves; LF lifts; LF swings
    for (int i = 0; i < kLong && full.result.state.plan_time_s < at_s; ++i) full.step();
    for (int i = 0; i < 2 * kLong && plan_time_s() < at_s; ++i) watched_step();
    ASSERT_NEAR(plan_time_s(), full.result.state.plan_time_s, 0.0021);
    double fastest_rad_s = 0.0;
    for (int j = 0; j < kAllJoints; ++j) {
      const double velocity_rad_s = full.result.output.joint_velocity_rad_s[j];
      fastest_rad_s = std::max(fastest_rad_s, std::abs(velocity_rad_s));
      EXPECT_NEAR(run_.result.output.joint_position_rad[j], full.result.output.joint_position_rad[j], 4e-3) << j;
      EXPECT_NEAR(run_.result.output.joint_velocity_rad_s[j], 0.5 * velocity_rad_s, 6e-3) << "joint " << j;
    }
    EXPECT_GT(fastest_rad_s, 0.03) << "nothing moves at " << at_s << " s";
  }
}

TEST_F(Operator, AtSpeedZeroTheClockStandsAndTheClimbGoesOnWithoutAFault) {
  run_.step(command_t::START);
  run_.steps(2000);
  ASSERT_EQ(order(command_t::SPEED, 0.0), CommandVerdict::kAccepted);
  const double stood_s = plan_time_s();
  for (int i = 0; i < kLong; ++i) watched_step();
  EXPECT_EQ(plan_time_s(), stood_s);
  EXPECT_EQ(run_.core.state(), SupervisorState::kClimbing);
  order(command_t::SPEED, 1.0);
  until_holding();
  EXPECT_EQ(run_.result.state.plan_complete, 1);
}

TEST_F(Operator, ASpeedOutsideItsRangeIsRefusedWithTheNumber) {
  EXPECT_EQ(order(command_t::SPEED, 1.2), CommandVerdict::kRefused);
  EXPECT_NE(in_words(run_.result.command_refusal).find("1.2"), std::string::npos);
  EXPECT_EQ(run_.result.state.speed_scale, 1.0);
}

TEST_F(Operator, EveryStepEndsHoldingOnAStanceThatBears) {
  std::vector<double> stops_s;
  for (int i = 0; i < 20 && run_.result.state.plan_complete == 0; ++i) {
    ASSERT_EQ(order(command_t::STEP), CommandVerdict::kAccepted);
    EXPECT_EQ(run_.result.state.motion, robot_state_t::STEP);
    until_holding();
    expect_all_bear();
    stops_s.push_back(plan_time_s());
    run_.steps(500);
    EXPECT_EQ(plan_time_s(), stops_s.back());
  }
  ASSERT_EQ(stops_s.size(), 5U);
  EXPECT_NEAR(stops_s[2], 12.84, 1e-9);
  EXPECT_NEAR(lf_x_m(), kNewHold_m, 2e-3);
  EXPECT_EQ(order(command_t::STEP), CommandVerdict::kRefused);
}

TEST_F(Operator, FromMidSwingALimbGoesBackToItsHoldAndGripsThere) {
  run_.step(command_t::START);
  climb_to(kMidSwing_s);
  ASSERT_EQ(order(command_t::REVERSE), CommandVerdict::kAccepted);
  EXPECT_EQ(run_.result.state.motion, robot_state_t::REVERSE);
  until_holding();
  EXPECT_NEAR(plan_time_s(), 4.0, 1e-9);
  EXPECT_NEAR(run_.result.state.verified_time_s, 4.0, 1e-9);
  EXPECT_NEAR(lf_x_m(), kOldHold_m, 2e-3);
  expect_all_bear();
  ASSERT_EQ(order(command_t::RESUME), CommandVerdict::kAccepted);
  until_holding();
  EXPECT_EQ(run_.result.state.plan_complete, 1);
  EXPECT_NEAR(lf_x_m(), kNewHold_m, 2e-3);
}

TEST_F(Operator, ALimbLeavesItsNewHoldAgainAndTheClimbEndsWhereItBegan) {
  const Vector3 start_m(run_.result.state.body_position_w_m);
  run_.step(command_t::START);
  climb_to(kOnNewHold_s);
  for (const double stop_s : {12.84, 4.0, 2.0, 0.0}) {
    ASSERT_EQ(order(command_t::REVERSE), CommandVerdict::kAccepted);
    until_holding();
    EXPECT_NEAR(plan_time_s(), stop_s, 1e-9);
    expect_all_bear();
  }
  EXPECT_LT((Vector3(run_.result.state.body_position_w_m) - start_m).norm(), 1e-3);
  EXPECT_NEAR(lf_x_m(), kOldHold_m, 2e-3);
  EXPECT_EQ(order(command_t::REVERSE), CommandVerdict::kRefused);
}

TEST_F(Operator, ALimbGoesBackToWhereItGrippedNotToWhereThePlanThoughtItWould) {
  Climber run(sample_plan());
  run.plant.input().joint_position_rad[0] += 0.04;  // LF stands some 5 mm beside its place
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(1000);
  // Seen from the other grippers, which stay: the robot's map of the wall may move.
  const auto away_m = [](const auto& limbs) {
    const auto place_m = [&limbs](int l) { return Vector3(limbs[l].gripper_position_w_m); };
    return Vector3((place_m(0) - place_m(1)).norm(), (place_m(0) - place_m(2)).norm(),
                   (place_m(0) - place_m(3)).norm());
  };
  Vector3 gripped_m = away_m(run.result.telemetry);
  ASSERT_GT((gripped_m - away_m(sample_plan().knots[0].limbs)).norm(), 0.003);
  run.step(command_t::START);
  for (const double turn_s : {kMidSwing_s, kOnNewHold_s}) {
    for (int i = 0; i < kLong && run.result.state.plan_time_s < turn_s; ++i) run.step();
    do {
      run.step(command_t::HOLD);
      ASSERT_EQ(run.step(command_t::REVERSE).command_verdict, CommandVerdict::kAccepted);
      ASSERT_TRUE(run.until(SupervisorState::kHolding, kLong));
    } while (run.result.state.plan_time_s > 4.001);
    EXPECT_LT((away_m(run.result.telemetry) - gripped_m).norm(), 1e-3) << "from " << turn_s << " s";
    gripped_m = away_m(run.result.telemetry);
    run.step(command_t::RESUME);
  }
  EXPECT_TRUE(run.until(SupervisorState::kHolding, kLong));
  EXPECT_EQ(run.result.state.plan_complete, 1);
}

TEST_F(Operator, HoldStopsTheWayBackAndResumeClimbsForwardFromThere) {
  run_.step(command_t::START);
  climb_to(kOnNewHold_s);
  order(command_t::REVERSE);
  until_holding();
  order(command_t::REVERSE);
  for (int i = 0; i < kLong && plan_time_s() > kMidSwing_s; ++i) watched_step();
  ASSERT_EQ(order(command_t::HOLD), CommandVerdict::kAccepted);
  const double held_s = plan_time_s();
  run_.steps(500);
  EXPECT_EQ(plan_time_s(), held_s);
  ASSERT_EQ(order(command_t::RESUME), CommandVerdict::kAccepted);
  until_holding();
  EXPECT_EQ(run_.result.state.plan_complete, 1);
  EXPECT_NEAR(lf_x_m(), kNewHold_m, 2e-3);
}

TEST_F(Operator, AnOldHoldThatIsGoneStopsTheWayBackWithTheLimbNamed) {
  run_.step(command_t::START);
  climb_to(kMidSwing_s);
  order(command_t::REVERSE);
  for (int i = 0; i < 2 * kLong && !run_.result.has_fault; ++i) {
    // Its fingers go where they are told and find nothing.
    run_.plant.input().finger_opening_m[0] = run_.result.output.finger_opening_m[0];
    run_.plant.input().finger_force_n[0] = 0.0;
    run_.step();
  }
  ASSERT_TRUE(run_.result.has_fault);
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kHoldMissing));
  EXPECT_EQ(run_.result.fault.limb, 0);
  EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
  EXPECT_NEAR(plan_time_s(), 6.0, 1e-9) << "no load was put on it";
}

TEST_F(Operator, TheUseOfTheLimitSurfaceIsThatOfTheSqueezeThatTheLoadNeeds) {
  // The runtime presses as the plan does, and at least 1.25 times what friction needs: so less than 1/1.25 is used.
  run_.step(command_t::START);
  run_.steps(1500);
  for (const crux_msgs::limb_telemetry_t& limb : run_.result.telemetry) {
    EXPECT_GT(limb.utilisation, 0.01);
    EXPECT_LT(limb.utilisation, 1.0 / robot().control.grasp_force_factor);
  }
  climb_to(kMidSwing_s);
  EXPECT_EQ(run_.result.telemetry[0].utilisation, 0.0) << "in the air";
}

TEST(LimitSurface, UtilisationIsOneWhereTheSqueezeIsJustEnough) {
  ControlParameters control = robot().control;
  control.grasp_force_factor = 1.0;
  control.grasp_force_reserve_N = control.min_grasp_force_N = 0.0;
  Random random;
  for (int i = 0; i < 200; ++i) {
    const Contact contact = {random.uniform(0.3, 2.5), 0.0133, 1e6, random.uniform(0.01, 0.05)};
    const Vector3 axis = random.rotation(3.0).col(0);
    const Wrench wrench = random.wrench(40.0, 1.0);
    const double squeeze_N = required_grasp_force_N(wrench, axis, contact, control);
    EXPECT_NEAR(limit_surface_utilisation(wrench, axis, contact, squeeze_N), 1.0, 1e-9);
    EXPECT_LT(limit_surface_utilisation(wrench, axis, contact, 2.0 * squeeze_N), 1.0);
  }
  EXPECT_EQ(limit_surface_utilisation({{0, 0, 5}, {0, 0, 0}}, {1, 0, 0}, {1.0, 0.0133, 60.0, 0.03}, 0.0), 10.0);
}

}  // namespace
}  // namespace crux_test
