#include "core/inverse_kinematics.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

// Length that makes a rotation comparable with a displacement: about the size of a gripper.
constexpr double kRotationLength_m = 0.1;
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

Vector6 pose_error(const Pose& target, const Pose& actual) {
  Vector6 error;
  error.head<3>() = target.position_m - actual.position_m;
  error.tail<3>() = rotation_log(target.rotation * actual.rotation.transpose());
  return error;
}

}  // namespace

InverseKinematics::InverseKinematics(const LimbDescription& limb, LimbKinematics& kinematics)
    : limits_(limb.joints), kinematics_(kinematics) {}

IkResult InverseKinematics::solve(const Pose& target_B, const JointVector& start_rad, int max_iterations) noexcept {
  IkResult result;
  result.q_rad = start_rad;
  JointVector lower, upper;
  for (int j = 0; j < kJoints; ++j) {
    lower[j] = limits_[j].lower_rad;
    upper[j] = limits_[j].upper_rad;
  }
  result.q_rad = result.q_rad.cwiseMax(lower).cwiseMin(upper);

  Pose gripper;
  Matrix6 jacobian;
  Vector6 error;
  for (int iteration = 0;; ++iteration) {
    kinematics_.evaluate(result.q_rad, gripper, jacobian);
    error = pose_error(target_B, gripper);
    result.position_error_m = error.head<3>().norm();
    result.rotation_error_rad = error.tail<3>().norm();
    const bool converged =
        result.position_error_m < kPositionTolerance_m && result.rotation_error_rad < kRotationTolerance_rad;
    if (converged || iteration == max_iterations) break;

    jacobian.bottomRows<3>() *= kRotationLength_m;
    error.tail<3>() *= kRotationLength_m;
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
      const Matrix6 normal = free * free.transpose() + kDamping_m * kDamping_m * Matrix6::Identity();
      const JointVector step = free.transpose() * normal.llt().solve(rest);
      bool again = false;
      for (int j = 0; j < kJoints; ++j) {
        if (pinned[j]) continue;
        dq[j] = step[j];
        const double goal = result.q_rad[j] + dq[j];
        if (goal < lower[j] || goal > upper[j]) {
          dq[j] = std::clamp(goal, lower[j], upper[j]) - result.q_rad[j];
          pinned[j] = true;
          again = true;
        }
      }
      if (!again) break;
    }
    const double largest = dq.cwiseAbs().maxCoeff();
    if (largest > kMaxJointStep_rad) dq *= kMaxJointStep_rad / largest;
    result.q_rad = (result.q_rad + dq).cwiseMax(lower).cwiseMin(upper);
  }
  for (int j = 0; j < kJoints; ++j) {
    if (result.q_rad[j] <= lower[j] || result.q_rad[j] >= upper[j]) result.limited |= kIkPositionLimit;
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
    const double allowed = limits_[j].velocity_rad_s * dt_s;
    if (std::abs(dq[j]) > allowed) share = std::min(share, allowed / std::abs(dq[j]));
  }
  if (share < 1.0) {
    result.q_rad = last_command_rad + share * dq;
    result.limited |= kIkSpeedLimit;
  }
  return result;
}

}  // namespace crux
