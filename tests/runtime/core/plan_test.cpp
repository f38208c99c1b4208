// A plan read between its knots against the golden vectors, its clock, and what makes the runtime refuse one.
#include <algorithm>
#include <functional>
#include <limits>

#include "../../msgs/golden_vectors.hpp"
#include "core/plan/plan_clock.hpp"
#include "core/plan/plan_validation.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::plan_t;

constexpr double kDt_s = 0.002;

/// Golden numbers carry twelve digits.
void expect_equal(const nlohmann::json& expected, const double* actual, const std::string& what) {
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const double value = expected[i].get<double>();
    EXPECT_NEAR(actual[i], value, 1e-10 * std::max(1.0, std::abs(value))) << what << "[" << i << "]";
  }
}

void expect_golden(const char* name, bool point_feet) {
  const nlohmann::json golden = crux_test::golden(name);
  const std::vector<std::uint8_t> bytes = bytes_of(golden["plan_lcm"]);
  crux_msgs::plan_t message;
  ASSERT_GT(message.decode(bytes.data(), 0, static_cast<int>(bytes.size())), 0);
  const std::unique_ptr<PreparedPlan> plan = tabulate(message);
  ASSERT_EQ(plan->point_feet, point_feet);
  ASSERT_GT(golden["samples"].size(), 10U);
  for (const nlohmann::json& sample : golden["samples"]) {
    const int k = sample["k"];
    const double u = sample["u"];
    const PlanReference reference = play(*plan, {k, u * plan->step_s[k]});
    const std::string at = "k " + std::to_string(k) + " u " + std::to_string(u) + " ";
    expect_equal(sample["body_position_w_m"], reference.body_W.position_m.data(), at + "body");
    const auto rpy = sample["body_rpy_rad"].get<std::vector<double>>();
    EXPECT_LT((reference.body_W.rotation - rotation_from_rpy({rpy[0], rpy[1], rpy[2]})).norm(), 1e-10) << at;
    for (int l = 0; l < kLimbs; ++l) {
      const nlohmann::json& limb = sample["limbs"][l];
      const LimbReference& played = reference.limbs[l];
      const std::string where = at + "limb " + std::to_string(l) + " ";
      expect_equal(limb["gripper_position_w_m"], played.gripper_position_W_m.data(), where + "position");
      EXPECT_NEAR(played.gripper_yaw_W_rad, limb["gripper_yaw_w_rad"].get<double>(), 1e-10) << where;
      for (int i = 0; i < 2; ++i)
        EXPECT_NEAR(played.gripper_tilt_W_rad[i], limb["gripper_tilt_w_rad"][i].get<double>(), 1e-10) << where;
      EXPECT_NEAR(played.finger_opening_m, limb["finger_opening_m"].get<double>(), 1e-10) << where;
      EXPECT_NEAR(played.load, limb["load"].get<double>(), 1e-10) << where;
      Vector6 wrench;
      wrench << played.wrench_W.force_N, played.wrench_W.moment_Nm;
      expect_equal(limb["wrench_w"], wrench.data(), where + "wrench");
    }
  }
}

TEST(ReferencePlayer, EqualsTheGoldenVectors) { expect_golden("interpolation.json", false); }

TEST(ReferencePlayer, EqualsTheGoldenVectorsOfKnotsAtTimesOfTheirOwn) { expect_golden("own_times.json", false); }

TEST(ReferencePlayer, EqualsTheGoldenVectorsOfFingersThatMove) { expect_golden("moving_fingers.json", false); }

TEST(ReferencePlayer, EqualsTheGoldenVectorsOfGrippersThatTilt) { expect_golden("tilted.json", false); }

TEST(ReferencePlayer, EqualsTheGoldenVectorsOfFeetAmongGrips) { expect_golden("feet.json", false); }

