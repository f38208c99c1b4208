// Wrenches within what fingers and joints can bear: held against the cone of (2), the joints' torques and other
// answers.
#include <Eigen/Geometry>

#include "core/limb/joint_heat.hpp"
#include "core/loads/load_sharing.hpp"
#include "core/robot/gravity.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

constexpr double kTwistLength_m = 0.03;
constexpr int kCycles = 400;  // until planes and cone agree
constexpr double kForceTolerance_N = 0.05;
const Vector3 kWeight_N(-66.6, 0.0, -66.6);
const Vector3 kCom_W_m(0.0, 0.0, 0.18);

/// A robot on four holds.
struct Stance {
  PerLimb<Bearer> bearers;
  PerLimb<Capacity> capacities;
  PerLimb<LimbState> limbs;

  explicit Stance(Random& random, double friction) {
    const Pose body_W{Matrix3::Identity(), {0.0, 0.0, 0.19}};
    for (int l = 0; l < kLimbs; ++l) {
      LimbKinematics kinematics(robot().limbs[l]);
      kinematics.evaluate(random_angles(random, 0.2), limbs[l]);
      capacities[l] = {{friction, 0.008, 60.0, 0.025}, &limbs[l], JointVector::Zero(), JointVector::Constant(12.0)};
      bearers[l] = {(body_W * limbs[l].gripper_B).position_m, rotation_z(random.uniform(-0.5, 0.5)).col(0), 1.0,
                    random.wrench(10.0, 0.2)};
    }
  }
  Stance(const Stance&) = delete;
  Stance& operator=(const Stance&) = delete;

  PerLimb<Wrench> balanced() const { return balanced_wrenches(bearers, kCom_W_m, kWeight_N, kTwistLength_m); }

  PerLimb<Wrench> shared(LoadSharing& sharing) const {
    return sharing.within_limits(balanced(), bearers, capacities, kCom_W_m, Matrix3::Identity(), robot().control);
  }

  /// How far [N] the worst pad is beyond what it can press: (2) of each pad alone, from statics of the two.
  double worst_pad_N(const PerLimb<Wrench>& wrenches) const {
    double worst_N = -1e9;
    for (int l = 0; l < kLimbs; ++l) {
      if (bearers[l].load <= 0.0) continue;
      const Contact& contact = capacities[l].contact;
      const Vector3& axis = bearers[l].finger_axis_W;
      for (const double side : {1.0, -1.0}) {
        // Each pad at side·a·axis bears f with Σf = F and Σ side·a·axis×f = M across the axis.
        const Vector3 couple = wrenches[l].moment_Nm.cross(axis) / (2.0 * contact.half_opening_m);
        const Vector3 force = 0.5 * wrenches[l].force_N + side * couple;
        const Vector3 shear = force - force.dot(axis) * axis;
        const double twist_N = 0.5 * wrenches[l].moment_Nm.dot(axis) / contact.patch_k_m;
        const double pressed_N = contact.max_normal_N + side * 0.5 * wrenches[l].force_N.dot(axis);
        const double usable_N =
            contact.friction / robot().control.grasp_force_factor * (pressed_N - robot().control.grasp_force_reserve_N);
        worst_N = std::max(worst_N, std::sqrt(shear.squaredNorm() + twist_N * twist_N) - usable_N);
      }
    }
    return worst_N;
  }

  double worst_joint_Nm(const PerLimb<Wrench>& wrenches) const {
    double worst_Nm = -1e9;
    for (int l = 0; l < kLimbs; ++l) {
      if (bearers[l].load <= 0.0) continue;
      const JointVector torque_Nm = contact_torque(limbs[l], wrenches[l]);
      worst_Nm = std::max(worst_Nm, (torque_Nm.cwiseAbs() - capacities[l].max_torque_Nm).maxCoeff());
    }
    return worst_Nm;
  }
};

Wrench unbalanced(const Stance& stance, const PerLimb<Wrench>& wrenches) {
  Wrench net{kWeight_N, Vector3::Zero()};
  for (int l = 0; l < kLimbs; ++l) {
    net.force_N += wrenches[l].force_N;
    net.moment_Nm += wrenches[l].moment_Nm + (stance.bearers[l].position_W_m - kCom_W_m).cross(wrenches[l].force_N);
  }
  return net;
}

