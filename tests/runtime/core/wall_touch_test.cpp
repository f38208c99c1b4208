// A gripper of unknown height touches the wall beside its hold, and the estimate takes over where that is.
#include "core/grips/wall_touch.hpp"

#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr double kDt_s = 0.002;

TEST(WallTouch, ComesByFingersOrOnATallHoldByThePalm) {
  EXPECT_DOUBLE_EQ(touching_m(0.05, 0.012, 0.05), 0.012);
  EXPECT_DOUBLE_EQ(touching_m(0.08, 0.012, 0.05), 0.03);
}

TEST(WallTouch, OpensGoesDownAndBackAndCountsWhatLasts) {
  WallTouch touch;
  EXPECT_FALSE(touch.busy());
  touch.begin(0.02);
  EXPECT_FALSE(touch.advance({.opened = false, .distance_m = 0.0}, kDt_s));
  EXPECT_TRUE(touch.advance({.opened = true, .distance_m = 0.0}, kDt_s));
  EXPECT_DOUBLE_EQ(touch.beside_W_m().z(), -0.02 - WallTouch::kBeyond_m);
  for (int i = 0; i < 40; ++i) EXPECT_FALSE(touch.advance({.felt = true, .borne = true, .distance_m = 0.02}, kDt_s));
  EXPECT_FALSE(touch.advance({.felt = false, .distance_m = 0.02}, kDt_s));  // a jolt
  int cycles = 1;
  while (!touch.advance({.felt = true, .borne = true, .distance_m = 0.02}, kDt_s)) ++cycles;
  EXPECT_NEAR(cycles * kDt_s, 0.1, kDt_s);
  EXPECT_TRUE(touch.touched());
  EXPECT_EQ(touch.beside_W_m().norm(), 0.0);
  EXPECT_TRUE(touch.busy());
  EXPECT_FALSE(touch.advance({.felt = true, .borne = true, .distance_m = 0.02}, kDt_s));
  EXPECT_FALSE(touch.touched());
  touch.advance({.distance_m = 0.001}, kDt_s);
  EXPECT_TRUE(touch.begun());
  EXPECT_FALSE(touch.busy());
}

/// A folded limb bears much with little torque; a sensor that is wrong does not stop it.
TEST(WallTouch, IsFeltByTheSensorAloneWhereTheGripperStandsStill) {
  WallTouch touch;
  touch.begin(0.02);
  touch.advance({.opened = true}, kDt_s);
  double way_m = 0.045;
  for (; way_m > 0.025; way_m -= 1e-4) ASSERT_FALSE(touch.advance({.felt = true, .distance_m = way_m}, kDt_s));
  int cycles = 1;
  while (!touch.advance({.felt = true, .distance_m = way_m}, kDt_s)) ++cycles;
  EXPECT_TRUE(touch.touched());
  EXPECT_NEAR(cycles * kDt_s, 0.13, 0.01);
  WallTouch unfelt;
  unfelt.begin(0.02);
  unfelt.advance({.opened = true}, kDt_s);
  for (int i = 0; i < 500; ++i) ASSERT_FALSE(unfelt.advance({.distance_m = way_m}, kDt_s));
}

TEST(WallTouch, GivesUpWhereItsJointsEndOrNothingIsThere) {
  for (const WallTouch::Seen& seen : {WallTouch::Seen{.kept = true, .distance_m = 0.02}, {.distance_m = 0.001}}) {
    WallTouch touch;
    touch.begin(0.02);
    touch.advance({.opened = true}, kDt_s);
    EXPECT_TRUE(touch.advance(seen, kDt_s));
    EXPECT_FALSE(touch.touched());
    EXPECT_EQ(touch.beside_W_m().norm(), 0.0);
  }
}

TEST(WallTouch, ThatNeverEndsEnds) {
  WallTouch touch;
  touch.begin(0.02);
  int cycles = 0;
  for (; touch.busy() && cycles < 10000; ++cycles) touch.advance({.opened = cycles > 10, .distance_m = 0.03}, kDt_s);
  EXPECT_LT(cycles * kDt_s, 6.1);
}

/// A robot that hardly knows the height of what it grips once it has gripped again.
RobotDescription unsure() {
  RobotDescription description = robot();
  description.localisation.grasp_sigma_m = 0.03;
  return description;
}

/// LF goes to its hold, back, and there again; the wall is where its gripper is `kStands_m` high.
class SecondGrasp : public testing::Test {
 protected:
  static constexpr double kStands_m = 0.018, kPush_N = 12.0, kCount_rad = 2e-5;

  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
    run_.step(command_t::START);
    go([&] { return comes() && run_.result.reference[0].load == 1.0; });
    ASSERT_EQ(touched_, 0);  // its height was known from the start
    run_.step(command_t::HOLD);
    run_.steps(100);
    run_.step(command_t::REVERSE);
    go([&] { return run_.core.state() == SupervisorState::kHolding; });
    ASSERT_FALSE(run_.result.has_fault) << run_.result.fault.code;
    ASSERT_EQ(touched_, 0);  // on a way back it never does
    run_.step(command_t::RESUME);
  }
  bool comes() const { return run_.result.state.plan_time_s > 12.0; }

  template <class Until>
  void go(Until until) {
    for (int i = 0; i < 30000 && !until() && !run_.result.has_fault; ++i) {
      run_.step();
      crux_msgs::control_input_t& in = run_.plant.input();
      if (height_m(in) > kStands_m) {
        std::copy_n(in.joint_position_rad, kJoints, stood_.begin());
        continue;
      }
      for (int j = 0; j < kJoints; ++j) in.joint_position_rad[j] = stood_[j] + (i % 2) * kCount_rad;
      ++touched_;
      run_.plant.press(0, run_.result, Vector3::Zero(), {0.0, 0.0, kPush_N});
    }
  }

  /// Of LF's gripper, where its joints go next.
  double height_m(const crux_msgs::control_input_t& in) {
    LimbState state;
    kinematics_.evaluate(JointVector(in.joint_position_rad), state);
    return run_.result.state.body_position_w_m[2] + state.gripper_B.position_m.z();
  }
  double rf_height_m() const { return run_.result.telemetry[1].gripper_position_w_m[2]; }

  RobotDescription description_ = unsure();
  Climber run_{sample_plan(), description_};
  LimbKinematics kinematics_{robot().limbs[0]};
  std::array<double, kJoints> stood_{};
  int touched_ = 0;
};

TEST_F(SecondGrasp, TouchesTheWallAndTellsWhereTheStanceIs) {
  const double before_m = rf_height_m();
  go([&] { return comes() && run_.result.reference[0].load == 1.0; });
  EXPECT_FALSE(run_.result.has_fault) << run_.result.fault.code;
  EXPECT_GT(touched_, 50);
  EXPECT_LT(touched_, 500);
  run_.steps(1000);
  // Fingers touch where the gripper is a pad's radius high: it is lower than it seemed, and RF with it.
  const double high_m = kStands_m - robot().gripper.pad_radius_m;
  EXPECT_LT(rf_height_m() - before_m, -0.5 * high_m);
  EXPECT_GT(rf_height_m() - before_m, -1.2 * high_m);
}

}  // namespace
}  // namespace crux_test
