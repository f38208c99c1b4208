// Load sharing and the internal part of wrench errors: properties they must have whatever the numbers.
#include <Eigen/Geometry>

#include "core/loads/internal_wrench.hpp"
#include "core/loads/wrench_distribution.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

constexpr double kTwistLength_m = 0.03;
constexpr double kMomentLength_m = 0.1;
const Vector3 kWeight_N(-66.6, 0.0, -66.6);

PerLimb<Bearer> random_bearers(Random& random) {
  PerLimb<Bearer> limbs;
  for (int l = 0; l < kLimbs; ++l) {
    limbs[l].position_W_m = Vector3(l < 2 ? 0.14 : -0.14, l % 2 == 0 ? 0.36 : -0.36, 0.03) + random.vector(0.02);
    limbs[l].finger_axis_W = rotation_z(random.uniform(-0.5, 0.5)).col(0);
    limbs[l].load = random.uniform(0.3, 1.0);
    limbs[l].planned_W = random.wrench(20.0, 0.3);
  }
  return limbs;
}

Wrench net(const PerLimb<Wrench>& wrenches, const PerLimb<Vector3>& at_W_m, const Vector3& about_W_m) {
  Wrench sum;
  for (int l = 0; l < kLimbs; ++l) {
    sum.force_N += wrenches[l].force_N;
    sum.moment_Nm += wrenches[l].moment_Nm + (at_W_m[l] - about_W_m).cross(wrenches[l].force_N);
  }
  return sum;
}

PerLimb<Vector3> positions(const PerLimb<Bearer>& limbs) {
  return {limbs[0].position_W_m, limbs[1].position_W_m, limbs[2].position_W_m, limbs[3].position_W_m};
}

TEST(WrenchDistribution, RestoresEquilibriumAboutTheTrueCentreOfMass) {
  Random random;
  for (int i = 0; i < 100; ++i) {
    PerLimb<Bearer> limbs = random_bearers(random);
    if (i % 3 == 0) limbs[i % kLimbs].load = 0.0;
    const Vector3 com = Vector3(0.0, 0.0, 0.18) + random.vector(0.03);
    const PerLimb<Wrench> shared = balanced_wrenches(limbs, com, kWeight_N, kTwistLength_m);
    const Wrench sum = net(shared, positions(limbs), com);
    EXPECT_LT((sum.force_N + kWeight_N).norm(), 1e-4);
    EXPECT_LT(sum.moment_Nm.norm(), 1e-4);
  }
}

TEST(WrenchDistribution, ABalancedPlanIsLeftAlone) {
  Random random(4);
  PerLimb<Bearer> limbs = random_bearers(random);
  const Vector3 com(0.01, -0.02, 0.17);
  const PerLimb<Wrench> once = balanced_wrenches(limbs, com, kWeight_N, kTwistLength_m);
  for (int l = 0; l < kLimbs; ++l) limbs[l].planned_W = once[l];
  const PerLimb<Wrench> twice = balanced_wrenches(limbs, com, kWeight_N, kTwistLength_m);
  for (int l = 0; l < kLimbs; ++l) EXPECT_LT((twice[l].force_N - once[l].force_N).norm(), 1e-4);
}

TEST(WrenchDistribution, LimbsWithoutLoadGetNothingAndSmallLoadsLittle) {
  Random random(6);
  PerLimb<Bearer> limbs = random_bearers(random);
  limbs[2].load = 1e-3;
  limbs[2].planned_W = {};
  EXPECT_LT(balanced_wrenches(limbs, {0.0, 0.0, 0.18}, kWeight_N, kTwistLength_m)[2].force_N.norm(), 1.0);
  limbs[2].load = 0.0;
  const Wrench none = balanced_wrenches(limbs, {0.0, 0.0, 0.18}, kWeight_N, kTwistLength_m)[2];
  EXPECT_EQ(none.force_N.norm(), 0.0);
  EXPECT_EQ(none.moment_Nm.norm(), 0.0);
}

