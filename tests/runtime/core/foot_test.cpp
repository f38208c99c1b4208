// Feet on footholds among grips: what they bear, how their plans are read, and what makes the runtime refuse one.
#include <Eigen/Geometry>
#include <functional>

#include "core/loads/wrench_distribution.hpp"
#include "core/plan/plan_clock.hpp"
#include "core/plan/plan_join.hpp"
#include "core/plan/plan_preparation.hpp"
#include "core/plan/plan_validation.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::hold_t;
using crux_msgs::limb_knot_t;
using crux_msgs::plan_t;

constexpr double kTwistLength_m = 0.03;
constexpr double kFriction = 0.6, kMost_N = 40.0;
constexpr int kRR = 3;
const Vector3 kWeight_N(-66.6, 0.0, -66.6);
const Vector3 kCom_m(0.0, 0.0, 0.18);

/// Two grips, and two feet on a surface that is turned a little out of the plane.
PerLimb<Bearer> two_and_two(Random& random) {
  PerLimb<Bearer> limbs;
  for (int l = 0; l < kLimbs; ++l) {
    limbs[l].position_W_m = Vector3(l < 2 ? 0.14 : -0.14, l % 2 == 0 ? 0.36 : -0.36, l < 2 ? 0.035 : 0.0);
    limbs[l].load = random.uniform(0.3, 1.0);
    limbs[l].planned_W = {random.vector(40.0), l < 2 ? random.vector(0.3) : Vector3(Vector3::Zero())};
    limbs[l].finger_axis_W = l < 2 ? Vector3::UnitX() : Vector3(Vector3::Zero());
    if (l >= 2) {
      limbs[l].foot = {.stands = true,
                       .normal_W = Vector3(0.1 * (l - 2), 0.05, 1.0).normalized(),
                       .friction = kFriction,
                       .max_normal_N = kMost_N};
    }
  }
  return limbs;
}

void expect_in_cone(const FootCone& cone, const Vector3& force_N) {
  const double normal_N = cone.normal_W.dot(force_N);
  EXPECT_GE(normal_N, -1e-9);
  EXPECT_LE(normal_N, cone.max_normal_N + 1e-9);
  EXPECT_LE((force_N - normal_N * cone.normal_W).norm(), cone.friction * normal_N + 1e-6);
}

TEST(FootCone, TheNearestForceIsInItAndNoOtherInItIsNearer) {
  Random random(3);
  const FootCone cone = two_and_two(random)[kRR].foot;
  for (int i = 0; i < 300; ++i) {
    const Vector3 force_N = random.vector(80.0), nearest_N = cone.nearest_W_N(force_N);
    expect_in_cone(cone, nearest_N);
    EXPECT_LT((cone.nearest_W_N(nearest_N) - nearest_N).norm(), 1e-9);
    if (cone.normal_W.dot(nearest_N) > kMost_N - 1e-6) continue;  // the most is kept, whatever is nearer
    const Vector3 other_N = cone.nearest_W_N(nearest_N + random.vector(5.0));
    EXPECT_LE((force_N - nearest_N).norm(), (force_N - other_N).norm() + 1e-6);
  }
}

TEST(FootCone, TellsWhatAForceUsesOfFriction) {
  const FootCone cone{.stands = true, .friction = 0.5, .max_normal_N = kMost_N};
  EXPECT_NEAR(cone.utilisation({3.0, 4.0, 20.0}), 0.5, 1e-12);
  EXPECT_EQ(cone.utilisation({1.0, 0.0, -5.0}), 10.0);
}

