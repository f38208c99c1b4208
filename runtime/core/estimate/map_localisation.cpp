#include "core/estimate/map_localisation.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

// Measurements further off than this many standard deviations count as if they were so far off: a hold that is nowhere
// near its place must not pull the body along.
constexpr double kFarthest = 3.0;
// Corrections enter the estimate with this time constant, so that a swing that follows it does not jump.
constexpr double kBlend_s = 1.0;
// Forces that differ from the weight by more than this share are not the weight alone.
constexpr double kWeightTolerance = 0.25;
// Shorter looks at the forces say too little.
constexpr double kLeastLook_s = 1.0;
// Grippers touch the wall once the body's height is worse known than a hold's place by this factor. A gripper that
// reaches far ahead knows its own worse, and grips all the same.
constexpr double kUnsure = 1.5;

/// By what a point at `arm_W_m` from the body moves along `axis_W` with (t, θ).
Vector6 moved_along(const Vector3& axis_W, const Vector3& arm_W_m) noexcept {
  Vector6 direction;
  direction << axis_W, arm_W_m.cross(axis_W);
  return direction;
}

}  // namespace

void MapLocalisation::begin(const Vector3& body_W_m, const PerLimb<Vector3>& arm_W_m,
                            const PerLimb<bool>& on_hold) noexcept {
  // Least squares over points that are each known to σ: covariance σ²·(Σ JᵀJ)⁻¹ with J = [I, −skew(arm)].
  Matrix6 information = Matrix6::Zero();
  for (int l = 0; l < kLimbs; ++l) {
    if (!on_hold[l]) continue;
    Eigen::Matrix<double, 3, 6> jacobian;
    jacobian << Matrix3::Identity(), -skew(arm_W_m[l]);
    information += jacobian.transpose() * jacobian;
  }
  // Regular with two grippers too; one millionth of a point changes nothing.
  information += 1e-6 * Matrix6::Identity();
  covariance_ = std::pow(parameters_.hold_sigma_m, 2) * information.ldlt().solve(Matrix6::Identity());
  pending_.setZero();
  body_W_m_ = body_W_m;
  felt_.setZero();
  felt_s_ = 0.0;
}

void MapLocalisation::feel(const Vector3& force_W_N, const Vector3& weight_W_N, bool known, double dt_s) noexcept {
  weight_W_N_ = weight_W_N;
  const double weight_N = weight_W_N.norm();
  if (!known || std::abs(force_W_N.norm() - weight_N) > kWeightTolerance * weight_N) return;
  felt_ += dt_s * force_W_N;
  felt_s_ += dt_s;
}

void MapLocalisation::grasp(const Vector3& body_W_m, const Vector3& arm_W_m, const Vector3& axis_W,
                            double offset_m) noexcept {
  carry_to(body_W_m);
  covariance_.diagonal().head<3>().array() += std::pow(parameters_.grasp_sigma_m, 2);
  covariance_.diagonal().tail<3>().array() += std::pow(parameters_.grasp_sigma_rad, 2);
  take_tilt();
  // Truly the gripper is where the hold is: axis·(t + θ × arm) = −offset.
  take(moved_along(axis_W, arm_W_m), -offset_m, parameters_.hold_sigma_m);
}

void MapLocalisation::touch(const Vector3& body_W_m, const Vector3& arm_W_m, double offset_m) noexcept {
  carry_to(body_W_m);
  take(moved_along(Vector3::UnitZ(), arm_W_m), -offset_m, parameters_.hold_sigma_m);
}

bool MapLocalisation::unsure_of_height() const noexcept {
  return covariance_(2, 2) > std::pow(kUnsure * parameters_.hold_sigma_m, 2);
}

void MapLocalisation::carry_to(const Vector3& body_W_m) noexcept {
  // The same motion named by another point: t' = t + θ × (r' − r).
  Matrix6 move = Matrix6::Identity();
  move.topRightCorner<3, 3>() = -skew(body_W_m - body_W_m_);
  covariance_ = move * covariance_ * move.transpose();
  pending_ = move * pending_;
  body_W_m_ = body_W_m;
}

void MapLocalisation::take_tilt() noexcept {
  if (felt_s_ >= kLeastLook_s) {
    // Truly the forces point straight up: θ turns what was felt there, but for a turn about the vertical.
    const Vector3 up = -weight_W_N_.normalized();
    const Vector3 tilt_rad = felt_.normalized().cross(up);
    const Vector3 aside = up.unitOrthogonal();
    for (const Vector3& axis : {aside, Vector3(up.cross(aside))}) {
      Vector6 direction;
      direction << Vector3::Zero(), axis;
      take(direction, axis.dot(tilt_rad), parameters_.tilt_sigma_rad);
    }
  }
  felt_.setZero();
  felt_s_ = 0.0;
}

void MapLocalisation::take(const Vector6& direction, double value, double sigma) noexcept {
  const Vector6 spread = covariance_ * direction;
  const double variance = direction.dot(spread) + sigma * sigma;
  const double farthest = kFarthest * std::sqrt(variance);
  const double innovation = value - direction.dot(pending_), counted = std::clamp(innovation, -farthest, farthest);
  pending_ += spread * (counted / variance);
  // What counts for less than it says makes the estimate surer by as much less.
  const double share = innovation == counted ? 1.0 : counted / innovation;
  covariance_ -= spread * spread.transpose() * (share / variance);
}

Pose MapLocalisation::correction(const Vector3& body_W_m, double dt_s) noexcept {
  carry_to(body_W_m);
  const Vector6 due = dt_s / (kBlend_s + dt_s) * pending_;
  pending_ -= due;
  const Matrix3 turn = rotation_exp(due.tail<3>());
  felt_ = turn * felt_;
  return {turn, body_W_m + due.head<3>() - turn * body_W_m};
}

}  // namespace crux