TEST(GripperRotation, TurnsAboutTheTiltAfterTheYaw) {
  const double yaw_rad = 0.7;
  const Eigen::Vector2d tilt_rad(0.3, -0.4);  // by half a radian
  const Matrix3 rotation = gripper_rotation(yaw_rad, tilt_rad);
  const Vector3 about(0.6, -0.8, 0.0);
  EXPECT_NEAR((rotation * rotation.transpose() - Matrix3::Identity()).norm(), 0.0, 1e-12);
  EXPECT_NEAR(rotation.col(2).z(), std::cos(0.5), 1e-12);
  EXPECT_TRUE((rotation * rotation_z(-yaw_rad) * about).isApprox(about));
  EXPECT_GT(about.cross(Vector3::UnitZ()).dot(rotation.col(2)), 0.0);
}

TEST(ReferencePlayer, EqualsTheGoldenVectorsOfPointFeet) { expect_golden("walking.json", true); }

TEST(ReferencePlayer, PhasesFollowOneAnotherThroughASwing) {
  const std::unique_ptr<PreparedPlan> plan = tabulate(sample_plan());
  std::vector<LimbPhase> seen;
  for (int i = 0; i < 100 * plan->intervals(); ++i) {
    const PlanReference reference = play(*plan, {i / 100, (i % 100) * plan->step_s[i / 100] / 100});
    if (seen.empty() || seen.back() != reference.limbs[0].phase) seen.push_back(reference.limbs[0].phase);
    EXPECT_EQ(reference.limbs[1].phase, LimbPhase::kStance);
  }
  using enum LimbPhase;
  EXPECT_EQ(seen, (std::vector<LimbPhase>{kStance, kUnload, kOpen, kLift, kSwing, kDescend, kClose, kLoad, kStance}));
}

TEST(ReferencePlayer, PlayedInReverseASwingIsMirrored) {
  const std::unique_ptr<PreparedPlan> plan = tabulate(sample_plan());
  std::vector<LimbPhase> seen;
  for (int i = 100 * plan->intervals() - 1; i >= 0; --i) {
    const PlanTime at{i / 100, (i % 100) * plan->step_s[i / 100] / 100};
    const LimbReference forward = play(*plan, at).limbs[0];
    const LimbReference reverse = play(*plan, {at.interval, at.elapsed_s, true}).limbs[0];
    if (seen.empty() || seen.back() != reverse.phase) seen.push_back(reverse.phase);
    EXPECT_EQ(forward.gripper_position_W_m, reverse.gripper_position_W_m);
    EXPECT_EQ(forward.wrench_W.force_N, reverse.wrench_W.force_N);
    EXPECT_EQ(forward.load, reverse.load);
    // Fingers that close do so on the hold they meet.
    if (reverse.closing()) {
      EXPECT_EQ(reverse.finger_opening_m, plan->limbs[2][0].finger_opening_m);
      EXPECT_EQ(reverse.friction, plan->limbs[2][0].friction);
    }
    if (reverse.phase == LimbPhase::kOpen) {
      EXPECT_EQ(reverse.finger_opening_m, plan->limbs[5][0].finger_opening_m);
    }
  }
  using enum LimbPhase;
  EXPECT_EQ(seen, (std::vector<LimbPhase>{kStance, kUnload, kOpen, kLift, kSwing, kDescend, kClose, kLoad, kStance}));
}

TEST(ReferencePlayer, PhasesChangeAtTheInstantsOfThePlansDefinition) {
  const std::unique_ptr<PreparedPlan> plan = tabulate(sample_plan());
  const auto phase = [&](int k, double u) { return play(*plan, {k, u * plan->step_s[k]}).limbs[0].phase; };
  EXPECT_EQ(phase(2, 0.49), LimbPhase::kStance);
  EXPECT_EQ(phase(2, 0.51), LimbPhase::kUnload);
  EXPECT_EQ(phase(3, 0.49), LimbPhase::kOpen);
  EXPECT_EQ(phase(3, 0.51), LimbPhase::kLift);
  EXPECT_EQ(phase(5, 0.59), LimbPhase::kDescend);
  EXPECT_EQ(phase(5, 0.61), LimbPhase::kClose);
  EXPECT_EQ(phase(6, 0.41), LimbPhase::kLoad);
  EXPECT_EQ(phase(6, 0.43), LimbPhase::kStance);
}