TEST(FootShares, WhatFeetCannotBearGoesToTheGrips) {
  Random random(5);
  int beyond = 0;
  for (int i = 0; i < 100; ++i) {
    const PerLimb<Bearer> limbs = two_and_two(random);
    const PerLimb<Wrench> wrenches = balanced_wrenches(limbs, kCom_m, kWeight_N, kTwistLength_m);
    const PerLimb<Wrench> within = within_cones(wrenches, limbs, kCom_m, kWeight_N, kTwistLength_m);
    Vector3 force_N = kWeight_N, moment_Nm = Vector3::Zero();
    double moved_N = 0.0;
    for (int l = 0; l < kLimbs; ++l) {
      if (limbs[l].foot.stands) {
        expect_in_cone(limbs[l].foot, within[l].force_N);
        EXPECT_TRUE(within[l].moment_Nm.isZero(0.0));
      }
      force_N += within[l].force_N;
      moment_Nm += within[l].moment_Nm + (limbs[l].position_W_m - kCom_m).cross(within[l].force_N);
      moved_N = std::max(moved_N, (within[l].force_N - wrenches[l].force_N).norm());
    }
    beyond += moved_N > 1.0 ? 1 : 0;
    // Two grips alone turn the body about no line through both: the feet do that, as far as they come in a few rounds.
    EXPECT_LT(force_N.norm(), 0.1);
    EXPECT_LT(moment_Nm.norm(), 0.5);
  }
  EXPECT_GT(beyond, 50);
}

TEST(FootShares, FeetWithinTheirConesAreLeftAlone) {
  Random random(7);
  PerLimb<Bearer> limbs = two_and_two(random);
  PerLimb<Wrench> wrenches;
  for (int l = 0; l < kLimbs; ++l) wrenches[l].force_N = Vector3(3.0, 1.0, l < 2 ? -20.0 : 20.0);
  const PerLimb<Wrench> within = within_cones(wrenches, limbs, kCom_m, kWeight_N, kTwistLength_m);
  for (int l = 0; l < kLimbs; ++l) EXPECT_EQ(within[l].force_N, wrenches[l].force_N);
}

/// The sample plan with RR on a foothold under its gripper.
class OnAFoothold : public testing::Test {
 protected:
  void SetUp() override {
    plan_.format = plan_t::FORMAT_FEET;
    hold_t& foothold = plan_.holds[kRR];
    foothold.graspable = hold_t::FOOTHOLD;
    foothold.size_m[0] = foothold.size_m[1] = 2.0 * robot().gripper.pad_radius_m;
    const limb_knot_t stood = plan_.knots[0].limbs[kRR];
    std::copy_n(stood.gripper_position_w_m, 2, foothold.position_w_m);
    for (crux_msgs::plan_knot_t& knot : plan_.knots) {
      limb_knot_t& foot = knot.limbs[kRR];
      foot.finger1_face = limb_knot_t::FACE_WALL;
      foot.gripper_position_w_m[2] = 0.0;
      press(foot, {6.0, 0.0, 20.0});
    }
    sign(plan_);
  }
  static void press(limb_knot_t& foot, const Vector3& force_N) {
    for (int i = 0; i < 6; ++i) foot.finger_force_w_n[i] = 0.5 * force_N[i % 3];
  }
  void expect_refused(const std::function<void(plan_t&)>& change, const std::string& says) const {
    plan_t plan = plan_;
    change(plan);
    sign(plan);
    EXPECT_NE(plan_message_defect(robot(), plan).find(says), std::string::npos) << plan_message_defect(robot(), plan);
  }

  plan_t plan_ = sample_plan();
};

TEST_F(OnAFoothold, IsAcceptedAndStandsAPadsRadiusAboveItsPlace) {
  EXPECT_EQ(plan_message_defect(robot(), plan_), "");
  const auto prepared = prepare_plan(robot(), plan_, nullptr);
  ASSERT_TRUE(prepared) << prepared.reason();
  EXPECT_TRUE(prepared.value()->footholds);
  EXPECT_FALSE(prepared.value()->point_feet);
  const LimbReference foot = play(*prepared.value(), {0, 0.5}).limbs[kRR];
  EXPECT_TRUE(foot.on_foothold);
  EXPECT_NEAR(foot.gripper_position_W_m.z(), robot().gripper.pad_radius_m, 1e-12);
  EXPECT_NEAR((foot.gripper_position_W_m + foot.to_foot_W_m()).z(), 0.0, 1e-12);
  EXPECT_FALSE(play(*prepared.value(), {0, 0.5}).limbs[0].on_foothold);
}