double squared_change(const PerLimb<Wrench>& from, const PerLimb<Wrench>& to) {
  double sum = 0.0;
  for (int l = 0; l < kLimbs; ++l) {
    sum += (to[l].force_N - from[l].force_N).squaredNorm() +
           (to[l].moment_Nm - from[l].moment_Nm).squaredNorm() / (0.05 * 0.05);
  }
  return sum;
}

TEST(LoadSharing, LeavesWrenchesWithinTheLimitsAlone) {
  Random random;
  const Stance stance(random, 2.2);
  LoadSharing sharing;
  const PerLimb<Wrench> balanced = stance.balanced(), shared = stance.shared(sharing);
  ASSERT_LT(stance.worst_pad_N(balanced), 0.0);
  EXPECT_EQ(squared_change(balanced, shared), 0.0);
}

TEST(LoadSharing, KeepsBalanceConesAndTorquesWhereTheBalancedWrenchesDoNot) {
  Random random(3);
  int solved = 0;
  for (int i = 0; i < 24; ++i) {
    Stance stance(random, random.uniform(0.3, 0.6));
    if (i % 2 == 0) stance.bearers[i / 2 % kLimbs].load = 0.0;
    for (Capacity& capacity : stance.capacities) capacity.max_torque_Nm.setConstant(random.uniform(4.0, 12.0));
    const PerLimb<Wrench> balanced = stance.balanced();
    if (stance.worst_pad_N(balanced) < 0.0 && stance.worst_joint_Nm(balanced) < 0.0) continue;
    LoadSharing sharing;
    PerLimb<Wrench> shared;
    for (int cycle = 0; cycle < kCycles; ++cycle) shared = stance.shared(sharing);
    const Wrench net = unbalanced(stance, shared);
    EXPECT_LT(net.force_N.norm(), 0.01) << i;
    EXPECT_LT(net.moment_Nm.norm(), 0.001) << i;
    if (stance.worst_pad_N(shared) < kForceTolerance_N && stance.worst_joint_Nm(shared) < 0.01) ++solved;
    EXPECT_LE(stance.worst_pad_N(shared), std::max(stance.worst_pad_N(balanced), kForceTolerance_N)) << i;
    // It settles, whether all limits can be kept or not.
    const PerLimb<Wrench> settled = shared;
    for (int cycle = 0; cycle < kCycles; ++cycle) {
      shared = stance.shared(sharing);
      ASSERT_LT(squared_change(settled, shared), 0.01 * 0.01) << i << " cycle " << cycle;
    }
    EXPECT_EQ(sharing.failures(), 0) << i;
  }
  EXPECT_GE(solved, 5);  // of those that can be solved at all
}

TEST(LoadSharing, AChangeFadesWhenTheLimitsAreKeptAgainAndIsBalancedOnTheLimbsThatAreLeft) {
  Random random(5);
  Stance stance(random, 0.45);
  stance.bearers[3].load = 0.0;
  LoadSharing sharing;
  PerLimb<Wrench> before;
  for (int cycle = 0; cycle < kCycles; ++cycle) before = stance.shared(sharing);
  ASSERT_GT(squared_change(stance.balanced(), before), 1.0);
  for (Capacity& capacity : stance.capacities) capacity.contact.friction = 2.2;
  ASSERT_LT(stance.worst_pad_N(stance.balanced()), 0.0);
  for (int cycle = 0; cycle < kCycles; ++cycle) {
    const PerLimb<Wrench> shared = stance.shared(sharing);
    for (int l = 0; l < kLimbs; ++l) ASSERT_LT((shared[l].force_N - before[l].force_N).norm(), 0.6) << cycle;
    ASSERT_LT(unbalanced(stance, shared).force_N.norm(), 0.01) << cycle;
    before = shared;
  }
  EXPECT_EQ(squared_change(stance.balanced(), before), 0.0);

  for (Capacity& capacity : stance.capacities) capacity.contact.friction = 0.45;
  for (int cycle = 0; cycle < kCycles; ++cycle) before = stance.shared(sharing);
  stance.bearers[3].load = 1.0;
  stance.bearers[0].load = 0.0;
  for (int cycle = 0; cycle < 10; ++cycle) {
    const PerLimb<Wrench> shared = stance.shared(sharing);
    ASSERT_LT(unbalanced(stance, shared).force_N.norm(), 0.01) << cycle;
    ASSERT_LT(unbalanced(stance, shared).moment_Nm.norm(), 0.001) << cycle;
  }
}

