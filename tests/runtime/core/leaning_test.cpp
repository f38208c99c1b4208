// What pads on leaning faces bear: by statics and by the friction cone itself.
#include <Eigen/Geometry>

#include <cmath>

#include "core/loads/grasp_force.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

constexpr double kFriction = 2.2;
constexpr int kTrials = 200;

ControlParameters plain_control() {
  ControlParameters control = robot().control;
  control.grasp_force_factor = 1.0;
  control.grasp_force_reserve_N = 0.0;
  return control;
}

Contact leaning(double first_rad, double second_rad, double pad_radius_m) {
  return {kFriction, 0.013, 60.0, 0.03, {first_rad, second_rad}, pad_radius_m};
}

TEST(LeaningFaces, APullOffTheWallHasTheFrictionThatTheLeanLeaves) {
  for (const double lean_rad : {0.0, 0.3, 0.6, 0.9}) {
    const Wrench pull = {{0.0, 0.0, -20.0}, Vector3::Zero()};
    const double needed_N =
        needed_grasp_force_N(pull, Vector3::UnitX(), leaning(lean_rad, lean_rad, 0.0), plain_control());
    EXPECT_NEAR(needed_N, 10.0 / std::tan(std::atan(kFriction) - lean_rad), 1e-9);
  }
}

TEST(LeaningFaces, NoSqueezeIsEnoughBeyondTheAngleOfFriction) {
  const double steep_rad = std::atan(kFriction) + 0.01;
  const Wrench pull = {{0.0, 0.0, -1.0}, Vector3::Zero()};
  const Contact contact = leaning(steep_rad, steep_rad, 0.0);
  EXPECT_EQ(needed_grasp_force_N(pull, Vector3::UnitX(), contact, plain_control()), kNoSqueeze_N);
}

TEST(LeaningFaces, ThePadsForcesAddUpToTheWrenchWhereTheyTouch) {
  Random random(3);
  for (int i = 0; i < kTrials; ++i) {
    const Vector3 axis = rotation_z(random.uniform(-2.0, 2.0)).col(0);
    const Contact contact = leaning(random.uniform(0.0, 0.8), random.uniform(0.0, 0.8), 0.012);
    const Wrench wrench = random.wrench(20.0, 0.5);
    const double squeeze_N = random.uniform(0.0, 40.0);
    Vector6 stacked;
    stacked << wrench.force_N, wrench.moment_Nm;
    Vector3 force_N = Vector3::Zero(), moment_Nm = Vector3::Zero();
    for (int finger = 0; finger < 2; ++finger) {
      const PadForm form = pad_form(axis, finger, contact);
      const Vector3 outward = finger == 0 ? axis : Vector3(-axis);
      const Vector3 at_m =
          (contact.half_opening_m + contact.pad_radius_m) * outward - contact.pad_radius_m * form.normal_W;
      const Vector3 pad_N = form.force * stacked + squeeze_N * form.by_squeeze;
      const double twist_Nm = (form.twist * stacked)(0) * contact.patch_k_m;
      force_N += pad_N;
      moment_Nm += at_m.cross(pad_N) + (finger == 0 ? twist_Nm : -twist_Nm) * form.normal_W;
      EXPECT_NEAR(form.normal_W.z(), std::sin(contact.lean_rad[finger]), 1e-12);
    }
    EXPECT_LT((force_N - wrench.force_N).norm(), 1e-9);
    EXPECT_NEAR(axis.dot(moment_Nm - wrench.moment_Nm), 0.0, 1e-9);
  }
}

TEST(LeaningFaces, TheLeastSqueezeIsWhereAPadIsAboutToSlip) {
  Random random(5);
  for (int i = 0; i < kTrials; ++i) {
    const Contact contact = leaning(random.uniform(0.0, 0.7), random.uniform(0.0, 0.7), 0.012);
    const Wrench wrench = random.wrench(20.0, 0.3);
    const Vector3 axis = rotation_z(random.uniform(-2.0, 2.0)).col(0);
    const double needed_N = needed_grasp_force_N(wrench, axis, contact, plain_control());
    if (needed_N <= 0.0 || needed_N >= kNoSqueeze_N) continue;
    EXPECT_NEAR(limit_surface_utilisation(wrench, axis, contact, needed_N), 1.0, 1e-6);
    EXPECT_GT(limit_surface_utilisation(wrench, axis, contact, 0.9 * needed_N), 1.0);
  }
}

}  // namespace
}  // namespace crux_test
