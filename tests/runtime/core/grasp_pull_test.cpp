// The pull on a new grasp: what it asks of the limb, when it passes, and that the plan waits for it.
#include "core/grips/grasp_pull.hpp"

#include <algorithm>
#include <limits>

#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr double kDt_s = 0.002;
constexpr GraspTestParameters kTest;  // the defaults of robot_keys.yaml
const Wrench kLoad{{15.0, 0.0, 20.0}, {0.1, 0.0, 0.2}};

constexpr PerLimb<double> kBearable_N = {60.0, 60.0, 60.0, 60.0};

/// Runs a test on limb 2 to its end; `way_m(pull share)` is where the gripper goes along x, `slid_share` of it on its
/// hold; limb 1 needs `need_N` of grasp force for the whole pull.
template <class Way>
GraspPull pulled(Way way_m, double slid_share = 0.0, double need_N = 0.0) {
  GraspPull test;
  test.begin(2, kLoad, kBearable_N);
  double last = 0.0, quickest_off = 0.0;
  for (int i = 0; i < 5000 && test.limb() == 2; ++i) {
    const double share = test.pull_W().force_N.norm() / kLoad.force_N.norm();
    EXPECT_LE(share - last, 0.01) << "no jump of the pull, at cycle " << i;
    quickest_off = std::max(quickest_off, last - share);
    last = share;
    const double way = way_m(share);
    test.advance({{way, 0.0, 0.0}, slid_share * way, 1.0, {0.0, share * need_N, 99.0, 0.0}, kBearable_N}, kTest, kDt_s);
  }
  EXPECT_EQ(test.pull_W().force_N.norm(), 0.0);
  // What has failed is let off quicker, and without a jump either.
  EXPECT_LE(quickest_off, test.result(2) == GraspPull::Result::kPassed ? 0.01 : 0.04);
  return test;
}

TEST(GraspPull, AGraspThatStandsPassesWithPlayOfItsJoints) {
  double most = 0.0;
  const GraspPull test = pulled([&](double share) {
    most = std::max(most, share);
    return share > 0.3 ? 0.011 : 0.0;
  });
  EXPECT_EQ(test.result(2), GraspPull::Result::kPassed);
  EXPECT_EQ(test.result(1), GraspPull::Result::kNone);
  EXPECT_NEAR(most, 1.0, 1e-6);
}

TEST(GraspPull, AGraspThatCreepsUnderItsLoadFails) {
  double creep_m = 0.0;
  const GraspPull test = pulled([&](double share) { return creep_m += share > 0.999 ? 20e-6 : 0.0; }, 1.0);
  EXPECT_EQ(test.result(2), GraspPull::Result::kFailed);
  EXPECT_GT(test.gave_way_m(), GraspPull::kMaxCreep_m);
  EXPECT_LT(test.gave_way_m(), 1.1 * GraspPull::kMaxCreep_m);
}

TEST(GraspPull, AGraspThatStandsPassesWhileOtherLimbsGoThroughTheirPlay) {
  double seems_m = 0.0;
  const GraspPull test = pulled([&](double share) { return seems_m += share > 0.999 ? 40e-6 : 0.0; });
  EXPECT_GT(seems_m, 2.0 * GraspPull::kMaxCreep_m);
  EXPECT_EQ(test.result(2), GraspPull::Result::kPassed);
}

TEST(GraspPull, AGraspThatSlidesAsItIsLoadedFailsThoughItStandsAgain) {
  const GraspPull test = pulled([](double share) { return share > 0.3 ? 1.1 * GraspPull::kMaxSlide_m : 0.0; }, 1.0);
  EXPECT_EQ(test.result(2), GraspPull::Result::kFailed);
  EXPECT_EQ(test.gave_way_m(), 1.1 * GraspPull::kMaxSlide_m);
  EXPECT_EQ(test.limit_m(), GraspPull::kMaxSlide_m);
}

TEST(GraspPull, IsNotPulledHarderThanTheOtherLimbsBear) {
  double most = 0.0;
  const auto stands = [&](double share) {
    most = std::max(most, share);
    return 0.0;
  };
  EXPECT_EQ(pulled(stands, 0.0, 100.0).result(2), GraspPull::Result::kPassed);
  EXPECT_NEAR(most, kBearable_N[1] / 100.0, 0.02);
}