TEST(ReferencePlayer, FingersThatMoveDoSoAsTheGripperLiftsAndComesDown) {
  plan_t message = sample_plan();
  message.format = plan_t::FORMAT_MOVING_FINGERS;
  const std::unique_ptr<PreparedPlan> plan = tabulate(message);
  const auto at = [&](int k, double u, bool back) { return play(*plan, {k, u * plan->step_s[k], back}).limbs[0]; };
  const double held_m = plan->limbs[2][0].finger_opening_m, open_m = plan->limbs[4][0].finger_opening_m;
  EXPECT_EQ(at(3, 0.39, false).phase, LimbPhase::kOpen);
  EXPECT_EQ(at(3, 0.41, false).phase, LimbPhase::kLift);
  EXPECT_EQ(at(3, 0.1, false).finger_opening_m, open_m);  // opened at once, and far enough for the lift
  EXPECT_NEAR(at(3, 0.1, false).opens_m - at(3, 0.1, false).may_lack_m, 0.4 * (open_m - held_m), 1e-12);
  EXPECT_EQ(at(3, 0.41, true).phase, LimbPhase::kDescend);
  EXPECT_NEAR(at(3, 0.41, true).finger_opening_m, held_m + 0.41 * (open_m - held_m), 1e-12);
  EXPECT_EQ(at(3, 0.39, true).finger_opening_m, held_m);
  EXPECT_EQ(at(5, 0.59, false).phase, LimbPhase::kDescend);
  EXPECT_EQ(at(5, 0.61, false).phase, LimbPhase::kClose);
  EXPECT_EQ(at(5, 0.61, false).open_m, plan->limbs[5][0].finger_opening_m);
}

TEST(Pchip, SlopesEqualSciPys) {
  struct Case {
    double dt_s;
    std::vector<double> values, slopes;
  };
  // scipy.interpolate.PchipInterpolator(t, values).derivative()(t), SciPy 1.17.
  const std::vector<Case> cases = {
      {2.0, {0, 1, 4, 9, 9, 7, 7.5, 3}, {0, 0.75, 1.875, 0, 0, 0, 0, -3.5}},
      {0.5, {0, 0.1, 2, 2.1}, {0, 0.38, 0.38, 0}},
      {1.0, {1, 0.9, 3, -2, -2.05}, {-0.3, 0, 0, -0.09900990099009867, 0}},
      {2.0, {0, 1}, {0.5, 0.5}},
      {2.0, {0, 3, 0}, {3, 0, -3}},
      {1.0, {0, 0.1, 5, 4}, {0, 0.196, 0, -3}},
      {1.0, {5, 4.9, 0, 3, 2.9}, {0, -0.196, 0, 0, -0.3}},
  };
  for (const Case& c : cases) {
    const std::vector<double> slopes = pchip_slopes(c.values, std::vector<double>(c.values.size() - 1, c.dt_s));
    ASSERT_EQ(slopes.size(), c.slopes.size());
    for (std::size_t i = 0; i < slopes.size(); ++i) EXPECT_NEAR(slopes[i], c.slopes[i], 1e-12) << "knot " << i;
  }
}

TEST(Pchip, SlopesEqualSciPysBetweenUnevenKnots) {
  const std::vector<double> values = {0.0, 0.1, 2.0, 2.1, 1.0, 1.5}, steps_s = {0.5, 2.0, 0.25, 1.0, 0.75};
  const std::vector<double> scipys = {0.050000000000000044, 0.2923076923076923, 0.5091811414392062, 0.0, 0.0,
                                      1.4238095238095239};
  const std::vector<double> slopes = pchip_slopes(values, steps_s);
  ASSERT_EQ(slopes.size(), scipys.size());
  for (std::size_t i = 0; i < slopes.size(); ++i) EXPECT_NEAR(slopes[i], scipys[i], 1e-12) << "knot " << i;
}

