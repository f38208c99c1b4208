#include "core/loads/wrench_distribution.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>

#include "core/loads/grasp_force.hpp"

namespace crux {
namespace {

// Keeps the normal matrix regular when too few limbs bear load; 1e-9 of its size does not show in the balance.
constexpr double kRegularisation = 1e-9;
constexpr double kInCone_N = 1e-9;  // a force so near to its cone counts as in it
constexpr int kRounds = 10;         // of projections on cones and balance in turn

/// Plans `wrenches` for the bearers, those of feet within their cones; false where all were.
bool put_in_cones(PerLimb<Bearer>& bearers, const PerLimb<Wrench>& wrenches) noexcept {
  bool beyond = false;
  for (int l = 0; l < kLimbs; ++l) {
    Bearer& bearer = bearers[l];
    bearer.planned_W = wrenches[l];
    if (!bearer.foot.stands || bearer.load <= 0.0) continue;
    const Vector3 nearest_N = bearer.foot.nearest_W_N(wrenches[l].force_N);
    beyond = beyond || (nearest_N - wrenches[l].force_N).norm() > kInCone_N;
    bearer.planned_W.force_N = nearest_N;
  }
  return beyond;
}

}  // namespace

Vector3 FootCone::nearest_W_N(const Vector3& force_W_N) const noexcept {
  const double normal_N = normal_W.dot(force_W_N);
  const Vector3 along_N = force_W_N - normal_N * normal_W;
  const double size_N = along_N.norm();
  const double on_cone_N = (normal_N + friction * size_N) / (1.0 + friction * friction);
  const bool inside = size_N <= friction * normal_N;
  const double pressed_N = std::clamp(inside ? normal_N : on_cone_N, 0.0, max_normal_N);
  const double share = size_N > 0.0 ? std::min(friction * pressed_N / size_N, 1.0) : 0.0;
  return pressed_N * normal_W + share * along_N;
}

double FootCone::utilisation(const Vector3& force_W_N) const noexcept {
  const double normal_N = normal_W.dot(force_W_N);
  const double along_N = (force_W_N - normal_N * normal_W).norm();
  const double bearable_N = friction * std::max(normal_N, 0.0);
  return along_N < kMostUtilisation * bearable_N ? along_N / bearable_N : kMostUtilisation;
}

PerLimb<Wrench> balanced_wrenches(const PerLimb<Bearer>& limbs, const Vector3& com_W_m, const Vector3& weight_W_N,
                                  double twist_length_m) noexcept {
  PerLimb<Wrench> wrenches;
  // Grasp map of (force, twist / twist_length) to the net wrench about the centre of mass.
  PerLimb<Eigen::Matrix<double, 6, 4>> map;
  Matrix6 normal = Matrix6::Zero();
  Vector6 missing;
  missing << -weight_W_N, Vector3::Zero();
  for (int l = 0; l < kLimbs; ++l) {
    const Bearer& limb = limbs[l];
    if (limb.load <= 0.0) continue;
    const Vector3 arm = limb.position_W_m - com_W_m;
    map[l].topLeftCorner<3, 3>().setIdentity();
    map[l].bottomLeftCorner<3, 3>() = skew(arm);
    map[l].col(3) << Vector3::Zero(), twist_length_m * limb.finger_axis_W;
    if (!limb.fixed) normal += limb.load * map[l] * map[l].transpose();
    wrenches[l] = limb.planned_W;
    missing.head<3>() -= limb.planned_W.force_N;
    missing.tail<3>() -= arm.cross(limb.planned_W.force_N) + limb.planned_W.moment_Nm;
  }
  normal += kRegularisation * (normal.trace() + 1.0) * Matrix6::Identity();
  const Vector6 multiplier = normal.ldlt().solve(missing);
  for (int l = 0; l < kLimbs; ++l) {
    if (limbs[l].load <= 0.0 || limbs[l].fixed) continue;
    const Eigen::Vector4d share = limbs[l].load * (map[l].transpose() * multiplier);
    wrenches[l].force_N += share.head<3>();
    wrenches[l].moment_Nm += share[3] * twist_length_m * limbs[l].finger_axis_W;
  }
  return wrenches;
}

PerLimb<Wrench> within_cones(const PerLimb<Wrench>& wrenches, const PerLimb<Bearer>& limbs, const Vector3& com_W_m,
                             const Vector3& weight_W_N, double twist_length_m) noexcept {
  PerLimb<Wrench> within = wrenches;
  PerLimb<Bearer> bearers = limbs;
  // In turn into the cones and back into balance: so feet make good for each other what they can.
  for (int round = 0; round < kRounds && put_in_cones(bearers, within); ++round)
    within = balanced_wrenches(bearers, com_W_m, weight_W_N, twist_length_m);
  // What is left the others bear.
  for (int feet = 0; feet < kLimbs; ++feet) {
    bool beyond = false;
    for (int l = 0; l < kLimbs; ++l) {
      Bearer& foot = bearers[l];
      if (!foot.foot.stands || foot.fixed || foot.load <= 0.0) continue;
      const Vector3 nearest_N = foot.foot.nearest_W_N(within[l].force_N);
      if ((nearest_N - within[l].force_N).norm() <= kInCone_N) continue;
      foot.planned_W = {nearest_N, Vector3::Zero()};
      foot.fixed = beyond = true;
    }
    if (!beyond) break;
    within = balanced_wrenches(bearers, com_W_m, weight_W_N, twist_length_m);
  }
  return within;
}

void share_along_plane(const PerLimb<Vector3>& foot_W_m, PerLimb<Wrench>& wrenches) noexcept {
  PerLimb<double> weight{};
  double total = 0.0;
  Vector3 centre_W_m = Vector3::Zero();
  for (int l = 0; l < kLimbs; ++l) {
    weight[l] = std::max(wrenches[l].force_N.z(), 0.0);
    total += weight[l];
    centre_W_m += weight[l] * foot_W_m[l];
  }
  if (total <= 0.0) return;
  centre_W_m /= total;
  // About the centre of the weights the least forces are a push that all share and a turn that grows with the distance.
  Vector3 push_N = Vector3::Zero();
  double turn_Nm = 0.0, inertia_m2 = 0.0;
  for (int l = 0; l < kLimbs; ++l) {
    const Vector3 arm = foot_W_m[l] - centre_W_m;
    push_N += wrenches[l].force_N;
    turn_Nm += arm.cross(wrenches[l].force_N).z();
    inertia_m2 += weight[l] * arm.head<2>().squaredNorm();
  }
  if (inertia_m2 <= kRegularisation * total) return;  // a single foot bears all: nothing to share
  for (int l = 0; l < kLimbs; ++l) {
    const Vector3 arm = foot_W_m[l] - centre_W_m;
    const Vector3 force_N = weight[l] * (push_N / total + turn_Nm / inertia_m2 * Vector3::UnitZ().cross(arm));
    wrenches[l].force_N.head<2>() = force_N.head<2>();
  }
}

}  // namespace crux
