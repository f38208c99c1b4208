// The map and the estimate: what a grasp and the weight's direction tell, in closed form, and that commands do not feel
// it.
#include <Eigen/Geometry>

#include "core/estimate/body_estimator.hpp"
#include "core/estimate/map_localisation.hpp"
#include "core/plan/plan_preparation.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

const Vector3 kUp = Vector3(1.0, 0.0, 1.0).normalized();  // on a wall of 45°
const Vector3 kWeight_N = -94.0 * kUp;
constexpr LocalisationParameters kParameters = {
    .hold_sigma_m = 0.005, .grasp_sigma_m = 0.0005, .grasp_sigma_rad = 0.0005, .tilt_sigma_rad = 0.002};

PerLimb<Vector3> arms() {
  PerLimb<Vector3> arms;
  for (int l = 0; l < kLimbs; ++l) arms[l] = {l < 2 ? 0.14 : -0.14, l % 2 == 0 ? 0.36 : -0.36, -0.15};
  return arms;
}

MapLocalisation begun(const LocalisationParameters& parameters = kParameters) {
  MapLocalisation localisation(parameters);
  localisation.begin(Vector3::Zero(), arms(), {true, true, true, true});
  return localisation;
}

TEST(MapLocalisation, BeginsWithTheErrorOfAFitToFourHolds) {
  const Matrix6 covariance = begun().covariance();
  // σ²/4 for the mean of four points; about their centre, turns by σ²/Σ(distance from the axis)².
  const double variance = 0.005 * 0.005;
  const double about_x = variance / (4 * 0.36 * 0.36), about_y = variance / (4 * 0.14 * 0.14);
  EXPECT_NEAR(covariance(3, 3), about_x, 1e-3 * about_x);
  EXPECT_NEAR(covariance(4, 4), about_y, 1e-3 * about_y);
  EXPECT_NEAR(covariance(2, 2), variance / 4, 1e-3 * variance);
  // The body's origin stands 0.15 m above that centre.
  EXPECT_NEAR(covariance(0, 0), variance / 4 + 0.15 * 0.15 * about_y, 1e-3 * variance);
}

TEST(MapLocalisation, AGraspMovesTheEstimateByTheKalmanGain) {
  MapLocalisation localisation = begun();
  const Matrix6 before = localisation.covariance();
  const Vector3 arm = arms()[0], axis = Vector3::UnitX();
  localisation.grasp(Vector3::Zero(), arm, axis, 0.002);
  // One scalar measurement: gain P·h/(hᵀ·P·h + σ²), with the errors of one more grasp in P.
  Matrix6 covariance = before;
  for (int i = 0; i < 6; ++i) covariance(i, i) += 0.0005 * 0.0005;
  Vector6 h;
  h << 1.0, 0.0, 0.0, 0.0, arm.z(), -arm.y();  // ∂(axis·(t + θ × arm))/∂(t, θ)
  const double variance = h.dot(covariance * h) + 0.005 * 0.005;
  const Vector6 expected = covariance * h * (-0.002 / variance);
  EXPECT_LT((localisation.pending() - expected).norm(), 1e-12);
  EXPECT_NEAR(h.dot(localisation.covariance() * h), h.dot(covariance * h) * 0.005 * 0.005 / variance, 1e-15);
}

TEST(MapLocalisation, AMisplacedHoldCountsAsThreeSigmaAtMost) {
  MapLocalisation far = begun(), farther = begun();
  far.grasp(Vector3::Zero(), arms()[0], Vector3::UnitX(), 0.03);
  farther.grasp(Vector3::Zero(), arms()[0], Vector3::UnitX(), 3.0);
  EXPECT_EQ(far.pending(), farther.pending());
  EXPECT_LT(far.pending().head<3>().norm(), 0.015);
}

TEST(MapLocalisation, AMisplacedHoldMakesTheEstimateHardlySurer) {
  MapLocalisation near = begun(), farther = begun();
  near.grasp(Vector3::Zero(), arms()[0], Vector3::UnitX(), 0.0);
  farther.grasp(Vector3::Zero(), arms()[0], Vector3::UnitX(), 3.0);
  const auto variance = [](const MapLocalisation& map) { return map.covariance()(0, 0); };
  EXPECT_GT(variance(farther), 1.05 * variance(near));
}

TEST(MapLocalisation, DriftAlongTheAxisStaysBounded) {
  // Each grasp adds 0.1 mm; what is applied takes effect at the next one.
  MapLocalisation localisation = begun();
  double error_m = 0.0, largest_m = 0.0;
  for (int grasp = 0; grasp < 400; ++grasp) {
    error_m += 1e-4;
    const Vector3 arm = arms()[grasp % kLimbs];
    localisation.grasp(Vector3::Zero(), arm, Vector3::UnitX(), error_m);
    for (int cycle = 0; cycle < 5000; ++cycle) {
      const Pose motion = localisation.correction(Vector3::Zero(), 0.002);
      error_m += (motion * arm - arm).x();
    }
    largest_m = std::max(largest_m, error_m);
  }
  EXPECT_LT(largest_m, 1.5e-3);  // of 40 mm
}