TEST(ReferencePlayer, LaterCrossesKnotsAndStopsAtTheEnd) {
  const std::unique_ptr<PreparedPlan> plan = tabulate(sample_plan());
  const PlanTime then = later(*plan, {1, 1.9}, 0.5);
  EXPECT_EQ(then.interval, 2);
  EXPECT_NEAR(then.elapsed_s, 0.4, 1e-12);
  const PlanTime end = later(*plan, {0, 0.0}, 1e3);
  EXPECT_EQ(end.seconds(*plan), plan->end_s());
  const PlanTime before = later(*plan, {2, 0.1, true}, 0.5);
  EXPECT_EQ(before.interval, 1);
  EXPECT_NEAR(before.elapsed_s, 1.6, 1e-12);
  EXPECT_EQ(later(*plan, {2, 0.1, true}, 1e3).seconds(*plan), 0.0);
}

class Clock : public testing::Test {
 protected:
  static PerLimb<LimbEvents> all_seen() {
    PerLimb<LimbEvents> events;
    events.fill({true, true, true, true});
    return events;
  }
  void advance(const PerLimb<LimbEvents>& events, double seconds) {
    for (int i = 0; i < std::lround(seconds / kDt_s); ++i) clock_.advance(*plan_, events, kDt_s, 1.0);
  }
  double now_s() const { return clock_.now().seconds(*plan_); }
  /// Departs, and where the clock then stands for good.
  double arrival_s(Motion motion) {
    clock_.depart(*plan_, motion);
    advance(all_seen(), plan_->end_s());
    EXPECT_TRUE(clock_.arrived(*plan_));
    return now_s();
  }
  /// With every event seen but one of limb LF: where the clock stops and what it says.
  void expect_stop(bool LimbEvents::* missing, double at_s, WaitingFor what) {
    PerLimb<LimbEvents> events = all_seen();
    events[0].*missing = false;
    advance(events, 30.0);
    EXPECT_NEAR(clock_.now().seconds(*plan_), at_s, 1e-9);
    EXPECT_EQ(clock_.waiting_for(), what);
    EXPECT_EQ(clock_.waiting_limb(), 0);
    EXPECT_GT(clock_.waited_s(), 5.0);
    EXPECT_FALSE(clock_.complete(*plan_));
    clock_.advance(*plan_, all_seen(), kDt_s, 1.0);
    EXPECT_GT(clock_.now().seconds(*plan_), at_s);
    EXPECT_EQ(clock_.waiting_for(), WaitingFor::kNothing);
    EXPECT_EQ(clock_.waited_s(), 0.0);
  }
  std::unique_ptr<PreparedPlan> plan_ = tabulate(sample_plan());  // LF lets go at knot 3, takes hold at knot 6
  PlanClock clock_;
};

TEST_F(Clock, RunsThroughWhenEverythingIsSeen) {
  advance(all_seen(), plan_->end_s() - 0.11);
  EXPECT_NEAR(clock_.now().seconds(*plan_), plan_->end_s() - 0.11, 1e-9);
  EXPECT_FALSE(clock_.complete(*plan_));
  advance(all_seen(), 0.25);
  EXPECT_TRUE(clock_.complete(*plan_));
  EXPECT_EQ(clock_.now().seconds(*plan_), plan_->end_s());
}

TEST_F(Clock, WaitsForTheLoadToGoBeforeALimbOpens) { expect_stop(&LimbEvents::unloaded, 6.0, WaitingFor::kUnload); }

TEST_F(Clock, StaysInTheGrippedPhaseWhileItWaitsForTheLoad) {
  PerLimb<LimbEvents> events = all_seen();
  events[0].unloaded = false;
  advance(events, 30.0);
  EXPECT_TRUE(play(*plan_, clock_.now()).limbs[0].gripping());
}

TEST_F(Clock, WaitsForTheFingersToOpenBeforeTheLift) { expect_stop(&LimbEvents::opened, 7.0, WaitingFor::kOpen); }