TEST(LoadSharing, NoOtherWrenchesWithinTheLimitsAreNearer) {
  Random random(5);
  Stance stance(random, 0.45);
  stance.bearers[3].load = 0.0;
  const PerLimb<Wrench> balanced = stance.balanced();
  ASSERT_GT(stance.worst_pad_N(balanced), 0.0);
  LoadSharing sharing;
  PerLimb<Wrench> shared;
  for (int cycle = 0; cycle < kCycles; ++cycle) shared = stance.shared(sharing);
  ASSERT_LT(stance.worst_pad_N(shared), kForceTolerance_N);
  int within = 0;
  for (int i = 0; i < 4000; ++i) {
    // Any other balanced wrenches: shift what was planned, balance again, couples included.
    PerLimb<Bearer> bearers = stance.bearers;
    for (int l = 0; l < 3; ++l) bearers[l].planned_W = shared[l] + random.wrench(6.0, 0.15);
    const PerLimb<Wrench> other = balanced_wrenches(bearers, kCom_W_m, kWeight_N, kTwistLength_m);
    if (stance.worst_pad_N(other) > 0.0 || stance.worst_joint_Nm(other) > 0.0) continue;
    ++within;
    EXPECT_GE(squared_change(balanced, other), squared_change(balanced, shared) * (1.0 - 1e-3));
  }
  EXPECT_GT(within, 20);
}

TEST(JointHeat, FoldsBackFromThePeakToWhatTheMotorBearsForGood) {
  const auto& joints = robot().limbs[0].joints;
  const double time_s = robot().motor.heating_time_s, continuous_Nm = 8.1;  // 5 A of 0.05 Nm/A, geared 36 times at 0.9
  ASSERT_GT(joints[1].effort_Nm, continuous_Nm);
  JointHeat heat(robot().motor, joints);
  const auto stand = [&](double torque_Nm, double lasts_s) {
    for (double t = 0.0; t < lasts_s; t += 0.002) heat.take(JointVector::Constant(torque_Nm), 0.002);
  };
  stand(0.0, 0.01);
  EXPECT_EQ(heat.allowed_Nm(1), joints[1].effort_Nm);
  // At 11 Nm the load reaches 0.8 of what the winding bears when 1 - exp(-t/T) is 0.8 of (continuous/11)^2.
  const double bears = std::pow(continuous_Nm / 11.0, 2);
  stand(11.0, -0.95 * time_s * std::log(1.0 - 0.8 * bears));
  EXPECT_EQ(heat.allowed_Nm(1), joints[1].effort_Nm);
  stand(11.0, time_s);
  EXPECT_NEAR(heat.allowed_Nm(1), continuous_Nm, 1e-9);
  EXPECT_EQ(heat.allowed_Nm(5), joints[5].effort_Nm) << "it bears its effort for good";
  stand(2.0, 4.0 * time_s);
  EXPECT_EQ(heat.allowed_Nm(1), joints[1].effort_Nm);
}

TEST(LoadSharing, GivesTheLastGoodAnswerWhereThereIsNone) {
  Random random(7);
  Stance stance(random, 0.35);
  LoadSharing sharing;
  PerLimb<Wrench> good;
  for (int cycle = 0; cycle < kCycles; ++cycle) good = stance.shared(sharing);
  ASSERT_GT(squared_change(stance.balanced(), good), 1.0);
  stance.limbs[1].jacobian_B.setConstant(std::numeric_limits<double>::quiet_NaN());
  PerLimb<Wrench> kept = stance.shared(sharing);
  EXPECT_LT(squared_change(good, kept), 1e-12);
  EXPECT_EQ(sharing.failures(), 1);
  // For good it is not kept: the wrenches go back to those that are balanced.
  for (int cycle = 0; cycle < kCycles; ++cycle) kept = stance.shared(sharing);
  EXPECT_GT(sharing.failures(), 100);
  EXPECT_LT(squared_change(stance.balanced(), kept), 1e-6);
}

}  // namespace
}  // namespace crux_test
