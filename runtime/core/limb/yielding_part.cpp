#include "core/limb/yielding_part.hpp"

#include <Eigen/Cholesky>

namespace crux {
namespace {

constexpr double kSingular = 1e-9;  // of the largest diagonal element, added to all

}  // namespace

Wrench yielding_part(const LimbState& limb, const Wrench& wrench_B, const AdmittanceParameters& gains) noexcept {
  Vector6 damping, wrench;
  damping << Vector3::Constant(gains.damping_Ns_m), Vector3::Constant(gains.rotational_damping_Nms_rad);
  wrench << wrench_B.force_N, wrench_B.moment_Nm;
  const LimbJacobian damped = damping.asDiagonal() * limb.jacobian_B;
  JointMatrix of_joints = limb.jacobian_B.transpose() * damped;
  of_joints.diagonal().array() += kSingular * of_joints.diagonal().maxCoeff();
  const JointVector torque_Nm = limb.jacobian_B.transpose() * wrench;
  const Vector6 part = damped * of_joints.llt().solve(torque_Nm);
  return {part.head<3>(), part.tail<3>()};
}

}  // namespace crux
