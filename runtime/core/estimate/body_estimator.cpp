#include "core/estimate/body_estimator.hpp"

#include <Eigen/Cholesky>

namespace crux {
namespace {

// Share of the damping in the normal matrix, relative to its size: far below what three spread grippers contribute, far
// above rounding errors.
constexpr double kRelativeDamping = 1e-6;

// The body makes way fast against the admittance of a limb, and comes back slowly.
constexpr double kWay_1_s = 20.0, kWayBack_1_s = 0.2;

}  // namespace

const Pose& BodyEstimator::update(const PerLimb<Pose>& anchor_W, const PerLimb<Pose>& gripper_B,
                                  const PerLimb<double>& weight, const PerLimb<double>& lever_m,
                                  int iterations) noexcept {
  for (int iteration = 0; iteration < iterations; ++iteration) {
    Matrix6 normal = Matrix6::Zero();
    Vector6 gradient = Vector6::Zero();
    for (int l = 0; l < kLimbs; ++l) {
      if (weight[l] <= 0.0) continue;
      const Vector3 arm = body_W_.rotation * gripper_B[l].position_m;
      const Vector3 residual = anchor_W[l].position_m - body_W_.position_m - arm;
      Eigen::Matrix<double, 3, 6> jacobian;
      jacobian << Matrix3::Identity(), -skew(arm);
      normal += weight[l] * jacobian.transpose() * jacobian;
      gradient += weight[l] * jacobian.transpose() * residual;
      const double turn_weight = weight[l] * lever_m[l] * lever_m[l];
      if (turn_weight <= 0.0) continue;
      normal.bottomRightCorner<3, 3>() += turn_weight * Matrix3::Identity();
      gradient.tail<3>() +=
          turn_weight * rotation_log(anchor_W[l].rotation * (body_W_.rotation * gripper_B[l].rotation).transpose());
    }
    normal += kRelativeDamping * (normal.trace() + 1.0) * Matrix6::Identity();
    const Vector6 step = normal.ldlt().solve(gradient);
    body_W_.position_m += step.head<3>();
    body_W_.rotation = orthonormalised(rotation_exp(step.tail<3>()) * body_W_.rotation);
  }
  return body_W_;
}

void BodyCorrection::reset(const Pose& command_W, const Pose& reference_W) noexcept {
  way_m_.setZero();
  offset_m_ = clamped_norm(command_W.position_m - reference_W.position_m, max_offset_m_);
  rotation_rad_ = clamped_norm(rotation_log(command_W.rotation * reference_W.rotation.transpose()), max_rotation_rad_);
}

Pose BodyCorrection::command_W(const Pose& reference_W) const noexcept {
  return {rotation_exp(rotation_rad_) * reference_W.rotation, reference_W.position_m + way_m_ + offset_m_};
}

void BodyCorrection::rebase(const Pose& command_W, const Pose& reference_W) noexcept {
  const Vector3 way_m = way_m_;
  reset(command_W, {reference_W.rotation, reference_W.position_m + way_m});
  way_m_ = way_m;
}

void BodyCorrection::relocate(const Pose& motion, const Pose& reference_W) noexcept {
  rebase(motion * command_W(reference_W), reference_W);
}

void BodyCorrection::make_way(const Vector3& missed_W_m, double dt_s) noexcept {
  way_m_ = clamped_norm(way_m_ + dt_s * (kWay_1_s * missed_W_m - kWayBack_1_s * way_m_), kMaxWay_m);
}

Pose BodyCorrection::update(const Pose& reference_W, const Pose& estimate_W, double dt_s) noexcept {
  const double share = dt_s * gain_1_s_;
  const Vector3 turn = rotation_log(reference_W.rotation * estimate_W.rotation.transpose());
  offset_m_ =
      clamped_norm(offset_m_ + share * (reference_W.position_m + way_m_ - estimate_W.position_m), max_offset_m_);
  rotation_rad_ = clamped_norm(rotation_rad_ + share * turn, max_rotation_rad_);
  return command_W(reference_W);
}

}  // namespace crux