TEST(MapLocalisation, HeightIsKnownAtFirstAndUnsureAfterAWay) {
  MapLocalisation localisation = begun();
  const Vector3 arm(0.28, 0.36, -0.15);
  EXPECT_FALSE(localisation.unsure_of_height());
  int grasps = 0;
  Vector3 place = Vector3::Zero();
  for (; grasps < 100 && !localisation.unsure_of_height(); ++grasps) {
    place.x() += 0.044;
    localisation.grasp(place, arm, Vector3::UnitX(), 0.0);
  }
  EXPECT_GT(grasps, 7);  // 0.3 m: a wall of four holds is climbed without
  EXPECT_LT(grasps, 100);
  localisation.touch(place, arm, 0.003);
  EXPECT_FALSE(localisation.unsure_of_height());
  // The point comes down by most of what it was too high.
  const Vector6& found = localisation.pending();
  const double moved_m = (Vector3(found.head<3>()) + Vector3(found.tail<3>()).cross(arm)).z();
  EXPECT_LT(moved_m, -0.5 * 0.003);
  EXPECT_GT(moved_m, -0.003);
}

TEST(MapLocalisation, DriftOffTheWallStaysBoundedWhereGrippersTouchIt) {
  // The body tilts by 0.02 mrad and rises by 0.04 mm with each grasp, over 2000 grasps and 88 m.
  MapLocalisation localisation = begun();
  Pose body;  // true minus estimated, as a motion of W
  double largest_m = 0.0;
  int touches = 0;
  Vector3 place = Vector3::Zero();
  for (int grasp = 0; grasp < 2000; ++grasp) {
    const Vector3 arm = arms()[grasp % kLimbs] + Vector3(0.14, 0.0, 0.0);
    place.x() += 0.044;
    const Pose tilts = {rotation_exp({0.0, 2e-5, 0.0}), {0.0, 0.0, 4e-5}};
    body = Pose{tilts.rotation, place + tilts.position_m - tilts.rotation * place} * body;
    const auto error_m = [&] { return (body * Vector3(place + arm) - place - arm).z(); };
    if (localisation.unsure_of_height()) {
      localisation.touch(place, arm, -error_m());
      ++touches;
    }
    localisation.grasp(place, arm, Vector3::UnitX(), 0.0);
    for (int cycle = 0; cycle < 100; ++cycle) {
      const Pose motion = localisation.correction(place, 0.05);
      body = body * motion.inverse();
    }
    largest_m = std::max(largest_m, std::abs(error_m()));
  }
  EXPECT_LT(largest_m, 0.01);
  EXPECT_LT(touches, 200);
}

TEST(MapLocalisation, TheWeightTellsTheTiltButNotTheTurnAboutTheVertical) {
  const LocalisationParameters sure = {
      .hold_sigma_m = 0.005, .grasp_sigma_m = 0.0, .grasp_sigma_rad = 0.0, .tilt_sigma_rad = 1e-6};
  MapLocalisation localisation = begun(sure);
  // The estimate is turned by −tilt: the forces, truly straight up, are felt turned so too.
  const Vector3 tilt = 0.003 * Vector3::UnitY();
  localisation.feel(rotation_exp(-tilt) * -kWeight_N, kWeight_N, true, 2.0);
  // A grasp across, which tells nothing here: it only takes in what was felt.
  localisation.grasp(Vector3::Zero(), Vector3::Zero(), Vector3::UnitY(), 0.0);
  EXPECT_LT((localisation.pending().tail<3>() - tilt).norm(), 1e-6);
  const Matrix3 left = localisation.covariance().bottomRightCorner<3, 3>();
  EXPECT_LT(Vector3::UnitY().dot(left * Vector3::UnitY()), 1e-11);
  EXPECT_GT(kUp.dot(left * kUp), 1e-6);
}

TEST(MapLocalisation, ForcesThatAreNotTheWeightTellNothing) {
  MapLocalisation localisation = begun();
  localisation.feel(rotation_exp({0.0, 0.1, 0.0}) * -0.5 * kWeight_N, kWeight_N, true, 2.0);  // somebody lifts
  localisation.feel(rotation_exp({0.0, 0.1, 0.0}) * -kWeight_N, kWeight_N, false, 2.0);       // biases unknown
  localisation.feel(rotation_exp({0.0, 0.1, 0.0}) * -kWeight_N, kWeight_N, true, 0.1);        // too short a look
  localisation.grasp(Vector3::Zero(), Vector3::Zero(), Vector3::UnitY(), 0.0);
  EXPECT_EQ(localisation.pending().norm(), 0.0);
}