TEST_F(Clock, WaitsForTheGripperToArriveBeforeItCloses) {
  expect_stop(&LimbEvents::arrived, 11.2, WaitingFor::kArrive);
}

TEST_F(Clock, DoesNotCloseWhileItWaitsForTheArrival) {
  PerLimb<LimbEvents> events = all_seen();
  events[0].arrived = false;
  advance(events, 30.0);
  EXPECT_EQ(play(*plan_, clock_.now()).limbs[0].phase, LimbPhase::kDescend);
}

TEST_F(Clock, StandsWhereAGripperComesDownOnSomethingUntilItHasArrived) {
  PerLimb<LimbEvents> events = all_seen();
  advance(events, 10.5);
  events[0].blocked = true;
  events[0].arrived = false;
  const double at_s = clock_.now().seconds(*plan_);
  advance(events, 5.0);
  EXPECT_EQ(clock_.now().seconds(*plan_), at_s);
  EXPECT_EQ(clock_.waiting_for(), WaitingFor::kArrive);
  events[0].arrived = true;
  advance(events, 0.5);
  EXPECT_GT(clock_.now().seconds(*plan_), at_s);
}

TEST_F(Clock, WaitsForTheGripBeforeItLoads) { expect_stop(&LimbEvents::gripped, 12.0, WaitingFor::kGrip); }

TEST_F(Clock, AsksNothingOfLimbsThatStand) {
  PerLimb<LimbEvents> events;  // nothing is seen of RF, LR, RR
  events[0] = {true, true, true, true};
  advance(events, plan_->end_s() + 1.0);
  EXPECT_TRUE(clock_.complete(*plan_));
}

TEST_F(Clock, RunsAsFastAsItIsToldTo) {
  for (int i = 0; i < 500; ++i) clock_.advance(*plan_, all_seen(), kDt_s, 0.25);
  EXPECT_NEAR(now_s(), 0.25, 1e-9);
  clock_.advance(*plan_, all_seen(), kDt_s, 0.0);
  EXPECT_NEAR(now_s(), 0.25, 1e-9);
}

TEST_F(Clock, WaitsForNothingWhileItIsToldToStandStill) {
  PerLimb<LimbEvents> events = all_seen();
  events[0].unloaded = false;
  advance(events, 10.0);
  ASSERT_EQ(clock_.waiting_for(), WaitingFor::kUnload);
  clock_.advance(*plan_, events, kDt_s, 0.0);
  EXPECT_EQ(clock_.waiting_for(), WaitingFor::kNothing);
  EXPECT_EQ(clock_.waited_s(), 0.0);
  EXPECT_NEAR(now_s(), 6.0, 1e-9);
}

TEST_F(Clock, StopsAndStartsWithoutAJolt) {
  PerLimb<LimbEvents> events = all_seen();
  events[0].gripped = false;
  const auto run = [&](Motion motion) {
    clock_.depart(*plan_, motion);
    double before_s = now_s(), step_s = 0.0, most_s = 0.0;
    const auto cycle = [&] {
      clock_.advance(*plan_, events, kDt_s, 1.0);
      const double made_s = std::abs(now_s() - before_s);
      EXPECT_LE(std::abs(made_s - step_s), 2.1 * kDt_s * kDt_s / 0.2) << "at " << now_s() << " s";
      step_s = made_s;
      most_s = std::max(most_s, step_s);
      before_s = now_s();
    };
    while (!clock_.arrived(*plan_)) {
      if (clock_.waited_s() > 1.0) events = all_seen();
      cycle();
    }
    cycle();
    EXPECT_NEAR(most_s, kDt_s, 1e-9);
  };
  run(Motion::kStep);
  run(Motion::kForward);
  EXPECT_TRUE(clock_.complete(*plan_));
  run(Motion::kReverse);
}

