// Plans in parts: what goes on where another plan ends, and a climb that takes it without a stop.
#include "core/plan/plan_join.hpp"

#include <algorithm>
#include <string>

#include "core/plan/plan_preparation.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;
using crux_msgs::plan_knot_t;
using crux_msgs::plan_t;

constexpr double kBack_m = 0.01;                      // of the body, in the part that follows the sample
constexpr double kFound_m = 0.01, kFound_rad = 0.05;  // that grips were found elsewhere

/// The sample, its holds with names.
plan_t first_part() {
  plan_t plan = sample_plan();
  for (std::size_t i = 0; i < plan.holds.size(); ++i) plan.holds[i].name = "hold " + std::to_string(i);
  plan.n_holds = static_cast<int>(plan.holds.size());
  sign(plan);
  return plan;
}

/// From the stance in which the sample ends the body goes back a little; holds are numbered otherwise.
plan_t next_part() {
  plan_t part = first_part();
  const plan_knot_t end = part.knots.back();
  part.knots.assign(4, end);
  for (std::size_t k = 0; k < part.knots.size(); ++k) {
    part.knots[k].time_s = part.dt_s * static_cast<double>(k);
    part.knots[k].body_position_w_m[0] -= k >= 2 ? kBack_m : 0.0;
  }
  std::ranges::reverse(part.holds);
  for (plan_knot_t& knot : part.knots) {
    for (crux_msgs::limb_knot_t& limb : knot.limbs) limb.hold = part.n_holds - 1 - limb.hold;
  }
  sign(part);
  return part;
}

TEST(PlanJoin, APartFollowsWithItsOwnTimesAndTheHoldsOfBoth) {
  const plan_t before = first_part(), part = next_part();
  ASSERT_EQ(join_defect(before, part), "");
  plan_t whole = joined(before, part);
  const std::size_t n = before.knots.size();
  ASSERT_EQ(whole.knots.size(), n + part.knots.size() - 1);
  EXPECT_EQ(whole.n_knots, static_cast<int>(whole.knots.size()));
  EXPECT_DOUBLE_EQ(whole.knots.back().time_s, before.knots.back().time_s + part.knots.back().time_s);
  EXPECT_EQ(whole.holds.size(), before.holds.size());
  for (int l = 0; l < kLimbs; ++l) EXPECT_EQ(whole.knots[n].limbs[l].hold, before.knots[n - 1].limbs[l].hold);
  const std::string id = whole.plan_id;
  sign(whole);
  EXPECT_EQ(id, whole.plan_id);
  EXPECT_TRUE(prepare_plan(robot(), whole));
}

TEST(PlanJoin, WhatBeginsElsewhereDoesNotFollow) {
  const plan_t before = first_part();
  const auto defect = [&](const auto& change) {
    plan_t part = next_part();
    change(part);
    return join_defect(before, part);
  };
  EXPECT_NE(defect([](plan_t& part) { part.knots[0].body_position_w_m[1] += 1e-4; }), "");
  EXPECT_NE(defect([](plan_t& part) { part.knots[0].limbs[2].gripper_yaw_w_rad += 0.3; }), "");
  EXPECT_NE(defect([](plan_t& part) { part.knots[0].limbs[2].gripper_position_w_m[1] += 0.06; }), "");
  EXPECT_NE(defect([](plan_t& part) { part.knots[0].limbs[2].hold = part.knots[0].limbs[3].hold; }), "");
  EXPECT_NE(defect([](plan_t& part) { part.knots[0].limbs[1].phase = crux_msgs::limb_knot_t::AIR; }), "");
  EXPECT_NE(defect([](plan_t& part) { part.gravity_w_m_s2[0] += 1.0; }), "");
  EXPECT_NE(defect([](plan_t& part) { part.format = plan_t::FORMAT_OWN_TIMES; }), "");
  EXPECT_NE(defect([](plan_t& part) { part.knots.clear(); }), "");
}

