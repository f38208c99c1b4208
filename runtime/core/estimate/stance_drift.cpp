// Slow motions in the rigid fit of the stance: holds that give way, and encoders that drift.
#include <algorithm>
#include <cmath>

#include "core/estimate/stance_fit.hpp"

namespace crux {
namespace {

constexpr double kAlone = 0.5;   // the others are off each other by less than this share of what the odd limb moved
constexpr double kLeast = 3.0;   // deviations: less is noise
constexpr double kSteady = 0.4;  // of the mean: the least that it moves on in a quarter of the time

}  // namespace

void StanceFit::remember(const PerLimb<FittedLimb>& limbs) noexcept {
  far_now_ = (far_now_ + 1) % kFarPast;
  far_known_ = std::min(far_known_ + 1, kFarPast);
  for (int l = 0; l < kLimbs; ++l)
    limbs_[l].far_past[far_now_] = {limbs_[l].path, limbs[l].state->gripper_B.position_m, limbs[l].force_B_N};
}

PerLimb<StanceFit::Word> StanceFit::far_words(int older, int newer, const PerLimb<bool>& counted) const noexcept {
  PerLimb<Word> words;
  const int to = (far_now_ + kFarPast - newer) % kFarPast, from = (far_now_ + kFarPast - older) % kFarPast;
  for (int l = 0; l < kLimbs; ++l) {
    const Standing& limb = limbs_[l];
    if (counted[l])
      words[l] =
          word(limb, limb.far_past[to].path - limb.far_past[from].path, information(limb, (older - newer) * kSampled));
  }
  return words;
}

bool StanceFit::moved_on(int limb, int window, const Row& left, const PerLimb<bool>& counted) const noexcept {
  Row along;
  along << left.head<3>() / std::pow(parameters_.shift_sigma_m, 2),
      left.tail<3>() / std::pow(parameters_.turn_sigma_rad, 2);
  const int quarter = kSamples[window] / kQuarters;
  for (int q = 0; q < kQuarters; ++q) {
    const Row part = fit_without(limb, far_words((q + 1) * quarter, q * quarter, counted)).left;
    if (part.dot(along) * kQuarters < kSteady * left.dot(along)) return false;
  }
  return true;
}

void StanceFit::look_far_back(int window) noexcept {
  const int samples = kSamples[window];
  Drift& drift = drifts_[window];
  drift = {};
  if (far_known_ <= samples) return;
  PerLimb<bool> counted{};
  double travel_m = 0.0, load_N = 0.0;
  for (int l = 0; l < kLimbs; ++l) {
    const Standing& limb = limbs_[l];
    counted[l] = limb.holds && limb.cycles > (samples + 1) * kSampled;
    const Sample& now = limb.far_past[far_now_];
    for (int q = 1; q <= kQuarters && counted[l]; ++q) {
      const Sample& then = limb.far_past[(far_now_ + kFarPast - q * samples / kQuarters) % kFarPast];
      travel_m = std::max(travel_m, (now.gripper_B_m - then.gripper_B_m).norm());
      load_N = std::max(load_N, (now.force_B_N - then.force_B_N).norm());
    }
  }
  Fit fit;
  const int odd = odd_one(far_words(samples, 0, counted), fit);
  if (odd < 0) return;
  const double moved = std::hypot(fit.left.head<3>().norm() / parameters_.shift_sigma_m,
                                  fit.left.tail<3>().norm() / parameters_.turn_sigma_rad);
  drift.limb = odd;
  drift.steady = moved >= kLeast && std::sqrt(fit.rest) <= kAlone * moved && moved_on(odd, window, fit.left, counted);
  drift.travel_m = travel_m;
  drift.load_N = load_N;
  explain(limbs_[odd], in_gripper(limbs_[odd], fit.left), drift);
  // A joint without torque goes through its play as slowly.
  if (drift.joint >= 0 && limbs_[odd].idle_cycles_ago[drift.joint] < samples * kSampled) drift.steady = false;
}

/// A hold that gives way moves its gripper and does not turn it; an encoder that drifts seems to move and turn it as
/// its joint would. The better one of them, by least squares over their deviations.
void StanceFit::explain(const Standing& limb, const Misfit& off, Drift& drift) const noexcept {
  Row row, deviation;
  row << off.shift_G_m, off.turn_G_rad;
  deviation << Vector3::Constant(parameters_.shift_sigma_m), Vector3::Constant(parameters_.turn_sigma_rad);
  row = row.cwiseQuotient(deviation);
  drift.shift_G_m = off.shift_G_m;
  double explained = row.head<3>().squaredNorm();
  for (int j = 0; j < kJoints; ++j) {
    const Row by_joint = limb.joints_G.col(j).cwiseQuotient(deviation);
    const double along = by_joint.dot(row), size = by_joint.squaredNorm();
    if (along * along <= explained * size) continue;
    explained = along * along / size;
    drift.joint = j;
    drift.joint_rad = along / size;
  }
}

}  // namespace crux