TEST_F(Clock, StepsFromStanceToStance) {
  // Knots 0, 1, 2 and 7, and knot 6 once LF bears its whole load: 0.42 of the interval; then the plan's end.
  std::vector<double> stops_s;
  for (int i = 0; i < 5; ++i) stops_s.push_back(arrival_s(Motion::kStep));
  const std::vector<double> expected_s = {2.0, 4.0, 12.84, 14.0, 16.0};
  for (std::size_t i = 0; i < 5; ++i) EXPECT_NEAR(stops_s[i], expected_s[i], 1e-9) << "step " << i;
  EXPECT_TRUE(clock_.complete(*plan_));
}

TEST_F(Clock, AStanceThatIsNotGrippedIsWaitedFor) {
  PerLimb<LimbEvents> events = all_seen();
  events[3].gripped = false;
  clock_.depart(*plan_, Motion::kStep);
  advance(events, 5.0);
  EXPECT_NEAR(now_s(), 2.0, 1e-9);
  EXPECT_FALSE(clock_.arrived(*plan_));
  EXPECT_EQ(clock_.waiting_for(), WaitingFor::kGrip);
  EXPECT_EQ(clock_.waiting_limb(), 3);
  advance(all_seen(), 0.01);
  EXPECT_TRUE(clock_.arrived(*plan_));
}

TEST_F(Clock, GoesBackFromMidSwingAndThenFromStanceToStance) {
  EXPECT_FALSE(clock_.can_reverse(*plan_));
  advance(all_seen(), 9.0);
  for (const double stop_s : {4.0, 2.0, 0.0}) {
    ASSERT_TRUE(clock_.can_reverse(*plan_));
    EXPECT_NEAR(arrival_s(Motion::kReverse), stop_s, 1e-9);
    EXPECT_NEAR(clock_.verified().seconds(*plan_), stop_s, 1e-9);
  }
  EXPECT_FALSE(clock_.can_reverse(*plan_));
  clock_.depart(*plan_, Motion::kForward);
  advance(all_seen(), plan_->end_s() + 0.3);
  EXPECT_TRUE(clock_.complete(*plan_));
  EXPECT_NEAR(arrival_s(Motion::kReverse), 14.0, 1e-9);
  EXPECT_FALSE(clock_.complete(*plan_));
}

TEST_F(Clock, GoesBackToNoStanceThatItDidNotSeeGripped) {
  PerLimb<LimbEvents> events = all_seen();
  advance(events, 1.0);
  events[1].gripped = false;
  advance(events, 4.0);  // past knots 1 and 2
  ASSERT_NEAR(now_s(), 5.0, 1e-9);
  EXPECT_EQ(clock_.verified().seconds(*plan_), 0.0);
  EXPECT_NEAR(arrival_s(Motion::kReverse), 0.0, 1e-9);
}

class UnevenClock : public Clock {
 protected:
  void SetUp() override {
    plan_t plan = sample_plan();
    plan.format = plan_t::FORMAT_OWN_TIMES;
    const std::vector<double> times_s = {0.0, 0.5, 2.0, 3.0, 5.0, 5.5, 7.5, 8.0, 11.0};
    ASSERT_EQ(plan.knots.size(), times_s.size());
    for (std::size_t k = 0; k < times_s.size(); ++k) plan.knots[k].time_s = times_s[k];
    plan_ = tabulate(plan);
  }
};

TEST_F(UnevenClock, RunsAsTimeDoesOverEveryKnot) {
  double before_s = 0.0;
  while (before_s < 10.89) {
    clock_.advance(*plan_, all_seen(), kDt_s, 1.0);
    ASSERT_NEAR(now_s() - before_s, kDt_s, 1e-9);
    before_s = now_s();
  }
  advance(all_seen(), 0.25);
  EXPECT_TRUE(clock_.complete(*plan_));
  EXPECT_EQ(now_s(), 11.0);
}

TEST_F(UnevenClock, StandsAtEventsAndStancesOfEachIntervalsOwnLength) {
  expect_stop(&LimbEvents::unloaded, 3.0, WaitingFor::kUnload);
  expect_stop(&LimbEvents::opened, 4.0, WaitingFor::kOpen);
  expect_stop(&LimbEvents::arrived, 5.5 + 0.6 * 2.0, WaitingFor::kArrive);
  expect_stop(&LimbEvents::gripped, 7.5, WaitingFor::kGrip);
  EXPECT_NEAR(arrival_s(Motion::kStep), 7.5 + 0.42 * 0.5, 1e-9);
  for (const double stop_s : {2.0, 0.5, 0.0}) EXPECT_NEAR(arrival_s(Motion::kReverse), stop_s, 1e-9);
}

