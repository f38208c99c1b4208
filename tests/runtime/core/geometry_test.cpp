// Geometry against Eigen's own, and SHA-256 against its published vector.
#include <Eigen/Geometry>

#include "core/robot/hash.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

TEST(Geometry, ExponentialAndLogarithmEqualAngleAxis) {
  Random random;
  for (int i = 0; i < 200; ++i) {
    const Vector3 v = random.vector(i % 2 == 0 ? 1.5 : 1e-8);
    const Matrix3 expected = Eigen::AngleAxisd(v.norm(), v.normalized()).toRotationMatrix();
    EXPECT_LT((rotation_exp(v) - expected).norm(), 1e-12);
    EXPECT_LT((rotation_log(expected) - v).norm(), 1e-12);
  }
  EXPECT_EQ(rotation_log(Matrix3::Identity()).norm(), 0.0);
  EXPECT_NEAR(rotation_log(rotation_exp({3.1, 0.0, 0.0})).x(), 3.1, 1e-12);
}

TEST(Geometry, RollPitchYawTurnAboutZThenYThenX) {
  const Vector3 rpy(0.3, -0.2, 1.1);
  const Matrix3 expected = (Eigen::AngleAxisd(rpy.z(), Vector3::UnitZ()) *
                            Eigen::AngleAxisd(rpy.y(), Vector3::UnitY()) * Eigen::AngleAxisd(rpy.x(), Vector3::UnitX()))
                               .toRotationMatrix();
  EXPECT_LT((rotation_from_rpy(rpy) - expected).norm(), 1e-14);
  EXPECT_LT((rotation_z(0.7) - rotation_from_rpy({0.0, 0.0, 0.7})).norm(), 1e-15);
}

TEST(Geometry, QuaternionTurnsLikeTheMatrix) {
  Random random(5);
  for (int i = 0; i < 100; ++i) {
    const Matrix3 rotation = random.rotation(3.0);
    const std::array<double, 4> q = quaternion_wxyz(rotation);
    EXPECT_GE(q[0], 0.0);
    EXPECT_LT((Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix() - rotation).norm(), 1e-12);
  }
}

TEST(Geometry, SmoothstepBlendsAndClips) {
  EXPECT_EQ(smoothstep(-1.0), 0.0);
  EXPECT_EQ(smoothstep(2.0), 1.0);
  EXPECT_DOUBLE_EQ(smoothstep(0.5), 0.5);
  EXPECT_DOUBLE_EQ(smoothstep(0.25), 3.0 / 16.0 - 2.0 / 64.0);
}

TEST(Hash, EqualsThePublishedVector) {
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

}  // namespace
}  // namespace crux_test