TEST(WrenchDistribution, AddsOnlyMomentsThatTwoFingersBear) {
  Random random(8);
  const PerLimb<Bearer> limbs = random_bearers(random);
  const PerLimb<Wrench> shared = balanced_wrenches(limbs, {0.02, 0.0, 0.18}, kWeight_N, kTwistLength_m);
  for (int l = 0; l < kLimbs; ++l) {
    const Vector3 added = shared[l].moment_Nm - limbs[l].planned_W.moment_Nm;
    EXPECT_LT(added.cross(limbs[l].finger_axis_W).norm(), 1e-10);
  }
}

TEST(WrenchDistribution, IsTheNearestBalancedSet) {
  Random random(10);
  const PerLimb<Bearer> limbs = random_bearers(random);
  const Vector3 com(0.02, 0.01, 0.18);
  const PerLimb<Wrench> shared = balanced_wrenches(limbs, com, kWeight_N, kTwistLength_m);
  const auto cost = [&](const PerLimb<Wrench>& wrenches) {
    double sum = 0.0;
    for (int l = 0; l < kLimbs; ++l) {
      const Wrench change = wrenches[l] - limbs[l].planned_W;
      sum += (change.force_N.squaredNorm() + change.moment_Nm.squaredNorm() / (kTwistLength_m * kTwistLength_m)) /
             limbs[l].load;
    }
    return sum;
  };
  // Stretching two limbs against each other along the line between them keeps the balance and must cost more.
  for (int a = 0; a < kLimbs; ++a) {
    for (int b = a + 1; b < kLimbs; ++b) {
      const Vector3 line = (limbs[b].position_W_m - limbs[a].position_W_m).normalized();
      for (const double pull : {-0.5, 0.5}) {
        PerLimb<Wrench> other = shared;
        other[a].force_N += pull * line;
        other[b].force_N -= pull * line;
        EXPECT_GT(cost(other), cost(shared));
      }
    }
  }
}

class AlongThePlane : public testing::Test {
 protected:
  AlongThePlane() {
    for (int l = 0; l < kLimbs; ++l) {
      feet_[l] = Vector3(l < 2 ? 0.14 : -0.14, l % 2 == 0 ? 0.36 : -0.36, 0.0) + random_.vector(0.05);
      feet_[l].z() = 0.0;
      forces_[l] = random_.wrench(8.0, 0.3);
      forces_[l].force_N.z() = random_.uniform(2.0, 40.0);
    }
  }
  PerLimb<Wrench> shared() const {
    PerLimb<Wrench> wrenches = forces_;
    share_along_plane(feet_, wrenches);
    return wrenches;
  }

  Random random_{14};
  PerLimb<Vector3> feet_;
  PerLimb<Wrench> forces_;
};

TEST_F(AlongThePlane, KeepsNormalForcesMomentsAndTheBalance) {
  for (const int without : {kLimbs, 0, 3}) {
    if (without < kLimbs) forces_[without] = {};
    const PerLimb<Wrench> after = shared();
    const Wrench before_net = net(forces_, feet_, {0.01, 0.02, 0.18}),
                 after_net = net(after, feet_, {0.01, 0.02, 0.18});
    EXPECT_LT((after_net.force_N - before_net.force_N).norm(), 1e-10);
    EXPECT_LT((after_net.moment_Nm - before_net.moment_Nm).norm(), 1e-10);
    for (int l = 0; l < kLimbs; ++l) {
      EXPECT_EQ(after[l].force_N.z(), forces_[l].force_N.z());
      EXPECT_EQ(after[l].moment_Nm, forces_[l].moment_Nm);
    }
  }
}

TEST_F(AlongThePlane, NoFootUsesMoreOfItsFrictionThanAnotherOnASlope) {
  const Vector3 uphill(0.36, 0.05, 1.0);
  forces_[0].force_N.z() = 6.0;
  forces_[3].force_N.z() = 0.0;
  for (Wrench& wrench : forces_) wrench.force_N = wrench.force_N.z() * uphill;
  const PerLimb<Wrench> alike = forces_;
  for (int a = 0; a < 3; ++a) {  // feet that pull at each other hold nothing up
    const Vector3 pull = random_.uniform(-60.0, 60.0) * (feet_[(a + 1) % 3] - feet_[a]);
    forces_[a].force_N += pull;
    forces_[(a + 1) % 3].force_N -= pull;
  }
  const PerLimb<Wrench> after = shared();
  for (int l = 0; l < kLimbs; ++l) EXPECT_LT((after[l].force_N - alike[l].force_N).norm(), 1e-10);
}