TEST_F(UnevenClock, LooksAheadAndBackOverUnevenKnots) {
  for (const double ahead_s : {0.3, 1.9, 4.0, 9.0}) {
    EXPECT_NEAR(later(*plan_, {0, 0.2}, ahead_s).seconds(*plan_), 0.2 + ahead_s, 1e-9);
    EXPECT_NEAR(later(*plan_, {7, 2.5, true}, ahead_s).seconds(*plan_), 10.5 - ahead_s, 1e-9);
  }
}

/// In reverse, from behind LF's touch-down: with every event seen but one of LF, where the clock stops.
class ReverseGates : public Clock {
 protected:
  void expect_stop_in_reverse(bool LimbEvents::* missing, double at_s, WaitingFor what) {
    advance(all_seen(), 15.0);
    for (const double stop_s : {14.0, 12.84}) ASSERT_NEAR(arrival_s(Motion::kReverse), stop_s, 1e-9);
    clock_.depart(*plan_, Motion::kReverse);
    PerLimb<LimbEvents> events = all_seen();
    events[0].*missing = false;
    advance(events, 30.0);
    EXPECT_NEAR(now_s(), at_s, 1e-9);
    EXPECT_EQ(clock_.waiting_for(), what);
    EXPECT_EQ(clock_.waiting_limb(), 0);
    EXPECT_FALSE(clock_.arrived(*plan_));
    advance(all_seen(), 12.0);
    EXPECT_TRUE(clock_.arrived(*plan_));
    EXPECT_NEAR(now_s(), 4.0, 1e-9);
  }
};

TEST_F(ReverseGates, TheLoadGoesFirst) { expect_stop_in_reverse(&LimbEvents::unloaded, 12.0, WaitingFor::kUnload); }
TEST_F(ReverseGates, ThenTheFingersOpen) { expect_stop_in_reverse(&LimbEvents::opened, 11.2, WaitingFor::kOpen); }
TEST_F(ReverseGates, ThenTheGripperIsBack) { expect_stop_in_reverse(&LimbEvents::arrived, 7.0, WaitingFor::kArrive); }
TEST_F(ReverseGates, ThenTheFingersGrip) { expect_stop_in_reverse(&LimbEvents::gripped, 6.0, WaitingFor::kGrip); }

struct Defect {
  const char* name;
  std::function<void(crux_msgs::plan_t&)> spoil;
  const char* said;  ///< part of the reason
};

class Refusals : public testing::TestWithParam<Defect> {};

TEST_P(Refusals, NameWhatIsWrong) {
  crux_msgs::plan_t plan = sample_plan();
  GetParam().spoil(plan);
  sign(plan);
  ControlCore core(robot());
  const std::string reason = core.load_plan(plan);
  EXPECT_NE(reason.find(GetParam().said), std::string::npos) << "said: " << reason;
}

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
using crux_msgs::limb_knot_t;

