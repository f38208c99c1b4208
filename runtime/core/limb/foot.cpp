// What a limb shows of its foot on a foothold.
#include <algorithm>

#include "core/limb/limb_controller.hpp"

namespace crux {
namespace {

constexpr double kContactShare = 0.3;  // of its planned normal force, from which on a foot is in contact

}  // namespace

bool LimbController::stands_on_foot(const LimbReference& reference, double dt_s) noexcept {
  const double planned_N = reference.wrench_W.force_N.dot(reference.off_W());
  const bool loaded = reference.gripping() && reference.load >= 1.0;
  const double least_N =
      std::min(control_.contact_force_N, loaded ? kContactShare * std::max(planned_N, 0.0) : control_.contact_force_N);
  const bool touches = trusts_force_torque_ ? foot_force_N(reference) >= least_N : runs_against();
  stood_s_ = touches ? stood_s_ + dt_s : 0.0;
  return stood_s_ >= supervisor_.persistence_s;
}

}  // namespace crux