TEST_F(AlongThePlane, AFootAloneKeepsWhatItHas) {
  for (int l = 1; l < kLimbs; ++l) forces_[l] = {};
  EXPECT_EQ(shared()[0].force_N, forces_[0].force_N);
}

class InternalErrors : public testing::Test {
 protected:
  PerLimb<Wrench> project(const PerLimb<Wrench>& errors) const {
    return internal_errors(errors, positions_, load_, com_, kMomentLength_m);
  }
  Random random_{12};
  PerLimb<Vector3> positions_ = positions(random_bearers(random_));
  PerLimb<double> load_ = {1.0, 0.6, 1.0, 0.2};
  Vector3 com_{0.01, 0.02, 0.18};
};

TEST_F(InternalErrors, HaveNoNetForceNorMoment) {
  for (int i = 0; i < 50; ++i) {
    PerLimb<Wrench> errors;
    for (Wrench& error : errors) error = random_.wrench(5.0, 0.2);
    const Wrench sum = net(project(errors), positions_, com_);
    EXPECT_LT(sum.force_N.norm(), 1e-8);
    EXPECT_LT(sum.moment_Nm.norm(), 1e-8);
  }
}

TEST_F(InternalErrors, ProjectingTwiceIsProjectingOnce) {
  PerLimb<Wrench> errors;
  for (Wrench& error : errors) error = random_.wrench(5.0, 0.2);
  const PerLimb<Wrench> once = project(errors), twice = project(once);
  for (int l = 0; l < kLimbs; ++l) {
    EXPECT_LT((twice[l].force_N - once[l].force_N).norm(), 1e-8);
    EXPECT_LT((twice[l].moment_Nm - once[l].moment_Nm).norm(), 1e-8);
  }
}

TEST_F(InternalErrors, ASqueezeBetweenTwoLimbsPassesUnchanged) {
  const Vector3 line = (positions_[1] - positions_[0]).normalized();
  PerLimb<Wrench> errors;
  errors[0].force_N = 3.0 * line;
  errors[1].force_N = -3.0 * line;
  const PerLimb<Wrench> internal = project(errors);
  EXPECT_LT((internal[0].force_N - errors[0].force_N).norm(), 1e-8);
  EXPECT_LT((internal[1].force_N - errors[1].force_N).norm(), 1e-8);
}

TEST_F(InternalErrors, AWrongWeightVanishes) {
  // An error that looks like a heavier body: spread as the weights spread it.
  PerLimb<Wrench> errors;
  const Vector3 force(0.0, 0.0, -2.0);
  for (int l = 0; l < kLimbs; ++l) errors[l].force_N = load_[l] * force;
  Wrench sum = net(errors, positions_, com_);
  // Take the moment out by moving the reference point to where it vanishes: then nothing internal is left.
  Vector3 centre = Vector3::Zero();
  double weights = 0.0;
  for (int l = 0; l < kLimbs; ++l) {
    centre += load_[l] * positions_[l];
    weights += load_[l];
  }
  com_ = centre / weights;
  sum = net(errors, positions_, com_);
  ASSERT_LT(sum.moment_Nm.norm(), 1e-12);
  for (const Wrench& error : project(errors)) EXPECT_LT(error.force_N.norm(), 1e-8);
}

TEST_F(InternalErrors, LimbsWithoutLoadAreFree) {
  load_[3] = 0.0;
  PerLimb<Wrench> errors;
  errors[3] = {{1.0, 2.0, 3.0}, {0.1, 0.2, 0.3}};
  const PerLimb<Wrench> internal = project(errors);
  EXPECT_EQ(internal[3].force_N, errors[3].force_N);
  EXPECT_EQ(internal[3].moment_Nm, errors[3].moment_Nm);
  EXPECT_LT(internal[0].force_N.norm(), 1e-12);
}

}  // namespace
}  // namespace crux_test