TEST_F(OnAFoothold, RefusesWhatNoFootCanDo) {
  const auto foot = [](plan_t& plan) -> limb_knot_t& { return plan.knots[1].limbs[kRR]; };
  expect_refused([&](plan_t& plan) { press(foot(plan), {0.0, 0.0, -2.0}); }, "the foot presses with -2 N");
  expect_refused([&](plan_t& plan) { press(foot(plan), {0.0, 0.0, 61.0}); }, "the foot presses with 61 N");
  expect_refused([&](plan_t& plan) { press(foot(plan), {60.0, 0.0, 20.0}); }, "the foot bears 60 N along its surface");
  expect_refused([&](plan_t& plan) { foot(plan).finger_force_w_n[0] += 1.0; }, "half of its force each");
  expect_refused([&](plan_t& plan) { foot(plan).finger_moment_w_nm[4] = 0.01; }, "bears a moment of 0.01 Nm");
  expect_refused([&](plan_t& plan) { foot(plan).gripper_position_w_m[0] += 0.001; }, "m from its foothold");
  expect_refused([&](plan_t& plan) { foot(plan).gripper_tilt_w_rad[0] = 0.1; }, "off its surface's normal");
  expect_refused([&](plan_t& plan) { foot(plan).finger_separation_m += 0.001; }, "the gripper moves in stance");
}

TEST_F(OnAFoothold, RefusesFeetOnHoldsAndGripsOnFootholds) {
  const auto foot = [](plan_t& plan) -> limb_knot_t& { return plan.knots[1].limbs[kRR]; };
  expect_refused([&](plan_t& plan) { foot(plan).hold = 0; }, "which is no foothold");
  expect_refused([&](plan_t& plan) { foot(plan).hold = 99; }, "which is no foothold");
  expect_refused([&](plan_t& plan) { foot(plan).finger1_face = limb_knot_t::FACE_PLUS_X; }, "finger1_face is 0");
  expect_refused([&](plan_t& plan) { plan.knots[0].limbs[1].hold = kRR; }, "finger1_face is 0 on hold 3");
  expect_refused([](plan_t& plan) { plan.format = plan_t::FORMAT_OWN_TIMES; }, "finger1_face is 4");
}

TEST_F(OnAFoothold, HasNoPartsAndIsNotPlayedBackward) {
  EXPECT_EQ(join_defect(plan_, plan_), "a plan with footholds has no parts");
  const std::unique_ptr<PreparedPlan> tables = tabulate(plan_);
  EXPECT_EQ(shared_intervals(*tables, *tables), 0);
}

/// As if it had stepped: RR in the air at knots 4 and 5.
TEST_F(OnAFoothold, StaysAFootUntilItLiftsAndComesDownAsOne) {
  for (const int k : {4, 5}) {
    limb_knot_t& foot = plan_.knots[k].limbs[kRR];
    foot.phase = limb_knot_t::AIR;
    foot.gripper_position_w_m[2] = robot().gripper.pad_radius_m + (k == 5 ? 0.04 : 0.0);
    press(foot, Vector3::Zero());
  }
  const std::unique_ptr<PreparedPlan> plan = tabulate(plan_);
  const auto at = [&](int k, double share) { return play(*plan, {k, share * plan->step_s[k]}).limbs[kRR]; };
  EXPECT_EQ(at(4, 0.4).phase, LimbPhase::kOpen);
  EXPECT_TRUE(at(4, 0.4).on_foothold);
  EXPECT_EQ(at(4, 0.6).phase, LimbPhase::kLift);
  EXPECT_FALSE(at(4, 0.6).on_foothold);
  EXPECT_EQ(at(4, 0.6).opens_m, 0.0);
  EXPECT_EQ(at(5, 0.3).phase, LimbPhase::kDescend);
  EXPECT_TRUE(at(5, 0.3).on_foothold);
  EXPECT_TRUE(at(5, 0.9).closing());
  EXPECT_NEAR(at(5, 0.9).gripper_position_W_m.z(), robot().gripper.pad_radius_m, 1e-12);
}