TEST(MapLocalisation, ATiltFoundOnTheWayCorrectsTheHeightGainedByIt) {
  // All of the place's error comes from the way since the last look: Δz = −θ_y·Δx.
  const LocalisationParameters parameters = {
      .hold_sigma_m = 1e-7, .grasp_sigma_m = 0.0, .grasp_sigma_rad = 0.001, .tilt_sigma_rad = 1e-6};
  MapLocalisation localisation = begun(parameters);
  localisation.grasp(Vector3::Zero(), Vector3::Zero(), Vector3::UnitY(), 0.0);
  const Vector3 way = {0.5, 0.0, 0.0}, tilt = {0.0, 0.002, 0.0};
  localisation.correction(way, 0.002);
  localisation.feel(rotation_exp(-tilt) * -kWeight_N, kWeight_N, true, 2.0);
  localisation.grasp(way, Vector3::Zero(), Vector3::UnitY(), 0.0);
  // Half of the turn's variance was there along the way, half came with the grasp at its end.
  EXPECT_NEAR(localisation.pending()[4], tilt.y(), 1e-6);
  EXPECT_NEAR(localisation.pending()[2], -0.5 * tilt.y() * way.x(), 1e-6);
}

TEST(MapLocalisation, CorrectionsAddUpToWhatWasFound) {
  MapLocalisation localisation = begun();
  localisation.grasp(Vector3::Zero(), arms()[1], Vector3::UnitX(), 0.004);
  const Vector6 found = localisation.pending();
  const Vector3 point = Vector3::Zero();
  Pose sum;
  for (int cycle = 0; cycle < 10000; ++cycle) sum = localisation.correction(point, 0.002) * sum;
  EXPECT_LT(localisation.pending().norm(), 1e-9);
  EXPECT_LT((sum.position_m - found.head<3>()).norm(), 1e-6);
  EXPECT_LT((rotation_log(sum.rotation) - found.tail<3>()).norm(), 1e-6);
}

TEST(BodyCorrection, MovesAlongWithTheWorld) {
  BodyCorrection correction(1.0, 0.04, 0.15);
  const Pose reference = {rotation_exp({0.0, 0.1, 0.0}), {0.1, 0.2, 0.3}};
  const Pose command = {rotation_exp({0.05, 0.1, 0.02}), {0.11, 0.2, 0.29}};
  const Pose motion = {rotation_exp({0.001, -0.002, 0.003}), {1e-3, 2e-3, -1e-3}};
  correction.reset(command, reference);
  correction.relocate(motion, reference);
  const Pose moved = correction.update(reference, reference, 0.0), expected = motion * command;
  EXPECT_LT((moved.position_m - expected.position_m).norm(), 1e-12);
  EXPECT_LT((moved.rotation - expected.rotation).norm(), 1e-12);
}

TEST(LimbController, CommandsAreTheSameWhereverTheWorldIsCountedFrom) {
  // Two equal limbs on a hold; one's world is moved, with the body poses it is given.
  const crux_msgs::plan_t plan = sample_plan();
  const auto prepared = prepare_plan(robot(), plan);
  ASSERT_TRUE(prepared);
  const LimbReference reference = play(*prepared.value(), {0, 0.0}).limbs[1];
  const Pose body = {Matrix3::Identity(), {0.0, 0.0, 0.185}};
  const Pose motion = {rotation_exp({0.002, -0.003, 0.001}), {1e-3, -2e-3, 1.5e-3}};
  const Vector3 gravity(plan.gravity_w_m_s2);
  LimbController still(robot(), 1), moved(robot(), 1);
  ObedientPlant plant(plan);
  for (LimbController* limb : {&still, &moved}) {
    limb->sense(plant.input());
    limb->engage(reference, body, true);
  }
  moved.relocate(motion, reference);
  const Wrench error = {{3.0, 1.0, -2.0}, {0.1, 0.0, 0.2}};
  for (int i = 0; i < 2; ++i) {  // soon after; later the admittance's weak spring pulls towards the plan's attitude
    still.follow_contact(reference, body, body, false);
    moved.follow_contact(reference, motion * body, motion * body, false);
    still.comply(reference, error, Matrix3::Identity(), 0.002);
    const Wrench turned = {motion.rotation * error.force_N, motion.rotation * error.moment_Nm};
    moved.comply(reference, turned, motion.rotation, 0.002);
    still.drive(reference, {}, gravity, body, 1.0, 0.002);
    moved.drive(reference, {}, motion.rotation * gravity, motion * body, 1.0, 0.002);
  }
  crux_msgs::control_output_t a{}, b{};
  still.write(NodeMode::kTrack, NodeMode::kTrack, a);
  moved.write(NodeMode::kTrack, NodeMode::kTrack, b);
  for (int j = kJoints; j < 2 * kJoints; ++j) EXPECT_NEAR(a.joint_position_rad[j], b.joint_position_rad[j], 1e-5);
}

}  // namespace
}  // namespace crux_test