INSTANTIATE_TEST_SUITE_P(
    Plan, Refusals,
    testing::Values(
        Defect{"format", [](plan_t& p) { p.format = 7; }, "format is 7"},
        Defect{"robot", [](plan_t& p) { p.robot_name = "loris"; }, "for robot 'loris'"},
        Defect{"description", [](plan_t& p) { p.robot_sha256[0] ^= 1; }, "another description"},
        Defect{"one_knot", [](plan_t& p) { p.knots.resize(1); }, "1 knots"},
        Defect{"dt", [](plan_t& p) { p.dt_s = 0.0; }, "dt_s is 0"},
        Defect{"time", [](plan_t& p) { p.knots[4].time_s += 0.5; }, "knot 4: time_s"},
        Defect{"time_of_its_own",
               [](plan_t& p) {
                 p.format = plan_t::FORMAT_OWN_TIMES;
                 p.knots[4].time_s = p.knots[3].time_s;
               },
               "knot 4: time_s"},
        Defect{"a_late_beginning",
               [](plan_t& p) {
                 p.format = plan_t::FORMAT_OWN_TIMES;
                 p.knots[0].time_s = 0.1;
               },
               "knot 0: time_s is 0.1; the first knot stands at 0 s"},
        Defect{"nan_body", [](plan_t& p) { p.knots[2].body_rpy_rad[1] = kNan; }, "knot 2: the body pose"},
        Defect{"nan_force", [](plan_t& p) { p.knots[2].limbs[1].finger_force_w_n[3] = kNan; }, "knot 2, limb RF"},
        Defect{"infinite_gravity", [](plan_t& p) { p.gravity_w_m_s2[0] = 1.0 / 0.0; }, "gravity"},
        Defect{"point_contacts", [](plan_t& p) { p.patch_k_m = 0.0; }, "patch_k_m"},
        Defect{"phase", [](plan_t& p) { p.knots[1].limbs[2].phase = 9; }, "knot 1, limb LR: phase is 9"},
        Defect{"hold", [](plan_t& p) { p.knots[1].limbs[3].hold = 12; }, "knot 1, limb RR: hold is 12"},
        Defect{"friction", [](plan_t& p) { p.knots[1].limbs[3].friction = 0.0; }, "friction is 0"},
        Defect{"opening", [](plan_t& p) { p.knots[4].limbs[0].finger_separation_m = 0.2; },
               "finger_separation_m is 0.2"},
        Defect{"squeeze", [](plan_t& p) { p.knots[1].limbs[0].finger_force_w_n[0] += 90.0; }, "finger 1 presses"},
        Defect{"pull", [](plan_t& p) { p.knots[1].limbs[0].finger_force_w_n[3] += 90.0; }, "finger 2 presses"},
        Defect{"sensor", [](plan_t& p) { p.knots[1].limbs[0].finger_force_w_n[2] = 400.0; }, "the sensor reads"},
        Defect{"moves_in_stance", [](plan_t& p) { p.knots[1].limbs[1].gripper_position_w_m[0] += 0.01; },
               "moves in stance"},
        Defect{"force_in_air", [](plan_t& p) { p.knots[4].limbs[0].finger_force_w_n[1] = 1.0; }, "force in the air"},
        Defect{"air_at_end", [](plan_t& p) { p.knots.back().limbs[1].phase = limb_knot_t::AIR; }, "at the end"},
        Defect{"air_at_start", [](plan_t& p) { p.knots.front().limbs[1].phase = limb_knot_t::AIR; },
               "knot 0, limb RF: a walk and a plan of format 1"},
        Defect{"short_swing_at_start",
               [](plan_t& p) {
                 p.format = plan_t::FORMAT_FROM_AIR;
                 limb_knot_t& limb = p.knots.front().limbs[1];
                 limb.phase = limb_knot_t::AIR;
                 std::fill_n(limb.finger_force_w_n, 6, 0.0);
               },
               "two knots"},
        Defect{"short_swing", [](plan_t& p) { p.knots[1].limbs[1].phase = limb_knot_t::AIR; }, "two knots"},
        Defect{"out_of_reach", [](plan_t& p) { p.knots[4].limbs[0].gripper_position_w_m[0] += 0.3; },
               "limb LF: the gripper is out of reach"}),
    [](const testing::TestParamInfo<Defect>& info) { return info.param.name; });

TEST(PlanValidation, AcceptsTheSampleAndRefusesADamagedCopy) {
  ControlCore core(robot());
  crux_msgs::plan_t plan = sample_plan();
  EXPECT_EQ(core.load_plan(plan), "");
  plan.cost += 1.0;  // signed before
  EXPECT_NE(core.load_plan(plan).find("hash"), std::string::npos);
}

}  // namespace
}  // namespace crux_test
