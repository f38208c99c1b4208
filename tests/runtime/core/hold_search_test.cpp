// A hold that stands beside its place: a finger comes down on it, and the gripper goes over to that side.
#include "core/grips/hold_search.hpp"

#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr double kFinger_m = 0.052;  // from the gripper's centre to where a finger's tip stands
constexpr double kPush_N = 12.0;     // the other limbs of this plant do not feel it: below max_unbalanced_N
constexpr int kGives = 50;           // cycles after which what is stood on gives way, or bears again
constexpr double kCount_rad = 2e-5;  // of an encoder: one that says the very same is frozen

TEST(HoldSearch, TellsWhereAlongTheFingersItIsPressed) {
  const Matrix3 turn = rotation_z(0.7);
  for (const double at_m : {-0.052, 0.0, 0.031}) {
    const Vector3 force_N(1.0, 4.0, 18.0), place_m = turn * Vector3(at_m, 0.01, 0.0);
    EXPECT_NEAR(pressed_along_m({force_N, place_m.cross(force_N)}, turn.col(0), turn.col(2)), at_m, 1e-12);
  }
}

TEST(HoldSearch, GoesUpOverAndDownAndNoFurtherThanItMay) {
  HoldSearch search;
  ASSERT_TRUE(search.begin(0.034, Vector3::UnitZ(), {0.018, 0.0, 0.0}, 0.03));
  EXPECT_TRUE(search.beside_W_m().isApprox(Vector3(0.0, 0.0, 0.034 + HoldSearch::kClear_m)));
  EXPECT_FALSE(search.advance(0.02, 0.002));
  EXPECT_TRUE(search.advance(0.001, 0.002));
  EXPECT_TRUE(search.beside_W_m().isApprox(Vector3(0.018, 0.0, 0.034 + HoldSearch::kClear_m)));
  EXPECT_TRUE(search.advance(0.001, 0.002));
  EXPECT_FALSE(search.searches());
  EXPECT_TRUE(search.beside_W_m().isApprox(Vector3(0.018, 0.0, 0.0)));
  ASSERT_TRUE(search.begin(0.034, Vector3::UnitZ(), {0.018, 0.0, 0.0}, 0.03));
  while (search.searches()) search.advance(1.0, 0.002);
  EXPECT_TRUE(search.beside_W_m().isApprox(Vector3(0.03, 0.0, 0.0)));
  EXPECT_FALSE(search.begin(0.034, Vector3::UnitZ(), {-0.018, 0.0, 0.0}, 0.03));
}

/// LF's hold stands to the side `side` of its opening axis: a finger stands on it until the gripper has gone there.
class MovedHold : public testing::TestWithParam<double> {
 protected:
  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
    run_.step(command_t::START);
  }
  int phase() const { return run_.result.reference[0].phase; }
  bool closes() const { return phase() == static_cast<int>(LimbPhase::kClose); }

  /// It stands `at_m` from its middle, until it has gone `over_m` to that side; by turns it is pushed by that share.
  void climb(double side, double over_m, double at_m = kFinger_m, double share = 1.0) {
    std::array<double, kJoints> stood{};
    for (int i = 0; i < 12000 && !closes() && !run_.result.has_fault; ++i) {
      run_.step();
      crux_msgs::control_input_t& in = run_.plant.input();
      const crux_msgs::limb_telemetry_t& limb = run_.result.telemetry[0];
      const Vector3 place_m(limb.gripper_position_w_m), planned_m(run_.result.reference[0].gripper_position_w_m);
      const Vector3 axis = side * rotation_z(run_.result.reference[0].gripper_yaw_w_rad).col(0);
      const bool clear = phase() != static_cast<int>(LimbPhase::kDescend) || (place_m - planned_m).dot(axis) > over_m;
      if (stood_) highest_m_ = std::max(highest_m_, place_m.z());
      if (clear || height_m(in) > kStands_m) {
        std::copy_n(in.joint_position_rad, kJoints, stood.begin());
        continue;
      }
      for (int j = 0; j < kJoints; ++j) in.joint_position_rad[j] = stood[j] + (i % 2) * kCount_rad;
      if (!stood_) began_s_ = run_.result.state.plan_time_s;
      stood_ = true;
      stood_till_s_ = run_.result.state.plan_time_s;
      run_.plant.press(0, run_.result, at_m * axis, {0.0, 0.0, i / kGives % 2 == 0 ? kPush_N : share * kPush_N});
    }
  }

  /// Of LF's gripper, where its joints go next.
  double height_m(const crux_msgs::control_input_t& in) {
    kinematics_.evaluate(JointVector(in.joint_position_rad), state_);
    return run_.result.state.body_position_w_m[2] + state_.gripper_B.position_m.z();
  }

  static constexpr double kStands_m = 0.06;
  Climber run_{sample_plan()};
  LimbKinematics kinematics_{robot().limbs[0]};
  LimbState state_;
  bool stood_ = false;
  double began_s_ = 0.0, stood_till_s_ = 0.0;  ///< of the plan
  double highest_m_ = 0.0;                     ///< since then
};

TEST_P(MovedHold, IsFoundOnTheSideOfTheFingerThatStandsOnIt) {
  climb(GetParam(), 0.01);
  EXPECT_FALSE(run_.result.has_fault) << run_.result.fault.code;
  EXPECT_TRUE(closes());
  EXPECT_GT(highest_m_, kStands_m + 0.5 * HoldSearch::kClear_m);
}

TEST_P(MovedHold, IsPressedNoFurtherByTheClockWhereTheLimbGivesWay) {
  climb(GetParam(), 0.01, kFinger_m, 0.45);
  EXPECT_TRUE(closes());
  EXPECT_LT(stood_till_s_ - began_s_, 0.2);
}

TEST_P(MovedHold, ThatIsTooFarIsTold) {
  climb(GetParam(), 0.05);
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kEventTimeout));
  EXPECT_EQ(run_.result.fault.limb, 0);
}

TEST_P(MovedHold, AHandThatStandsOnItClosesThereForItComesNoLower) {
  climb(GetParam(), 0.05, 0.0);
  EXPECT_TRUE(stood_);
  EXPECT_FALSE(run_.result.has_fault) << run_.result.fault.code;
  EXPECT_TRUE(closes());
}

INSTANTIATE_TEST_SUITE_P(Sides, MovedHold, testing::Values(1.0, -1.0));

}  // namespace
}  // namespace crux_test