TEST_F(OnAFoothold, FingersOfAFootStayAsTheyAreAndThoseOfGripsPress) {
  Climber run(plan_);
  ASSERT_TRUE(run.until(SupervisorState::kReady, 2000));
  run.steps(200);
  const auto opening_m = [&](int limb) { return run.result.output.finger_opening_m[limb]; };
  EXPECT_NEAR(opening_m(kRR), 0.5 * plan_.knots[0].limbs[kRR].finger_separation_m, 1e-6);
  EXPECT_LT(opening_m(0), 0.5 * plan_.knots[0].limbs[0].finger_separation_m - 1e-5);
  EXPECT_EQ(run.result.telemetry[kRR].grasp_force_reference_n, 0.0);
}

TEST_F(OnAFoothold, AFootThatBearsNothingIsLostAndTheRobotHoldsWithItsHandsShut) {
  Climber run(plan_);
  ASSERT_TRUE(run.until(SupervisorState::kReady, 2000));
  run.steps(1000);
  run.step(crux_msgs::command_t::START);
  run.steps(150);
  ASSERT_GT(run.result.state.plan_time_s, 0.1);
  FaultCode told = FaultCode::kNone;
  double widest_m = 0.0, later_N = 0.0;
  for (int i = 0; i < 200; ++i) {
    run.plant.press(kRR, run.result, Vector3::Zero(), -Vector3(run.result.telemetry[kRR].force_reference_w_n));
    run.step();
    if (run.result.has_fault && told == FaultCode::kNone) told = static_cast<FaultCode>(run.result.fault.code);
    widest_m = std::max(widest_m, run.result.output.finger_opening_m[0]);
    later_N = Vector3(run.result.telemetry[kRR].force_reference_w_n).norm();
  }
  EXPECT_EQ(told, FaultCode::kFootLost);
  EXPECT_EQ(run.core.state(), SupervisorState::kHolding);
  EXPECT_EQ(later_N, 0.0);  // the others bear all
  EXPECT_LT(widest_m, 0.5 * plan_.knots[0].limbs[0].finger_separation_m);
}

TEST_F(OnAFoothold, AFootThatSlidesIsAskedForLessOfItsFriction) {
  for (crux_msgs::plan_knot_t& knot : plan_.knots) knot.limbs[kRR].friction = 0.5;
  sign(plan_);
  Climber run(plan_);
  ASSERT_TRUE(run.until(SupervisorState::kReady, 2000));
  run.steps(1000);
  run.step(crux_msgs::command_t::START);
  run.steps(150);
  ASSERT_GT(run.result.state.plan_time_s, 0.1);
  const auto used = [&] {
    const Vector3 force_N(run.result.telemetry[kRR].force_reference_w_n);
    return force_N.head<2>().norm() / force_N.z();
  };
  const double before = used();
  double& yaw_rad = run.plant.input().joint_position_rad[kRR * kJoints];
  const double stood_rad = yaw_rad;
  for (int i = 1; i <= 60; ++i) {
    yaw_rad = stood_rad + 0.0005 * i;
    run.step();
  }
  EXPECT_GT(before, 0.25);
  EXPECT_LT(used(), 0.8 * before);
}

TEST_F(OnAFoothold, ThePlanIsRefusedBackwardAndInPlaceOfAnother) {
  Climber run(plan_);
  ASSERT_TRUE(run.until(SupervisorState::kReady, 2000));
  run.step(crux_msgs::command_t::REVERSE);
  EXPECT_EQ(run.result.command_verdict, CommandVerdict::kRefused);
  EXPECT_NE(in_words(run.result.command_refusal).find("footholds"), std::string::npos);
  EXPECT_NE(run.core.load_plan(sample_plan()).find("footholds"), std::string::npos);
}

}  // namespace
}  // namespace crux_test