TEST(PlanJoin, ALongerPlanBeginsWithAllOfTheShorterOne) {
  const plan_t before = first_part(), whole = joined(before, next_part());
  const auto shorter = tabulate(before), longer = tabulate(whole);
  EXPECT_EQ(shared_intervals(*longer, *shorter), shorter->intervals());
  for (const std::size_t k : {std::size_t{2}, before.knots.size() - 1}) {
    plan_t other = whole;
    other.knots[k].body_position_w_m[2] += 1e-3;
    EXPECT_EQ(shared_intervals(*tabulate(other), *shorter), static_cast<int>(k) - 1);
  }
}

/// From the stance before the last way of the sample's body: another way, with grips where they were found.
plan_t found_elsewhere(int& knot, double turned_rad = 0.0) {
  plan_t part = first_part();
  knot = part.n_knots - 2;
  part.knots.erase(part.knots.begin(), part.knots.begin() + knot);
  part.n_knots = static_cast<int>(part.knots.size());
  const double begin_s = part.knots.front().time_s;
  for (plan_knot_t& at : part.knots) {
    at.time_s -= begin_s;
    for (int l = 1; l < kLimbs; ++l) {  // LF is the one that goes to another hold before
      at.limbs[l].gripper_position_w_m[0] += kFound_m;
      at.limbs[l].gripper_yaw_w_rad += turned_rad;
    }
  }
  for (crux_msgs::hold_t& hold : part.holds) hold.position_w_m[0] += kFound_m;
  part.knots.back().body_position_w_m[0] += kFound_m;
  sign(part);
  return part;
}

TEST(PlanJoin, AGripThatWasFoundElsewhereIsThereFromItsBeginningAndWhatItBearsTurnsWithIt) {
  const plan_t before = first_part();
  int knot = 0;
  const plan_t part = found_elsewhere(knot, kFound_rad), whole = joined(before, part);
  for (int k = 0; k < knot; ++k) {
    for (int l = 1; l < kLimbs; ++l) {
      const auto &was = before.knots[k].limbs[l], &is = whole.knots[k].limbs[l];
      EXPECT_DOUBLE_EQ(is.gripper_position_w_m[0], was.gripper_position_w_m[0] + kFound_m);
      EXPECT_DOUBLE_EQ(is.gripper_yaw_w_rad, was.gripper_yaw_w_rad + kFound_rad);
      const Vector3 turned = rotation_z(kFound_rad) * Vector3(was.finger_force_w_n);
      EXPECT_LT((Vector3(is.finger_force_w_n) - turned).norm(), 1e-12);
    }
    EXPECT_EQ(whole.knots[k].limbs[0].gripper_position_w_m[0], before.knots[k].limbs[0].gripper_position_w_m[0]);
  }
  EXPECT_EQ(shared_intervals(*tabulate(whole), *tabulate(before)), knot);
  EXPECT_TRUE(prepare_plan(robot(), whole, tabulate(before).get()));
}

class JoinedClimb : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
    run_.step(command_t::START);
    run_.steps(100);
    ASSERT_EQ(run_.core.state(), SupervisorState::kClimbing);
  }
  Climber run_{first_part()};
};

TEST_F(JoinedClimb, ItClimbsOnWithoutAStopIntoThePartItIsGivenOnTheWay) {
  const plan_t before = first_part(), whole = joined(before, next_part());
  const double begun_s = run_.result.state.plan_time_s;
  ASSERT_EQ(run_.core.load_plan(whole), "");
  EXPECT_EQ(run_.core.state(), SupervisorState::kClimbing);
  Vector3 last(run_.result.state.body_position_w_m);
  double time_s = begun_s, stood_s = 0.0;
  const double end_s = before.knots.back().time_s;
  for (int i = 0; i < 40000 && run_.result.state.plan_complete == 0; ++i) {
    run_.step();
    const Vector3 now(run_.result.state.body_position_w_m);
    ASSERT_LT((now - last).norm(), 2e-4) << "at " << time_s << " s";
    const double step_s = run_.result.state.plan_time_s - time_s;
    ASSERT_GE(step_s, -1e-9);
    if (std::abs(time_s - end_s) < 0.1 && step_s < 1e-4) stood_s += 0.002;
    last = now;
    time_s = run_.result.state.plan_time_s;
  }
  EXPECT_EQ(stood_s, 0.0) << "at the end of the first part";
  EXPECT_NEAR(time_s, whole.knots.back().time_s, 1e-6);
  EXPECT_NEAR(last.x(), whole.knots.back().body_position_w_m[0], 2e-3);
  EXPECT_TRUE(run_.until(SupervisorState::kHolding, 2));
}

