#include "core/robot/inverse_kinematics.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

// Length that makes a rotation comparable with a displacement: about the size of a gripper.
constexpr double kRotationLength_m = 0.1;
constexpr double kDampingFactor = 5.0;
// Damping bounds joint steps near singularities: at a singular value equal to it a step is halved. Far below the limb's
// regular singular values (0.05..0.3 m), so that convergence stays quadratic in practice.
constexpr double kDamping_m = 2e-3;
constexpr double kPositionTolerance_m = 1e-7;
constexpr double kRotationTolerance_rad = 1e-6;
// What counts as not having converged: well below what the control loop could notice.
constexpr double kPositionFailure_m = 1e-4;
constexpr double kRotationFailure_rad = 1e-3;
// The linearisation is trusted no further than this.
constexpr double kMaxJointStep_rad = 0.3;
constexpr int kIterationsPerCycle = 4;

/// Position error and rotation error times kRotationLength_m.
Vector6 weighted_error(const Pose& target, const Pose& actual) {
  Vector6 error;
  error.head<3>() = target.position_m - actual.position_m;
  error.tail<3>() = kRotationLength_m * rotation_log(target.rotation * actual.rotation.transpose());
  return error;
}

bool small(const Vector6& error) {
  return error.head<3>().norm() < kPositionTolerance_m &&
         error.tail<3>().norm() < kRotationTolerance_rad * kRotationLength_m;
}

}  // namespace

InverseKinematics::InverseKinematics(const LimbDescription& limb, LimbKinematics& kinematics)
    : kinematics_(kinematics) {
  for (int j = 0; j < kJoints; ++j) {
    lower_rad_[j] = limb.joints[j].lower_rad;
    upper_rad_[j] = limb.joints[j].upper_rad;
    velocity_rad_s_[j] = limb.joints[j].velocity_rad_s;
  }
}

JointVector InverseKinematics::damped_step(const Matrix6& jacobian, const Vector6& error, const JointVector& q_rad,
                                           double damping) const noexcept {
  JointVector dq = JointVector::Zero();
  // A joint that would leave its range is pinned to the limit and the rest solved again: at most all six.
  Eigen::Matrix<bool, kJoints, 1> pinned = Eigen::Matrix<bool, kJoints, 1>::Constant(false);
  for (int pass = 0; pass <= kJoints; ++pass) {
    Matrix6 free = jacobian;
    Vector6 rest = error;
    for (int j = 0; j < kJoints; ++j) {
      if (!pinned[j]) continue;
      rest -= jacobian.col(j) * dq[j];
      free.col(j).setZero();
    }
    const Matrix6 normal = free * free.transpose() + damping * damping * Matrix6::Identity();
    const JointVector step = free.transpose() * normal.llt().solve(rest);
    bool again = false;
    for (int j = 0; j < kJoints; ++j) {
      if (pinned[j]) continue;
      dq[j] = step[j];
      const double inside = std::clamp(q_rad[j] + dq[j], lower_rad_[j], upper_rad_[j]);
      if (inside == q_rad[j] + dq[j]) continue;
      dq[j] = inside - q_rad[j];
      pinned[j] = true;
      again = true;
    }
    if (!again) break;
  }
  const double largest = dq.cwiseAbs().maxCoeff();
  return largest > kMaxJointStep_rad ? JointVector(dq * (kMaxJointStep_rad / largest)) : dq;
}

IkResult InverseKinematics::solve(const Pose& target_B, const JointVector& start_rad, int max_iterations) noexcept {
  // Levenberg-Marquardt: a step that does not bring the gripper nearer is taken back and damped more.
  double damping = kDamping_m;
  Pose gripper;
  Matrix6 jacobian, jacobian_there;
  JointVector q_rad = start_rad.cwiseMax(lower_rad_).cwiseMin(upper_rad_);
  kinematics_.evaluate(q_rad, gripper, jacobian);
  Vector6 error = weighted_error(target_B, gripper);
  for (int iteration = 0; iteration < max_iterations && !small(error); ++iteration) {
    jacobian.bottomRows<3>() *= kRotationLength_m;
    const JointVector dq = damped_step(jacobian, error, q_rad, damping);
    const JointVector there_rad = (q_rad + dq).cwiseMax(lower_rad_).cwiseMin(upper_rad_);
    kinematics_.evaluate(there_rad, gripper, jacobian_there);
    const Vector6 error_there = weighted_error(target_B, gripper);
    if (error_there.squaredNorm() < error.squaredNorm()) {
      q_rad = there_rad;
      error = error_there;
      jacobian = jacobian_there;
      damping = std::max(damping / kDampingFactor, kDamping_m);
    } else {
      jacobian.bottomRows<3>() /= kRotationLength_m;
      damping *= kDampingFactor;
    }
  }
  IkResult result;
  result.q_rad = q_rad;
  result.missed_B_m = error.head<3>();
  result.position_error_m = result.missed_B_m.norm();
  result.rotation_error_rad = error.tail<3>().norm() / kRotationLength_m;
  if ((q_rad.array() <= lower_rad_.array()).any() || (q_rad.array() >= upper_rad_.array()).any()) {
    result.limited |= kIkPositionLimit;
  }
  if (result.position_error_m > kPositionFailure_m || result.rotation_error_rad > kRotationFailure_rad) {
    result.limited |= kIkNoConvergence;
  }
  return result;
}

IkResult InverseKinematics::step(const Pose& target_B, const JointVector& last_command_rad, double dt_s) noexcept {
  IkResult result = solve(target_B, last_command_rad, kIterationsPerCycle);
  double share = 1.0;
  const JointVector dq = result.q_rad - last_command_rad;
  for (int j = 0; j < kJoints; ++j) {
    const double allowed = velocity_rad_s_[j] * dt_s;
    if (std::abs(dq[j]) > allowed) share = std::min(share, allowed / std::abs(dq[j]));
  }
  if (share < 1.0) {
    result.q_rad = last_command_rad + share * dq;
    result.limited |= kIkSpeedLimit;
  }
  return result;
}

}  // namespace crux
