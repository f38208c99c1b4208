#include "core/robot/inverse_kinematics.hpp"

#include <Eigen/Cholesky>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

// Length that makes a rotation comparable with a displacement: about the size of a gripper.
constexpr double kRotationLength_m = 0.1;
// What an angle off along the spare way counts: little, so that a joint at its limit costs it and not the gripper's
// pose.
constexpr double kSpareLength_m = 0.02;
// A limb that begins off its angles of a pose comes to them no faster than so, while it holds the robot.
constexpr double kSpareRate_rad_s = 0.2;
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

static_assert(kJoints == kPlacing + 1, "one way is spare at most");

bool small(const JointVector& errors) {
  return errors.head<3>().norm() < kPositionTolerance_m &&
         errors.segment<3>(3).norm() < kRotationTolerance_rad * kRotationLength_m &&
         std::abs(errors[kPlacing]) < kRotationTolerance_rad * kSpareLength_m;
}

}  // namespace

InverseKinematics::InverseKinematics(const LimbDescription& limb, LimbKinematics& kinematics)
    : limits_(limb), turns_(limb.turns()), kinematics_(kinematics) {
  if (turns_ < kJoints) return;
  JointVector middle_rad;
  for (int j = 0; j < kJoints; ++j) middle_rad[j] = (limb.joints[j].lower_rad + limb.joints[j].upper_rad) / 2.0;
  Pose gripper;
  LimbJacobian jacobian;
  kinematics_.evaluate(middle_rad, gripper, jacobian);
  spare_ = Eigen::JacobiSVD<LimbJacobian>(jacobian, Eigen::ComputeFullV).matrixV().col(kPlacing);
  spare_rad_ = spare_.dot(middle_rad);
}

void InverseKinematics::evaluate(const JointVector& q_rad, const Target& target, Linear& here) noexcept {
  Pose gripper;
  LimbJacobian of_gripper;
  kinematics_.evaluate(q_rad, gripper, of_gripper);
  here.errors << weighted_error(target.gripper_B, gripper), kSpareLength_m * (target.spare_rad - spare_.dot(q_rad));
  here.jacobian << of_gripper.topRows<3>(), kRotationLength_m * of_gripper.bottomRows<3>(),
      kSpareLength_m * spare_.transpose();
}

JointVector InverseKinematics::damped_step(const Linear& here, const JointVector& q_rad, double damping,
                                           const JointVector& lower_rad, const JointVector& upper_rad) const noexcept {
  JointVector dq = JointVector::Zero();
  // A joint that would leave its range is pinned to the limit and the rest solved again: at most all of them.
  Eigen::Matrix<bool, kJoints, 1> pinned = Eigen::Matrix<bool, kJoints, 1>::Constant(false);
  for (int pass = 0; pass <= turns_; ++pass) {
    JointMatrix free = here.jacobian;
    Errors rest = here.errors;
    for (int j = 0; j < turns_; ++j) {
      if (!pinned[j]) continue;
      rest -= here.jacobian.col(j) * dq[j];
      free.col(j).setZero();
    }
    const JointMatrix normal = free * free.transpose() + damping * damping * JointMatrix::Identity();
    const JointVector step = free.transpose() * normal.llt().solve(rest);
    bool again = false;
    for (int j = 0; j < turns_; ++j) {
      if (pinned[j]) continue;
      dq[j] = step[j];
      const double inside = std::clamp(q_rad[j] + dq[j], lower_rad[j], upper_rad[j]);
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

JointVector InverseKinematics::stepped(const Linear& here, const JointVector& q_rad, double damping) const noexcept {
  const auto within = [&](const JointVector& lower_rad, const JointVector& upper_rad) {
    const JointVector dq = damped_step(here, q_rad, damping, lower_rad, upper_rad);
    return JointVector((q_rad + dq).cwiseMax(lower_rad).cwiseMin(upper_rad));
  };
  JointVector there_rad = within(limits_.lower_rad, limits_.upper_rad);
  if (limits_.holds(there_rad)) return there_rad;
  JointVector lower_rad, upper_rad;
  limits_.edges(q_rad, lower_rad, upper_rad);
  return limits_.as_far(q_rad, within(lower_rad, upper_rad));
}

IkResult InverseKinematics::solve(const Pose& target_B, const JointVector& start_rad, int max_iterations) noexcept {
  return solve(Target{target_B, spare_rad_}, start_rad, max_iterations);
}

IkResult InverseKinematics::solve(const Target& target, const JointVector& start_rad, int max_iterations) noexcept {
  // Levenberg-Marquardt: a step that does not bring the gripper nearer is taken back and damped more.
  double damping = kDamping_m;
  Linear here, there;
  JointVector q_rad = limits_.inside(start_rad);
  evaluate(q_rad, target, here);
  for (int iteration = 0; iteration < max_iterations && !small(here.errors); ++iteration) {
    const JointVector there_rad = stepped(here, q_rad, damping);
    evaluate(there_rad, target, there);
    if (there.errors.squaredNorm() < here.errors.squaredNorm()) {
      q_rad = there_rad;
      here = there;
      damping = std::max(damping / kDampingFactor, kDamping_m);
    } else {
      damping *= kDampingFactor;
    }
  }
  IkResult result;
  result.q_rad = q_rad;
  result.missed_B_m = here.errors.head<3>();
  result.position_error_m = result.missed_B_m.norm();
  result.rotation_error_rad = here.errors.segment<3>(3).norm() / kRotationLength_m;
  if (limits_.at_an_end(q_rad)) result.limited |= kIkPositionLimit;
  if (result.position_error_m > kPositionFailure_m || result.rotation_error_rad > kRotationFailure_rad) {
    result.limited |= kIkNoConvergence;
  }
  return result;
}

IkResult InverseKinematics::step(const Pose& target_B, const JointVector& last_command_rad, double dt_s) noexcept {
  const double spare_rad = spare_.dot(last_command_rad), most_rad = kSpareRate_rad_s * dt_s;
  const Target target{target_B, std::clamp(spare_rad_, spare_rad - most_rad, spare_rad + most_rad)};
  IkResult result = solve(target, last_command_rad, kIterationsPerCycle);
  const JointVector dq = result.q_rad - last_command_rad;
  const double share = limits_.speed_share(dq, last_command_rad, dt_s);
  if (share < 1.0) {
    result.q_rad = last_command_rad + share * dq;
    result.limited |= kIkSpeedLimit;
  }
  return result;
}

}  // namespace crux
