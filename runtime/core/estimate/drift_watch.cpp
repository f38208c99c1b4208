#include "core/estimate/drift_watch.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace crux {
namespace {

// Shares of max_slip_m, in the first and the second window. By simulation a sound grip moves steadily by 0.05 of it at
// most in the first one while the robot stands, in motion by 0.9: with encoders homed 20 mrad wrong, or 10 mrad of
// play.
constexpr std::array<double, 2> kCreeps = {0.15, 0.2}, kDrifts = {0.08, 0.1};
constexpr double kSuspected = 0.2, kMoves = 0.03;
constexpr double kMoreWary = 0.5, kMostWary = 2.0;  // limit of suspicion: by each that was none, and at most
constexpr double kStands = 0.4;                     // of max_unbalanced_N: the load is steady
constexpr int kLooks = 10;                          // in a row before the plan has begun: pads and play settle first
constexpr double kWait_s = 1.4, kLongWait_s = 4.5;  // to stand, and for the first and the second window

}  // namespace

void DriftWatch::update(StanceFit& stance, const PerLimb<double>& compliance_m_N, bool counts, bool climbs,
                        double dt_s) noexcept {
  if (!counts || !climbs) suspected_ = -1;
  if (suspected_ < 0) waited_s_ = 0.0;
  if (!counts) return;
  if (stance.looked() >= 0) look(stance, compliance_m_N, climbs, dt_s);
  if (suspected_ < 0) return;
  waited_s_ += dt_s;
  if (waited_s_ < (moves_ ? kLongWait_s : kWait_s)) return;
  ++cleared_;
  suspected_ = -1;
  stance.forget_drift();
}

void DriftWatch::look(const StanceFit& stance, const PerLimb<double>& compliance_m_N, bool climbs,
                      double dt_s) noexcept {
  const int window = stance.looked();
  const StanceFit::Drift& drift = stance.drift(window);
  const double moved_m = drift.limb < 0 ? 0.0 : drift.shift_G_m.norm();
  if (window == 0) moves_ = moved_m > kMoves * parameters_.max_slip_m;
  if (!drift.steady && window == 0) looks_ = 0;
  if (!drift.steady) return;
  const bool stands =
      drift.travel_m < parameters_.slip_m + moved_m && drift.load_N < kStands * parameters_.max_unbalanced_N;
  const bool judged = window < static_cast<int>(kCreeps.size());
  if (stands && judged && moved_m > (drift.joint < 0 ? kCreeps : kDrifts)[window] * parameters_.max_slip_m) {
    if (told_.limb >= 0 || (!climbs && ++looks_ < kLooks)) return;
    const double within_s = StanceFit::kSamples[window] * StanceFit::kSampled * dt_s;
    told_ = {drift.limb, drift.joint, drift.joint < 0 ? moved_m : std::abs(drift.joint_rad), within_s};
    return;
  }
  const double wary = std::min(1.0 + kMoreWary * cleared_, kMostWary);
  const double gives_m = compliance_m_N[drift.limb] * drift.load_N;
  if (!climbs || suspected_ >= 0 || moved_m < kSuspected * wary * parameters_.max_slip_m + gives_m) return;
  suspected_ = drift.limb;
  waited_s_ = 0.0;
}

}  // namespace crux
