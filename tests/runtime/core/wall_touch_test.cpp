// A gripper of unknown height touches the wall beside its hold, and the estimate takes over where that is.
#include "core/grips/wall_touch.hpp"

#include "core/estimate/touched_height.hpp"

#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr double kDt_s = 0.002;

TEST(WallTouch, ComesByFingersOrOnATallHoldByThePalm) {
  EXPECT_DOUBLE_EQ(touching_m(0.05, 0.012, 0.05), 0.012);
  EXPECT_DOUBLE_EQ(touching_m(0.08, 0.012, 0.05), 0.03);
}

/// A gripper that follows its aim as Admittance::fade() makes it, down to a wall `wall_m` below where it starts that is
/// as stiff as a limb, and gives way where its joints feel it.
struct Falling {
  static constexpr double kStiff_N_m = 5000.0;
  double wall_m;
  bool joints_feel = false;
  WallTouch touch;
  double aim_m = 0.0, most_N = 0.0, time_s = 0.0;

  double low_m() const { return std::min(aim_m, wall_m); }
  double press_N() const { return kStiff_N_m * (aim_m - low_m()); }
  void step(bool felt) {
    const AdmittanceParameters& gains = robot().admittance;
    touch.advance({.opened = true, .felt = felt, .borne = joints_feel && press_N() > 5.0, .above_m = above_m()}, kDt_s);
    const double wants_m_s = (-touch.beside_W_m().z() - aim_m) / robot().control.swing_decay_s;
    const double yields_m_s = joints_feel ? press_N() / gains.damping_Ns_m : 0.0;
    aim_m += (std::min(wants_m_s, gains.max_speed_m_s) - yields_m_s) * kDt_s;
    most_N = std::max(most_N, press_N());
    time_s += kDt_s;
  }
  double above_m() const { return -touch.beside_W_m().z() - low_m(); }
  bool comes_down() const { return touch.busy() && !touch.touched() && time_s < 4.0; }
};

/// Three limbs bear the body: each newton with which it presses moves the body off the wall.
TEST(WallTouch, ComesDownSlowlyAndPressesLittle) {
  for (const bool joints_feel : {true, false}) {
    for (const double wall_m : {0.005, 0.01, 0.02, 0.035}) {
      Falling gripper{wall_m, joints_feel, {}};
      gripper.touch.begin(0.02);
      while (gripper.comes_down()) gripper.step(gripper.press_N() > 5.0);
      EXPECT_TRUE(gripper.touch.touched()) << wall_m;
      EXPECT_LT(gripper.most_N, 10.0) << wall_m;
      EXPECT_LT(gripper.time_s, 0.4 + wall_m / 0.018) << wall_m;
    }
  }
}

TEST(WallTouch, OpensGoesDownAndBackAndCountsWhatLasts) {
  WallTouch touch;
  EXPECT_FALSE(touch.busy());
  touch.begin(0.02);
  EXPECT_FALSE(touch.advance({.opened = false, .above_m = 0.0}, kDt_s));
  EXPECT_TRUE(touch.advance({.opened = true, .above_m = 0.0}, kDt_s));
  touch.advance({.above_m = 0.0}, kDt_s);
  EXPECT_LT(touch.beside_W_m().z(), 0.0);
  const WallTouch::Seen presses{.felt = true, .borne = true, .above_m = 0.01};
  for (int i = 0; i < 40; ++i) touch.advance(presses, kDt_s);
  touch.advance({.felt = false, .above_m = 0.01}, kDt_s);  // a jolt
  EXPECT_FALSE(touch.touched());
  int cycles = 0;
  for (; !touch.touched(); ++cycles) ASSERT_TRUE(touch.advance(presses, kDt_s));
  EXPECT_NEAR(cycles * kDt_s, 0.1, kDt_s);
  EXPECT_EQ(touch.beside_W_m().norm(), 0.0);
  EXPECT_TRUE(touch.busy());
  EXPECT_FALSE(touch.advance({.felt = true, .borne = true, .above_m = -0.02}, kDt_s));
  EXPECT_FALSE(touch.touched());
  touch.advance({.above_m = -0.001}, kDt_s);
  EXPECT_TRUE(touch.begun());
  EXPECT_FALSE(touch.busy());
}

/// A folded limb bears much with little torque; a sensor that is wrong does not stop it.
TEST(WallTouch, IsFeltByTheSensorAloneWhereTheGripperStandsStill) {
  Falling gripper{0.006, false, {}};
  gripper.touch.begin(0.02);
  for (; gripper.press_N() == 0.0; gripper.step(true)) {
    ASSERT_TRUE(gripper.touch.busy());
    ASSERT_FALSE(gripper.touch.touched());
  }
  const double stands_s = gripper.time_s;
  while (gripper.comes_down()) gripper.step(true);
  EXPECT_TRUE(gripper.touch.touched());
  EXPECT_NEAR(gripper.time_s - stands_s, 0.2, 0.1);
  Falling unfelt{0.006, false, {}};
  unfelt.touch.begin(0.02);
  for (; unfelt.time_s < 4.0; unfelt.step(false)) ASSERT_FALSE(unfelt.touch.touched());
}

/// The estimate is 8 mm too high while the limb is in the air, by play, and 1 mm once it bears.
TEST(TouchedHeight, CountsInTheStanceThatTheGripIsFoundIn) {
  TouchedHeight touched;
  touched.press(0.043);
  EXPECT_FALSE(touched.found(0.036)) << "it has not touched";
  touched.touch(0.008);
  touched.press(0.043);
  touched.press(0.040);  // as the pull on it begins
  EXPECT_NEAR(touched.found(0.036).value_or(1.0), 0.001, 1e-12);
  EXPECT_FALSE(touched.found(0.036));
  touched.touch(0.008);
  EXPECT_FALSE(touched.found(0.036)) << "nothing tells how it was as the fingers closed";
  touched.touch(0.008);
  touched.press(0.043);
  touched.open();
  touched.press(0.050);
  EXPECT_NEAR(touched.found(0.045).value_or(1.0), 0.003, 1e-12);
}

TEST(WallTouch, GivesUpWhereItsJointsEnd) {
  WallTouch touch;
  touch.begin(0.02);
  touch.advance({.opened = true}, kDt_s);
  EXPECT_TRUE(touch.advance({.kept = true, .above_m = 0.02}, kDt_s));
  EXPECT_FALSE(touch.touched());
  EXPECT_EQ(touch.beside_W_m().norm(), 0.0);
}

TEST(WallTouch, GivesUpWhereNothingIsThere) {
  Falling gripper{1.0, false, {}};
  gripper.touch.begin(0.02);
  do {
    gripper.step(false);
  } while (gripper.comes_down() && (gripper.time_s < 0.1 || gripper.touch.beside_W_m().z() < 0.0));
  EXPECT_FALSE(gripper.touch.touched());
  EXPECT_EQ(gripper.touch.beside_W_m().norm(), 0.0);
  EXPECT_NEAR(gripper.low_m(), 0.02 + WallTouch::kBeyond_m, 0.005);
}

TEST(WallTouch, ThatNeverEndsEnds) {
  WallTouch touch;
  touch.begin(0.02);
  int cycles = 0;
  for (; touch.busy() && cycles < 10000; ++cycles) touch.advance({.opened = cycles > 10, .above_m = 0.03}, kDt_s);
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
  static constexpr double kStands_m = 0.018, kPush_N = 9.0, kCount_rad = 2e-5;

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
