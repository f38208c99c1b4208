// Inverse kinematics of a limb with a five-bar: all that the linkage leaves, no more, and as near as can be.
#include "core/robot/five_bar.hpp"

#include <gtest/gtest.h>

#include <random>

#include "core/robot/inverse_kinematics.hpp"
#include "geared.hpp"

namespace crux_test {
namespace {

constexpr int kMany = 300, kEnough = 200;

class OfALimb {
 public:
  explicit OfALimb(const LimbDescription& limb) : limb_(limb), bar_(*limb.transmission.five_bar()) {}

  [[nodiscard]] bool holds(const JointVector& q_rad) const { return bar_.holds(q_rad.segment<2>(1), limb_.crank); }
  [[nodiscard]] bool in_the_box(const JointVector& q_rad) const {
    for (const int j : {1, 2})
      if (q_rad[j] < limb_.joints[j].lower_rad || q_rad[j] > limb_.joints[j].upper_rad) return false;
    return true;
  }
  /// Within the joints' own ranges.
  JointVector drawn() {
    JointVector q_rad = JointVector::Zero();
    for (int j = 0; j < limb_.driven; ++j)
      q_rad[j] = std::uniform_real_distribution(limb_.own[j].lower_rad, limb_.own[j].upper_rad)(random_);
    q_rad[4] *= 0.5;  // off the wrist's singular postures
    return q_rad;
  }
  [[nodiscard]] Pose gripper(const JointVector& q_rad) {
    Pose found;
    LimbJacobian unused;
    kinematics_.evaluate(q_rad, found, unused);
    return found;
  }
  IkResult solved(const Pose& target, const JointVector& start_rad) {
    return InverseKinematics(limb_, kinematics_).solve(target, start_rad, 200);
  }
  IkResult stepped(const Pose& target, const JointVector& last_rad, double dt_s) {
    return InverseKinematics(limb_, kinematics_).step(target, last_rad, dt_s);
  }

 private:
  const LimbDescription& limb_;
  const FiveBar& bar_;
  LimbKinematics kinematics_{limb_};
  std::mt19937_64 random_{7};
};

TEST(FiveBar, InverseKinematicsReachesWhatIsBesideTheBox) {
  const RobotDescription robot = five_barred_robot();
  OfALimb limb(robot.limbs[0]);
  int beside = 0;
  for (int i = 0; beside < kEnough; ++i) {
    ASSERT_LT(i, 100 * kMany);
    const JointVector q_rad = limb.drawn(), start_rad = q_rad + 0.02 * (limb.drawn() - q_rad);
    if (!limb.holds(q_rad) || limb.in_the_box(q_rad)) continue;
    const IkResult found = limb.solved(limb.gripper(q_rad), start_rad);
    EXPECT_TRUE(limb.holds(found.q_rad));
    beside += found.position_error_m < 1e-5 ? 1 : 0;
  }
  EXPECT_EQ(beside, kEnough);
}

TEST(FiveBar, InverseKinematicsKeepsToWhatHoldsAndComesNearerAllTheSame) {
  const RobotDescription robot = five_barred_robot();
  OfALimb limb(robot.limbs[1]);
  int beyond = 0, told = 0;
  for (int i = 0; beyond < kEnough; ++i) {
    ASSERT_LT(i, 100 * kMany);
    const JointVector beyond_rad = limb.drawn(), start_rad = limb.drawn();
    if (limb.holds(beyond_rad) || !limb.holds(start_rad)) continue;
    ++beyond;
    const Pose target = limb.gripper(beyond_rad);
    const IkResult found = limb.solved(target, start_rad);
    EXPECT_TRUE(limb.holds(found.q_rad));
    EXPECT_TRUE(found.q_rad.allFinite());
    EXPECT_LE(found.position_error_m, (limb.gripper(start_rad).position_m - target.position_m).norm() + 0.2);
    told += (found.limited & kIkPositionLimit) != 0 || found.position_error_m < 1e-4 ? 1 : 0;
  }
  EXPECT_GT(told, kEnough * 9 / 10);
}

TEST(FiveBar, ActuatorsGoNoFasterThanTheyCan) {
  RobotDescription robot = five_barred_robot();
  for (LimbDescription& each : robot.limbs) each.actuators[2].velocity_rad_s = 0.5;
  OfALimb limb(robot.limbs[2]);
  const Transmission& by = robot.limbs[2].transmission;
  constexpr double kDt_s = 0.002;
  int slowed = 0;
  for (int i = 0; i < kMany; ++i) {
    const JointVector last_rad = limb.drawn(), next_rad = last_rad + 0.01 * (limb.drawn() - last_rad);
    if (!limb.holds(last_rad) || !limb.holds(next_rad)) continue;
    const IkResult found = limb.stepped(limb.gripper(next_rad), last_rad, kDt_s);
    const double crank_rad_s = (by.actuators_rad(found.q_rad) - by.actuators_rad(last_rad))[2] / kDt_s;
    EXPECT_LT(std::abs(crank_rad_s), 0.5 * 1.02);
    slowed += (found.limited & kIkSpeedLimit) != 0 ? 1 : 0;
  }
  EXPECT_GT(slowed, kMany / 2);
}

TEST(FiveBar, NumbersStayNumbersWhereTheRodDoesNotReach) {
  crux_msgs::robot::FiveBar keys = five_barred_robot().five_bar;
  keys.rod_m = 3.0;
  const FiveBar bar(keys, 0.15, -1.0, {0.4, 1.5});
  EXPECT_FALSE(bar.closes_in_the_middle());
  EXPECT_TRUE(std::isfinite(bar.crank_rad({0.4, 1.5})));
  EXPECT_TRUE(std::isfinite(bar.next_rad(0.4, 2.0)));
  const FiveBar::Slopes slopes = bar.slopes({0.4, 1.5});
  EXPECT_TRUE(std::isfinite(slopes.first) && std::isfinite(slopes.next) && slopes.next != 0.0);
}

}  // namespace
}  // namespace crux_test