TEST(GraspPull, IsPulledNoHarderThanItsOwnJointsGive) {
  double most = 0.0;
  GraspPull test;
  test.begin(2, kLoad, kBearable_N);
  for (int i = 0; i < 5000 && test.limb() == 2; ++i) {
    const double share = test.pull_W().force_N.norm() / kLoad.force_N.norm();
    most = std::max(most, share);
    const double need_N = share > 0.5 ? std::numeric_limits<double>::infinity() : 99.0;
    test.advance({Vector3::Zero(), 0.0, 1.0, {0.0, 0.0, need_N, 0.0}, kBearable_N}, kTest, kDt_s);
  }
  EXPECT_EQ(test.result(2), GraspPull::Result::kPassed);
  EXPECT_NEAR(most, 0.5, 0.02);
}

TEST(GraspPull, AGraspThatComesOffIsNotPulledToTheEnd) {
  double most = 0.0;
  const GraspPull test = pulled([&](double share) {
    most = std::max(most, share);
    return share > 0.2 ? 0.030 : 0.0;
  });
  EXPECT_EQ(test.result(2), GraspPull::Result::kFailed);
  EXPECT_LT(most, 0.3);
}

/// How long a pull takes until it has passed, and until it is gone.
struct Took {
  double passed_s = 0.0, gone_s = 0.0;
};

Took took(const GraspTestParameters& parameters, double borne_N = 10.0, double pressed = 1.0) {
  GraspPull test;
  test.begin(2, kLoad, kBearable_N);
  int cycles = 0, until_passed = 0;
  for (; test.limb() == 2; ++cycles) {
    const double share = test.pull_W().force_N.norm() / kLoad.force_N.norm();
    if (test.result(2) == GraspPull::Result::kNone) until_passed = cycles + 1;
    test.advance({Vector3::Zero(), 0.0, pressed, {0.0, 10.0 * share, 99.0, 0.0}, {0.0, borne_N, 0.0, 0.0}}, parameters,
                 kDt_s);
  }
  EXPECT_EQ(test.result(2), GraspPull::Result::kPassed);
  return {until_passed * kDt_s, cycles * kDt_s};
}

TEST(GraspPull, TakesAsLongAsTheRobotsDescriptionSays) {
  // Pulled up and held, and let off meanwhile the plan goes on: 25 N, which no ramp of 0.2 s needs at 100 N/s.
  const Took slow = took({.load_factor = 1.2, .press_s = 0.3, .rate_N_s = 30.0, .min_ramp_s = 0.2, .stand_s = 0.3});
  EXPECT_NEAR(slow.passed_s, 25.0 / 30.0 + 0.3, 0.01);
  EXPECT_NEAR(slow.gone_s, 2 * 25.0 / 30.0 + 0.3, 0.01);
  const Took quick = took({.load_factor = 1.2, .press_s = 0.1, .rate_N_s = 400.0, .min_ramp_s = 0.2, .stand_s = 0.05});
  EXPECT_NEAR(quick.gone_s, 2 * 0.2 + 0.05, 0.01);
  // Slowly where limb 1 has not borne as much: from the half on, where smoothstep is a half.
  const GraspTestParameters slower{
      .load_factor = 1.2, .press_s = 0.1, .rate_N_s = 100.0, .new_rate_N_s = 25.0, .min_ramp_s = 0.1, .stand_s = 0.05};
  EXPECT_NEAR(took(slower, 5.0).gone_s, 2 * (12.5 / 100.0 + 12.5 / 25.0) + 0.05, 0.02);
  EXPECT_NEAR(took(slower, 0.0).gone_s, 2 * 25.0 / 25.0 + 0.05, 0.02);
}

