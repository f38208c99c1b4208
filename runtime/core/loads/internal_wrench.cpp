#include "core/loads/internal_wrench.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

namespace crux {
namespace {

constexpr double kRidge = 1e-12;

}  // namespace

PerLimb<Wrench> internal_errors(const PerLimb<Wrench>& errors, const PerLimb<Vector3>& position_W_m,
                                const PerLimb<double>& load, const Vector3& com_W_m, double moment_length_m) noexcept {
  Matrix6 normal = Matrix6::Zero();
  Vector6 net = Vector6::Zero();
  const double moment_weight = moment_length_m * moment_length_m;
  for (int l = 0; l < kLimbs; ++l) {
    if (load[l] <= kBearingLoad) continue;
    const Vector3 arm = position_W_m[l] - com_W_m;
    const Matrix3 cross = skew(arm);
    normal.topLeftCorner<3, 3>() += load[l] * Matrix3::Identity();
    normal.topRightCorner<3, 3>() += load[l] * cross.transpose();
    normal.bottomLeftCorner<3, 3>() += load[l] * cross;
    normal.bottomRightCorner<3, 3>() += load[l] * (cross * cross.transpose() + moment_weight * Matrix3::Identity());
    net.head<3>() += errors[l].force_N;
    net.tail<3>() += arm.cross(errors[l].force_N) + errors[l].moment_Nm;
  }
  normal += kRidge * (normal.trace() + 1.0) * Matrix6::Identity();
  const Vector6 multiplier = normal.ldlt().solve(net);
  PerLimb<Wrench> internal = errors;
  for (int l = 0; l < kLimbs; ++l) {
    if (load[l] <= kBearingLoad) continue;
    const Vector3 arm = position_W_m[l] - com_W_m;
    internal[l].force_N -= load[l] * (multiplier.head<3>() + multiplier.tail<3>().cross(arm));
    internal[l].moment_Nm -= load[l] * moment_weight * multiplier.tail<3>();
  }
  return internal;
}

}  // namespace crux
