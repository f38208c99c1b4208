// What the robot carries beyond its description, weighed by the force/torque sensors.
#include "core/estimate/weight_balance.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

constexpr double kDt_s = 0.002;

class Load : public testing::Test {
 protected:
  /// All sensors together feel `beyond_W_N` more than the weight.
  void hang(double seconds, const Vector3& beyond_W_N) {
    PerLimb<Wrench> felt_W;
    for (Wrench& wrench : felt_W) wrench.force_N = 0.25 * (beyond_W_N - weight_N_);
    for (int i = 0; i < static_cast<int>(seconds / kDt_s); ++i) {
      balance_.update(felt_W, grippers_W_m_, Vector3::Zero(), weight_N_, kDt_s);
      balance_.weigh(weight_N_, kDt_s);
    }
  }
  Vector3 load_W_N(double share) const { return -share * weight_N_; }

  const double doubt_N_ = kLimbs * robot().force_torque.bias_N;
  const Vector3 weight_N_{-70.0, 0.0, -70.0};
  PerLimb<Vector3> grippers_W_m_{Vector3(0.14, 0.36, -0.15), Vector3(0.14, -0.36, -0.15), Vector3(-0.14, 0.36, -0.15),
                                 Vector3(-0.14, -0.36, -0.15)};
  WeightBalance balance_{robot().stance, robot().force_torque};
};

TEST_F(Load, IsWeighedSoonAndLessWhatBiasesMayMake) {
  const double doubt = doubt_N_ / weight_N_.norm();
  hang(1.5, load_W_N(0.1));
  EXPECT_NEAR(balance_.carried(), 0.05 - doubt, 0.002);  // half of what is felt, and half of what is described
  hang(60.0, load_W_N(0.1));
  EXPECT_NEAR(balance_.carried(), 0.1 - doubt, 0.002);
  hang(120.0, Vector3::Zero());
  EXPECT_EQ(balance_.carried(), 0.0);
}

TEST_F(Load, IsNeitherWhatBiasesMayMakeNorLessThanNothing) {
  hang(60.0, load_W_N(0.99 * doubt_N_ / weight_N_.norm()));
  EXPECT_EQ(balance_.carried(), 0.0);
  balance_.forget_load();
  hang(60.0, load_W_N(-0.1));
  EXPECT_EQ(balance_.carried(), 0.0);
}

TEST_F(Load, IsNotWhatPullsAcrossGravity) {
  hang(60.0, {0.0, 15.0, 0.0});
  hang(60.0, {10.0, 0.0, -10.0});
  EXPECT_EQ(balance_.carried(), 0.0);
}

TEST_F(Load, IsNotAPush) {
  hang(2.0, Vector3::Zero());
  hang(1.0, load_W_N(0.17));
  EXPECT_EQ(balance_.carried(), 0.0);
}

TEST_F(Load, IsAQuarterOfTheWeightAtMost) {
  hang(60.0, load_W_N(0.6));
  EXPECT_EQ(balance_.carried(), 0.25);
}

TEST_F(Climbing, GripsBearWhatTheRobotCarries) {
  const Vector3 gravity(sample_plan().gravity_w_m_s2);
  const Vector3 weight_N = robot().total_mass_kg * gravity, carried_N = 0.6 * gravity;
  const auto asked_N = [this] {
    Vector3 sum_N = Vector3::Zero();
    for (const auto& limb : run_.result.telemetry) sum_N += Vector3(limb.force_reference_w_n);
    return sum_N;
  };
  run_.step(crux_msgs::command_t::HOLD);
  ASSERT_LT((asked_N() + weight_N).norm(), 0.1);
  for (int i = 0; i < 5000; ++i) {
    // The plant feels what is asked; it shall feel the weight and the load, whatever is asked.
    const Vector3 missing_N = -(weight_N + carried_N) - asked_N();
    for (int l = 0; l < kLimbs; ++l) run_.plant.press(l, run_.result, Vector3::Zero(), 0.25 * missing_N);
    run_.step();
    ASSERT_EQ(run_.core.state(), SupervisorState::kHolding);
  }
  ASSERT_EQ(run_.result.state.fault_code, 0);
  const double doubt_N = kLimbs * robot().force_torque.bias_N, felt_N = 10.0 / 11.5 * carried_N.norm();
  const Vector3 beyond_N = -(asked_N() + weight_N);
  EXPECT_NEAR(beyond_N.norm(), felt_N - doubt_N, 0.15);
  EXPECT_GT(beyond_N.dot(gravity), 0.0);
}

}  // namespace
}  // namespace crux_test
