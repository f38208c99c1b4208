#include "core/stand_up.hpp"

#include <algorithm>
#include <limits>

namespace crux {
namespace {

// Less than that off its plan a body is not said to hang.
constexpr double kLeast_m = 0.02, kLeast_rad = 0.1;
constexpr double kSpeed_m_s = 0.02, kRate_rad_s = 0.1;
constexpr double kMostMissed_m = 0.002, kMoreMissed_m = 0.0005;

}  // namespace

void StandUp::begin(const Pose& body_W, const Pose& reference_W) noexcept {
  *this = {};
  least_missed_m_.fill(std::numeric_limits<double>::infinity());
  offset_m_ = body_W.position_m - reference_W.position_m;
  turn_rad_ = rotation_log(body_W.rotation * reference_W.rotation.transpose());
  const double way_m = offset_m_.norm(), angle_rad = turn_rad_.norm();
  if (!(way_m > kLeast_m || angle_rad > kLeast_rad)) return;
  left_ = 1.0;
  speed_1_s_ = 1.0 / std::max(way_m / kSpeed_m_s, angle_rad / kRate_rad_s);
}

bool StandUp::follows(int limb, double missed_m) noexcept {
  double& least_m = least_missed_m_[limb];
  least_m = std::min(least_m, missed_m);
  return missed_m <= std::max(kMostMissed_m, least_m + kMoreMissed_m);
}

void StandUp::advance(bool may, double dt_s) noexcept {
  if (!rises()) return;
  waited_s_ = may ? 0.0 : waited_s_ + dt_s;
  if (may) left_ = std::max(left_ - dt_s * speed_1_s_, 0.0);
}

Pose StandUp::below(const Pose& reference_W) const noexcept {
  if (!rises()) return reference_W;
  return {rotation_exp(left_ * turn_rad_) * reference_W.rotation, reference_W.position_m + left_ * offset_m_};
}

}  // namespace crux
