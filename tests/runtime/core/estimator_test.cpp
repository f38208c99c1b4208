// Body pose from stance, slow correction, wrench from the F/T sensor.
#include <Eigen/Geometry>

#include "core/estimate/body_estimator.hpp"
#include "core/estimate/wrench_estimator.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

struct Stance {
  PerLimb<Pose> anchors_W;
  PerLimb<Pose> grippers_B;
};

constexpr PerLimb<double> kPlaces = {};  // levers of grippers whose turns say nothing

constexpr int kIterationsFromAfar = 50;  // a cycle has fewer, and begins near

Stance stance(const Pose& body_W) {
  Stance stance;
  for (int l = 0; l < kLimbs; ++l) {
    stance.grippers_B[l].position_m = {l < 2 ? 0.14 : -0.14, l % 2 == 0 ? 0.36 : -0.36, -0.13 - 0.01 * l};
    stance.anchors_W[l] = body_W * stance.grippers_B[l];
  }
  return stance;
}

TEST(BodyEstimator, RecoversAKnownPoseFromAnyThreeOrFourLimbs) {
  Random random;
  for (int missing = -1; missing < kLimbs; ++missing) {
    const Pose truth = {random.rotation(0.4), random.vector(0.3)};
    const Stance seen = stance(truth);
    PerLimb<double> weights = {1.0, 1.0, 0.7, 0.4};
    if (missing >= 0) weights[missing] = 0.0;
    BodyEstimator estimator;
    estimator.reset({Matrix3::Identity(), Vector3::Zero()});
    const Pose estimate = estimator.update(seen.anchors_W, seen.grippers_B, weights, kPlaces, kIterationsFromAfar);
    EXPECT_LT((estimate.position_m - truth.position_m).norm(), 1e-9) << "without limb " << missing;
    EXPECT_LT((estimate.rotation - truth.rotation).norm(), 1e-9) << "without limb " << missing;
  }
}

TEST(BodyEstimator, FollowsASmallMotionWithinOneCycle) {
  const Pose before = {rotation_exp({0.01, 0.02, 0.03}), {0.1, 0.0, 0.18}};
  const Pose after = {rotation_exp({0.011, 0.02, 0.031}), {0.1005, 0.0, 0.18}};
  const Stance seen = stance(after);
  BodyEstimator estimator;
  estimator.reset(before);
  const Pose estimate = estimator.update(seen.anchors_W, seen.grippers_B, {1, 1, 1, 1}, kPlaces);
  EXPECT_LT((estimate.position_m - after.position_m).norm(), 1e-9);
  EXPECT_LT((estimate.rotation - after.rotation).norm(), 1e-9);
}

TEST(BodyEstimator, TwoLimbsLeaveTheTurnAboutTheirLineAlone) {
  const Pose before = {Matrix3::Identity(), {0.0, 0.0, 0.18}};
  const Stance seen = stance(before);
  const Vector3 line = (seen.anchors_W[1].position_m - seen.anchors_W[0].position_m).normalized();
  // The body turned about the line between limbs 0 and 1: their points tell nothing of it.
  BodyEstimator estimator;
  const Pose turned = {rotation_exp(0.1 * line), Vector3::Zero()};
  const Pose start = {turned.rotation, seen.anchors_W[0].position_m - turned.rotation * seen.grippers_B[0].position_m};
  estimator.reset(start);
  for (int i = 0; i < 500; ++i) estimator.update(seen.anchors_W, seen.grippers_B, {1, 1, 0, 0}, kPlaces);
  EXPECT_LT((estimator.body_W().rotation - start.rotation).norm(), 1e-6);
  EXPECT_LT((estimator.body_W() * seen.grippers_B[1].position_m - seen.anchors_W[1].position_m).norm(), 1e-6);
}