TEST_F(JoinedClimb, WithoutThePartItHoldsOnWhereItsPlanEnds) {
  ASSERT_TRUE(run_.until(SupervisorState::kHolding, 40000));
  EXPECT_NEAR(run_.result.state.plan_time_s, first_part().knots.back().time_s, 1e-6);
  for (int l = 0; l < kLimbs; ++l) {
    EXPECT_EQ(run_.result.reference[l].phase, static_cast<int>(LimbPhase::kStance));
    EXPECT_GT(run_.result.telemetry[l].grasp_force_n, 1.0);
  }
}

TEST_F(JoinedClimb, AnyOtherPlanIsRefused) {
  EXPECT_NE(run_.core.load_plan(next_part()).find("the robot is climbing; hold it first"), std::string::npos);
  EXPECT_NE(run_.core.load_plan(first_part()), "");
  EXPECT_EQ(run_.core.state(), SupervisorState::kClimbing);
}

TEST_F(JoinedClimb, ItGoesOnFromAStanceOnItsWayWithGripsWhereTheyWereFound) {
  const plan_t before = first_part();
  int knot = 0;
  const plan_t part = found_elsewhere(knot);
  ASSERT_EQ(join_knot(before, part), knot);
  const plan_t whole = joined(before, part);
  ASSERT_EQ(whole.knots.size(), before.knots.size());
  ASSERT_EQ(whole.holds.size(), before.holds.size());
  EXPECT_EQ(shared_intervals(*tabulate(whole), *tabulate(before)), knot);
  const crux_msgs::limb_telemetry_t grip = run_.result.telemetry[1];
  const crux_msgs::limb_reference_t planned = run_.result.reference[1];
  const JointVector q = Eigen::Map<const JointVector>(run_.result.output.joint_position_rad + kJoints);
  ASSERT_EQ(run_.core.load_plan(whole), "");
  run_.step();
  // The plan has the grip elsewhere; where it is, and what its joints are told, nobody has changed.
  EXPECT_NEAR(run_.result.reference[1].gripper_position_w_m[0], planned.gripper_position_w_m[0] + kFound_m, 1e-9);
  EXPECT_NEAR(run_.result.telemetry[1].gripper_position_w_m[0], grip.gripper_position_w_m[0], 2e-5);
  const JointVector after = Eigen::Map<const JointVector>(run_.result.output.joint_position_rad + kJoints);
  EXPECT_LT((after - q).cwiseAbs().maxCoeff(), 1e-3);
  Vector3 last(run_.result.state.body_position_w_m);
  for (int i = 0; i < 40000 && run_.result.state.plan_complete == 0; ++i) {
    run_.step();
    const Vector3 now(run_.result.state.body_position_w_m);
    ASSERT_LT((now - last).norm(), 2e-4) << "at " << run_.result.state.plan_time_s << " s";
    last = now;
  }
  EXPECT_EQ(run_.result.state.plan_complete, 1);
  EXPECT_NEAR(last.x(), whole.knots.back().body_position_w_m[0], 2e-3);
}

TEST_F(JoinedClimb, WhereItIsAboutToPassThatStanceItIsTooLate) {
  const plan_t before = first_part();
  int knot = 0;
  const plan_t whole = joined(before, found_elsewhere(knot));
  for (int i = 0; i < 40000 && run_.result.state.plan_time_s <= before.knots[knot - 1].time_s; ++i) run_.step();
  EXPECT_NE(run_.core.load_plan(whole).find("about to pass the stance"), std::string::npos);
  EXPECT_EQ(run_.core.state(), SupervisorState::kClimbing);
}

TEST_F(JoinedClimb, InTheLastIntervalItIsTooLate) {
  const plan_t before = first_part();
  const double last_s = before.knots[before.knots.size() - 2].time_s;
  for (int i = 0; i < 40000 && run_.result.state.plan_time_s <= last_s; ++i) run_.step();
  EXPECT_NE(run_.core.load_plan(joined(before, next_part())).find("about to end"), std::string::npos);
}

}  // namespace
}  // namespace crux_test
