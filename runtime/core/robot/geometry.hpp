// Small vocabulary of rigid-body geometry used by the whole control core.
//
// Frames: W wall (z off the wall, x up the slope), B body, G gripper (x opening axis, z off the wall). A rotation named
// `rotation_WB` turns coordinates W <- B.
#pragma once

#include <Eigen/Core>

#include <algorithm>
#include <array>

#include "crux_msgs/robot.hpp"

namespace crux {

inline constexpr int kLimbs = crux_msgs::robot::kLimbs;
inline constexpr int kJoints = crux_msgs::robot::kMostJoints;  // slots of one limb
inline constexpr int kPlacing = crux_msgs::robot::kJoints;     // joints that put a gripper anywhere
inline constexpr int kAllJoints = kLimbs * kJoints;

using Vector3 = Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix3 = Eigen::Matrix3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using JointVector = Eigen::Matrix<double, kJoints, 1>;
using JointMatrix = Eigen::Matrix<double, kJoints, kJoints>;
using LimbJacobian = Eigen::Matrix<double, 6, kJoints>;

template <class T>
using PerLimb = std::array<T, kLimbs>;

/// A rigid pose: x_parent = rotation · x_child + position.
struct Pose {
  Matrix3 rotation = Matrix3::Identity();
  Vector3 position_m = Vector3::Zero();

  Pose operator*(const Pose& child) const {
    return {rotation * child.rotation, rotation * child.position_m + position_m};
  }
  Vector3 operator*(const Vector3& point_m) const { return rotation * point_m + position_m; }
  Pose inverse() const { return {rotation.transpose(), -(rotation.transpose() * position_m)}; }
};

/// A force [N] and the moment [Nm] about a point that the context names.
struct Wrench {
  Vector3 force_N = Vector3::Zero();
  Vector3 moment_Nm = Vector3::Zero();

  Wrench operator+(const Wrench& o) const { return {force_N + o.force_N, moment_Nm + o.moment_Nm}; }
  Wrench operator-(const Wrench& o) const { return {force_N - o.force_N, moment_Nm - o.moment_Nm}; }
  Wrench operator*(double scale) const { return {force_N * scale, moment_Nm * scale}; }
};

/// s(x) = 3x² − 2x³ with x clipped to [0, 1]: the blend of msgs/PLAN.md.
double smoothstep(double x);

/// Matrix of the cross product: skew(a)·b = a × b.
Matrix3 skew(const Vector3& a);

/// Rotation by the rotation vector `v_rad` (axis times angle).
Matrix3 rotation_exp(const Vector3& v_rad);

/// Rotation vector [rad] of R, angle in [0, π].
Vector3 rotation_log(const Matrix3& rotation);

/// R = Rz(yaw)·Ry(pitch)·Rx(roll), W <- B.
Matrix3 rotation_from_rpy(const Vector3& rpy_rad);

/// Rotation about z.
Matrix3 rotation_z(double yaw_rad);

/// R = exp(tilt) Rz(yaw), W <- gripper: `tilt_rad` is a rotation vector about W's x and y, none for an upright gripper.
Matrix3 gripper_rotation(double yaw_rad, const Eigen::Vector2d& tilt_rad);

/// The unit quaternion (w, x, y, z) of R with w >= 0.
std::array<double, 4> quaternion_wxyz(const Matrix3& rotation);

/// Into three numbers of a message.
inline void copy(const Vector3& from, double* to) { std::copy_n(from.data(), 3, to); }

/// `v` shortened to `limit` where it is longer.
Vector3 clamped_norm(const Vector3& v, double limit);

/// R with rounding errors of its columns removed (Gram-Schmidt), so that products of many small turns stay rotations.
Matrix3 orthonormalised(const Matrix3& rotation);

}  // namespace crux