TEST(BodyEstimator, GripsOnOneLineTellATurnAboutItByTheirOwn) {
  const Pose truth = {rotation_exp({0.1, 0.05, -0.2}), {0.3, 0.1, 0.18}};
  Stance seen = stance(truth);
  for (int l = 0; l < kLimbs; ++l) {
    seen.anchors_W[l].position_m = {0.2 * l, 0.2 * l, 0.035};
    seen.grippers_B[l] = truth.inverse() * seen.anchors_W[l];
  }
  const Pose turned = {rotation_exp(0.1 * Vector3(1.0, 1.0, 0.0).normalized()), Vector3::Zero()};
  BodyEstimator estimator;
  estimator.reset(turned * truth);
  for (int i = 0; i < 10; ++i) estimator.update(seen.anchors_W, seen.grippers_B, {1, 0, 1, 1}, kPlaces);
  EXPECT_GT((estimator.body_W().rotation - truth.rotation).norm(), 0.1);
  for (int i = 0; i < 10; ++i) estimator.update(seen.anchors_W, seen.grippers_B, {1, 0, 1, 1}, {0.03, 0.03, 0.03, 0});
  EXPECT_LT((estimator.body_W().rotation - truth.rotation).norm(), 1e-6);
  EXPECT_LT((estimator.body_W().position_m - truth.position_m).norm(), 1e-6);
}

TEST(BodyEstimator, WithoutAnyLimbStaysWhereItWas) {
  BodyEstimator estimator;
  const Pose pose = {rotation_exp({0.1, 0.0, 0.0}), {1.0, 2.0, 3.0}};
  estimator.reset(pose);
  const Stance seen = stance({});
  EXPECT_LT(
      (estimator.update(seen.anchors_W, seen.grippers_B, {0, 0, 0, 0}, kPlaces).position_m - pose.position_m).norm(),
      1e-15);
}

TEST(BodyCorrection, MakesWayForALimbAtItsJointsLimitsAndComesBack) {
  BodyCorrection correction(2.0, 0.04, 0.15);
  Pose reference;
  reference.position_m = {0.3, 0.2, 0.1};
  Pose body = reference;
  const auto way_m = [&] { return Vector3(body.position_m - reference.position_m); };
  // A limb misses 6 mm, and what the body has moved less; the body follows its command at once.
  const Vector3 missed_m(0.0, -0.006, 0.0);
  for (int i = 0; i < 1000; ++i) {
    correction.make_way(missed_m - way_m(), 0.002);
    body = correction.update(reference, body, 0.002);
  }
  EXPECT_NEAR((way_m() - missed_m).norm(), 0.0, 1e-4);
  for (int i = 0; i < 1000; ++i) correction.make_way(missed_m, 0.002);
  body = correction.update(reference, body, 0.002);
  EXPECT_NEAR(way_m().norm(), BodyCorrection::kMaxWay_m, 2e-4);
  for (int i = 0; i < 15000; ++i) correction.make_way(Vector3::Zero(), 0.002);
  body = correction.update(reference, body, 0.002);
  EXPECT_LT(way_m().norm(), 2e-4);
}

TEST(BodyCorrection, IntegratesTheErrorAndStopsAtItsClamp) {
  BodyCorrection correction(2.0, 0.04, 0.15);
  const Pose reference, estimate = {rotation_exp({0.0, 0.0, -0.1}), {0.01, 0.0, 0.0}};
  Pose command;
  for (int i = 0; i < 100; ++i) command = correction.update(reference, estimate, 0.002);
  EXPECT_NEAR(command.position_m.x(), -0.01 * 2.0 * 0.2, 1e-12);
  EXPECT_NEAR(rotation_log(command.rotation).z(), 0.1 * 2.0 * 0.2, 1e-12);
  for (int i = 0; i < 20000; ++i) command = correction.update(reference, estimate, 0.002);
  EXPECT_NEAR(command.position_m.norm(), 0.04, 1e-12);
  EXPECT_NEAR(rotation_log(command.rotation).norm(), 0.15, 1e-12);
}

TEST(BodyCorrection, ResetReproducesTheCommandGiven) {
  BodyCorrection correction(1.0, 0.04, 0.15);
  const Pose reference = {rotation_exp({0.0, 0.1, 0.0}), {0.1, 0.2, 0.3}};
  const Pose wanted = {rotation_exp({0.05, 0.1, 0.02}), {0.11, 0.2, 0.29}};
  correction.reset(wanted, reference);
  const Pose command = correction.update(reference, reference, 0.002);
  EXPECT_LT((command.position_m - wanted.position_m).norm(), 1e-12);
  EXPECT_LT((command.rotation - wanted.rotation).norm(), 1e-12);
}

