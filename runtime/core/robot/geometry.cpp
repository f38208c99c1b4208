#include "core/robot/geometry.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace crux {

double smoothstep(double x) {
  const double c = std::clamp(x, 0.0, 1.0);
  return c * c * (3.0 - 2.0 * c);
}

Matrix3 skew(const Vector3& a) {
  Matrix3 s;
  s << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return s;
}

Matrix3 rotation_exp(const Vector3& v_rad) {
  const double angle = v_rad.norm();
  const Matrix3 s = skew(v_rad);
  // Series below 1e-6 rad: the closed forms divide by the angle.
  const double a = angle < 1e-6 ? 1.0 - angle * angle / 6.0 : std::sin(angle) / angle;
  const double b = angle < 1e-6 ? 0.5 - angle * angle / 24.0 : (1.0 - std::cos(angle)) / (angle * angle);
  return Matrix3::Identity() + a * s + b * s * s;
}

Vector3 rotation_log(const Matrix3& rotation) {
  const Eigen::Quaterniond raw(rotation);
  const Eigen::Quaterniond q = raw.w() < 0.0 ? Eigen::Quaterniond(-raw.coeffs()) : raw;
  const double sine = q.vec().norm();
  if (sine < 1e-12) return 2.0 * q.vec();
  return q.vec() * (2.0 * std::atan2(sine, q.w()) / sine);
}

Matrix3 rotation_from_rpy(const Vector3& rpy_rad) {
  const double cr = std::cos(rpy_rad.x()), sr = std::sin(rpy_rad.x());
  const double cp = std::cos(rpy_rad.y()), sp = std::sin(rpy_rad.y());
  const double cy = std::cos(rpy_rad.z()), sy = std::sin(rpy_rad.z());
  Matrix3 r;
  r << cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,  //
      sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,   //
      -sp, cp * sr, cp * cr;
  return r;
}

Matrix3 rotation_z(double yaw_rad) {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  Matrix3 r;
  r << c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0;
  return r;
}

Matrix3 gripper_rotation(double yaw_rad, const Eigen::Vector2d& tilt_rad) {
  Matrix3 upright = rotation_z(yaw_rad);
  if (tilt_rad.isZero(0.0)) return upright;
  return rotation_exp({tilt_rad.x(), tilt_rad.y(), 0.0}) * upright;
}

std::array<double, 4> quaternion_wxyz(const Matrix3& rotation) {
  const Eigen::Quaterniond q(rotation);
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  return {sign * q.w(), sign * q.x(), sign * q.y(), sign * q.z()};
}

Vector3 clamped_norm(const Vector3& v, double limit) {
  const double norm = v.norm();
  return norm > limit ? Vector3(v * (limit / norm)) : v;
}

Matrix3 orthonormalised(const Matrix3& rotation) {
  Matrix3 r;
  r.col(0) = rotation.col(0).normalized();
  r.col(1) = (rotation.col(1) - r.col(0) * r.col(0).dot(rotation.col(1))).normalized();
  r.col(2) = r.col(0).cross(r.col(1));
  return r;
}

}  // namespace crux