TEST(GraspPull, GrowsAsFarAsTheFingersPressAndWaitsForThemNoLongerThanTheDescriptionSays) {
  const GraspTestParameters quick{.press_s = 0.5, .rate_N_s = 100.0, .new_rate_N_s = 100.0, .stand_s = 1.0};
  GraspPull test;
  test.begin(2, kLoad, kBearable_N);
  const auto share_after = [&](double seconds, double pressed) {
    for (double s = 0.0; s < seconds; s += kDt_s)
      test.advance({Vector3::Zero(), 0.0, pressed, {0.0, 0.0, 99.0, 0.0}, kBearable_N}, quick, kDt_s);
    return test.pull_W().force_N.norm() / kLoad.force_N.norm();
  };
  EXPECT_EQ(share_after(0.1, 0.0), 0.0);
  EXPECT_NEAR(share_after(0.38, 0.4), 0.39, 0.01);
  EXPECT_NEAR(share_after(0.25, 0.4), 1.0, 1e-6);
  EXPECT_EQ(test.result(2), GraspPull::Result::kNone);
}

TEST(GraspPull, ALimbThatGripsAnewIsTestedAnew) {
  GraspPull test = pulled([](double) { return 0.0; });
  test.forget(2);
  EXPECT_EQ(test.result(2), GraspPull::Result::kNone);
}

class PulledGrasp : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
    run_.step(command_t::START);
  }
  double force_N() const { return Vector3(run_.result.telemetry[0].force_reference_w_n).norm(); }
  int phase() const { return run_.result.reference[0].phase; }
  /// Most that LF is asked to bear while it closes; ends where it begins to bear for good, or at a fault.
  double pull_N() {
    double most_N = 0.0;
    for (int i = 0; i < 12000 && phase() != static_cast<int>(LimbPhase::kLoad) && !run_.result.has_fault; ++i) {
      run_.step();
      if (phase() == static_cast<int>(LimbPhase::kClose)) most_N = std::max(most_N, force_N());
    }
    return most_N;
  }

  /// Climbs until LF bears on its new hold or a fault is told; the first `n` of its grasps creep when they are pulled.
  void climb_with_creep(int n) {
    double creep_rad = 0.0, last_N = 0.0, jammed_m = 0.0;
    for (int i = 0; i < 30000 && phase() != static_cast<int>(LimbPhase::kLoad) && !run_.result.has_fault; ++i) {
      const bool closes = phase() == static_cast<int>(LimbPhase::kClose);
      if (closes && last_phase_ != phase()) ++grasps_;
      if (!closes) creep_rad = std::max(creep_rad - 4e-5, 0.0);
      last_phase_ = phase();
      const bool stands = force_N() > 1.0 && std::abs(force_N() - last_N) < 0.01;
      if (closes && stands && grasps_ <= n) creep_rad += 4e-5;
      last_N = force_N();
      crux_msgs::control_input_t& in = run_.plant.input();
      in.joint_position_rad[1] += creep_rad;
      if (jams_ && jammed_m == 0.0 && closes && stands) jammed_m = in.finger_opening_m[0];
      if (jammed_m > 0.0) in.finger_opening_m[0] = jammed_m;
      run_.step();
    }
  }

  Climber run_{sample_plan()};
  int grasps_ = 0, last_phase_ = 0;
  bool jams_ = false;  ///< LF's fingers, where they are as they are first pulled
};

TEST_F(PulledGrasp, ThatGivesWayIsOpenedAndMadeAnewBesideIt) {
  climb_with_creep(1);
  EXPECT_FALSE(run_.result.has_fault);
  EXPECT_EQ(grasps_, 2);
  ASSERT_EQ(phase(), static_cast<int>(LimbPhase::kLoad));
  const crux_msgs::limb_reference_t& reference = run_.result.reference[0];
  const Vector3 beside_m =
      Vector3(run_.result.telemetry[0].gripper_position_w_m) - Vector3(reference.gripper_position_w_m);
  const Vector3 along = rotation_z(reference.gripper_yaw_w_rad).col(1);
  EXPECT_NEAR(beside_m.dot(along), GraspRetry::kShift_m, 2e-3);
}

TEST_F(PulledGrasp, IsLoadedWithMoreThanItIsToBearBeforeThePlanGoesOn) {
  const double pull_N = this->pull_N();
  ASSERT_EQ(phase(), static_cast<int>(LimbPhase::kLoad));
  double taking_up_N = 0.0, most_N = 0.0;
  for (int i = 0; i < 3000 && !run_.result.state.plan_complete; ++i) {
    run_.step();
    double& seen_N = phase() == static_cast<int>(LimbPhase::kLoad) ? taking_up_N : most_N;
    seen_N = std::max(seen_N, force_N());
  }
  EXPECT_TRUE(run_.result.state.plan_complete);
  EXPECT_GT(most_N, 5.0);
  EXPECT_GT(pull_N, 1.1 * most_N);
  EXPECT_LT(taking_up_N, 1.01 * pull_N);
}

