#include "core/estimate/weight_balance.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <limits>

namespace crux {
namespace {

constexpr double kArm_m = 0.3;         // weighs a moment against forces: about a gripper's distance from the body
constexpr double kExplained = 0.3;     // at most this share is left where a limb explains the change
constexpr double kNext = 2.0;          // and so many times that where another limb is tried,
constexpr double kNextAtLeast = 0.15;  // at least this share
constexpr double kDescribed_s = 1.5;   // the description counts as much as so long a weighing
constexpr double kSteady = 0.4;        // of max_unbalanced_N: nobody pushes
constexpr double kMostCarried = 0.25;  // of the weight

}  // namespace

void WeightBalance::update(const PerLimb<Wrench>& felt_W, const PerLimb<Vector3>& gripper_W_m, const Vector3& com_W_m,
                           const Vector3& weight_W_N, double dt_s) noexcept {
  sum_W_ = {weight_W_N, Vector3::Zero()};
  for (int l = 0; l < kLimbs; ++l) {
    sum_W_.force_N += felt_W[l].force_N;
    sum_W_.moment_Nm += (gripper_W_m[l] - com_W_m).cross(felt_W[l].force_N) + felt_W[l].moment_Nm;
  }
  Vector6 now;
  now << sum_W_.force_N, sum_W_.moment_Nm / kArm_m;
  if (!started_) learnt_ = now;
  started_ = true;
  learnt_ += dt_s / (parameters_.balance_memory_s + dt_s) * (now - learnt_);
  const Vector6 change = now - learnt_;
  change_N_ = change.norm();
  limb_ = change_N_ > parameters_.max_unbalanced_N ? blame(gripper_W_m, com_W_m, change) : -1;
}

void WeightBalance::weigh(const Vector3& weight_W_N, double dt_s) noexcept {
  const double weight_N = weight_W_N.norm();
  if (weight_N <= 0.0 || change_N_ > kSteady * parameters_.max_unbalanced_N) return;
  weighed_s_ = std::min(weighed_s_ + dt_s, parameters_.balance_memory_s);
  const double felt_N = -sum_W_.force_N.dot(weight_W_N) / weight_N;
  beyond_N_ += dt_s / (kDescribed_s + weighed_s_) * (felt_N - beyond_N_);
  carried_ = std::clamp((beyond_N_ - doubt_N_) / weight_N, 0.0, kMostCarried);
}

int WeightBalance::blame(const PerLimb<Vector3>& gripper_W_m, const Vector3& com_W_m,
                         const Vector6& change) const noexcept {
  double least = std::numeric_limits<double>::infinity(), next = least;
  int found = -1;
  for (int l = 0; l < kLimbs; ++l) {
    Eigen::Matrix<double, 6, 3> map;
    map << Matrix3::Identity(), skew(gripper_W_m[l] - com_W_m) / kArm_m;
    const Vector3 force_N = (map.transpose() * map).ldlt().solve(map.transpose() * change);
    const double left = (change - map * force_N).norm() / change.norm();
    if (left < least) {
      next = least;
      least = left;
      found = l;
    } else if (left < next) {
      next = left;
    }
  }
  return least < kExplained && next > std::max(kNext * least, kNextAtLeast) ? found : -1;
}

}  // namespace crux