/// What a sensor reads under a contact wrench: the hand's weight comes on top.
Wrench reading(const Wrench& contact_W, const Matrix3& rotation, const Vector3& gravity, const Wrench& bias_G) {
  const LimbDescription& limb = robot().limbs[0];
  const Vector3 weight = limb.hand_mass_kg * gravity;
  const Vector3 arm = rotation * limb.hand_com_G_m;
  return {rotation.transpose() * (contact_W.force_N + weight) + bias_G.force_N,
          rotation.transpose() * (contact_W.moment_Nm + arm.cross(weight)) + bias_G.moment_Nm};
}

TEST(WrenchEstimator, TakesOffTheHandsWeightInAnyPose) {
  Random random(2);
  const Vector3 gravity(-6.9, 0.0, -6.9);
  for (int i = 0; i < 20; ++i) {
    WrenchEstimator estimator(robot().limbs[0], robot().force_torque, robot().control);
    const Matrix3 rotation = random.rotation(1.0);
    const Wrench contact = random.wrench(40.0, 1.0);
    const Wrench found = estimator.update(reading(contact, rotation, gravity, {}), rotation, gravity, 0.002);
    EXPECT_LT((found.force_N - contact.force_N).norm(), 1e-12);
    EXPECT_LT((found.moment_Nm - contact.moment_Nm).norm(), 1e-12);
  }
}

TEST(WrenchEstimator, FiltersToFirstOrder) {
  WrenchEstimator estimator(robot().limbs[0], robot().force_torque, robot().control);
  const Vector3 none = Vector3::Zero();
  estimator.update({}, Matrix3::Identity(), none, 0.002);
  Wrench found;
  for (int i = 0; i < 4; ++i) found = estimator.update({{10.0, 0.0, 0.0}, none}, Matrix3::Identity(), none, 0.002);
  EXPECT_NEAR(found.force_N.x(), 10.0 * (1.0 - std::pow(0.8, 4)), 1e-12);
}

TEST(WrenchEstimator, LearnsTheBiasInSwingAndKeepsIt) {
  const Vector3 gravity(-6.9, 0.0, -6.9);
  const Wrench bias = {{0.5, -0.8, 0.3}, {0.02, 0.01, -0.03}};
  WrenchEstimator estimator(robot().limbs[0], robot().force_torque, robot().control);
  Random random(9);
  for (int i = 0; i < 3000; ++i) {  // 6 s: twenty time constants, the gripper turning
    const Matrix3 rotation = rotation_z(1e-3 * i);
    estimator.update(reading({}, rotation, gravity, bias), rotation, gravity, 0.002);
    estimator.tare(rotation, 0.002);
  }
  const Wrench contact = random.wrench(30.0, 1.0);
  Wrench found;
  for (int i = 0; i < 200; ++i)
    found = estimator.update(reading(contact, Matrix3::Identity(), gravity, bias), Matrix3::Identity(), gravity, 0.002);
  EXPECT_LT((found.force_N - contact.force_N).norm(), 1e-3);
  EXPECT_LT((found.moment_Nm - contact.moment_Nm).norm(), 1e-4);
}

TEST(WrenchEstimator, TakesNoTouchForABias) {
  const ForceTorqueDescription& sensor = robot().force_torque;
  const Wrench touch = {{12.0, -7.0, 0.4}, {0.3, -0.2, 0.01}};  // the last of each might be a bias
  WrenchEstimator estimator(robot().limbs[0], sensor, robot().control);
  Wrench felt;
  for (int i = 0; i < 3000; ++i) {
    felt = estimator.update(touch, Matrix3::Identity(), Vector3::Zero(), 0.002);
    estimator.tare(Matrix3::Identity(), 0.002);
  }
  EXPECT_LT((felt.force_N - Vector3(12.0 - 3.0 * sensor.bias_N, 3.0 * sensor.bias_N - 7.0, 0.0)).norm(), 1e-3);
  EXPECT_LT((felt.moment_Nm - Vector3(0.3 - 3.0 * sensor.bias_Nm, 3.0 * sensor.bias_Nm - 0.2, 0.0)).norm(), 1e-4);
}

}  // namespace
}  // namespace crux_test