TEST_F(PulledGrasp, IsPulledNoHarderThanTheJointsOfOtherLimbsBear) {
  double most_N = 0.0;
  for (int i = 0; i < 12000 && phase() != static_cast<int>(LimbPhase::kLoad) && !run_.result.has_fault; ++i) {
    const bool closes = phase() == static_cast<int>(LimbPhase::kClose);
    // Not long enough for a sensor to be doubted.
    if (closes && most_N < 5.0 && force_N() >= 5.0)
      run_.plant.input().joint_torque_nm[3 * kJoints + 1] = 0.97 * robot().limbs[3].joints[1].effort_Nm;
    if (closes) most_N = std::max(most_N, force_N());
    run_.step();
  }
  ASSERT_EQ(phase(), static_cast<int>(LimbPhase::kLoad));
  EXPECT_NEAR(most_N, 5.0, 1.0);
}

TEST_F(PulledGrasp, ThatGivesWayIsTriedToBothSidesThenToldAndThePlanStands) {
  climb_with_creep(GraspRetry::kTries + 1);
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kGraspFailed));
  EXPECT_EQ(run_.result.fault.limb, 0);
  EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
  EXPECT_EQ(phase(), static_cast<int>(LimbPhase::kClose));
}

TEST_F(PulledGrasp, OfFingersThatJammedAsTheyClosedIsNoGrasp) {
  jams_ = true;
  climb_with_creep(GraspRetry::kTries + 1);
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kEventTimeout));
  EXPECT_EQ(run_.result.fault.limb, 0);
  EXPECT_EQ(grasps_, 1);  // fingers that do not open again do not close again
}

TEST_F(PulledGrasp, TakesItsTimeWhereTheLoadIsHeavy) {
  // 1.2 s do for a contact event of this plant, and not for any pull.
  RobotDescription impatient = robot();
  impatient.supervisor.event_timeout_s = 1.2;
  Climber run(sample_plan(), impatient);
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(1000);
  run.step(command_t::START);
  for (int i = 0; i < 20000 && !run.result.state.plan_complete; ++i) run.step();
  EXPECT_FALSE(run.result.has_fault) << run.result.fault.code << " in phase "
                                     << static_cast<int>(run.result.reference[0].phase);
  EXPECT_TRUE(run.result.state.plan_complete);
}

double pressed_N(const crux_msgs::plan_t& plan, int limb) {
  Climber run(plan);
  EXPECT_TRUE(run.until(SupervisorState::kReady, 20));
  run.steps(3000);
  return run.result.telemetry[limb].grasp_force_n;
}

TEST(PlannedSqueeze, IsWhatTheFingersPressWithWhereItIsMore) {
  crux_msgs::plan_t plan = sample_plan();
  const double before_N = pressed_N(plan, 1);
  double planned_N = 0.0;
  for (crux_msgs::plan_knot_t& knot : plan.knots) {
    // 25 N more on both fingers of RF, along the axis through them: the gripper's wrench stays.
    crux_msgs::limb_knot_t& limb = knot.limbs[1];
    planned_N = 0.0;
    for (int i = 0; i < 2; ++i) {
      const double along = i == 0 ? std::cos(limb.gripper_yaw_w_rad) : std::sin(limb.gripper_yaw_w_rad);
      limb.finger_force_w_n[i] += 25.0 * along;
      limb.finger_force_w_n[3 + i] -= 25.0 * along;
      planned_N += 0.5 * along * (limb.finger_force_w_n[i] - limb.finger_force_w_n[3 + i]);
    }
  }
  sign(plan);
  const double after_N = pressed_N(plan, 1);
  EXPECT_GT(after_N, before_N + 1.0);
  EXPECT_NEAR(after_N, planned_N, 0.25);
}

}  // namespace
}  // namespace crux_test
