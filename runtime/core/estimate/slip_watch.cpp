#include "core/estimate/slip_watch.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace crux {
namespace {

/// Of each window of the fit: a way is that of a slip from floor + gain · play on, at most from `most` on. `floor` and
/// `most` in slip_m.
struct Threshold {
  double floor, gain, most;
};
constexpr std::array<Threshold, StanceFit::kWindows> kThresholds = {
    {{0.3, 1.0, 1.0}, {0.4, 1.5, 2.0}, {0.2, 1.5, 4.0}}};

constexpr double kAsEver = 0.9;         // of the most its friction was used before: the grip may be used up
constexpr double kSlides = 0.7;         // of what it slides with: used less than that it stands
constexpr double kBarely = 0.1;         // used less than that no grip slips that has not slipped before
constexpr int kBlockCycles = 50;        // in which what is used is no past yet
constexpr double kWitnessed_s = 0.004;  // longer than a reading that is wrong once
constexpr double kStill_m = 0.0003;     // moves less than that: it stands
constexpr double kGivenOff = 0.05;      // share of its load that is left to a gripper whose hold gives way
constexpr double kUnload_s = 0.1, kReload_s = 0.5;

/// Along the faces, and of a pad's rim by a turn on them.
Vector3 way_m(const StanceFit::Moved& moved) noexcept {
  const Eigen::Vector2d along_m = moved.alone ? moved.way_m : Eigen::Vector2d(0.0, 0.0);
  return {along_m.x(), along_m.y(), moved.turns_alone ? moved.turn_m : 0.0};
}

}  // namespace

/// The second witness: friction is used as much as ever since contact, which did not slip.
void SlipWatch::look_at_grip(double used) noexcept {
  const bool used_up = used > (slipped_at_ > 0.0 ? 0.0 : kBarely) && used >= kAsEver * most_used_;
  used_up_cycles_ago_ = used_up ? 0 : std::min(used_up_cycles_ago_ + 1, 2 * StanceFit::kCycles.back());
  if (used_up) used_up_at_ = used;
  if (!slips_) lately_used_ = std::max(lately_used_, used);
  if (++block_cycles_ < kBlockCycles) return;
  block_cycles_ = 0;
  most_used_ = std::max(most_used_, std::exchange(block_used_, lately_used_));
  lately_used_ = 0.0;
}

/// The window in which the gripper moves further than play explains, `witnessed`: and its grip was used up, or it moves
/// as far as no slip may; -1: none.
int SlipWatch::window_of_motion(int limb, const StanceFit& stance, bool witnessed) const noexcept {
  for (int window = 0; window < StanceFit::kWindows; ++window) {
    const StanceFit::Moved& moved = stance.moved(window);
    const auto& [floor, gain, most] = kThresholds[window];
    const auto beyond = [&, floor = floor, gain = gain, most = most](double way_m, double play_m) {
      return way_m > std::min(floor * parameters_.slip_m + gain * play_m, most * parameters_.slip_m);
    };
    const double way_m = moved.alone ? moved.way_m.norm() : 0.0;
    const double turn_m = moved.turns_alone ? std::abs(moved.turn_m) : 0.0;
    const bool moves = beyond(way_m, stance.play_m()) || beyond(turn_m, stance.play_of_rim_m());
    const bool far = std::max(way_m, turn_m) > parameters_.max_slip_m;
    const bool used_up = used_up_cycles_ago_ < StanceFit::kCycles[window];
    if (moved.limb == limb && moves && (!witnessed || used_up || far)) return window;
  }
  return -1;
}

void SlipWatch::update(int limb, const StanceFit& stance, bool holds, double used, double dt_s) noexcept {
  if (!holds) {
    *this = SlipWatch(parameters_);
    return;
  }
  look_at_grip(used);
  const int window = window_of_motion(limb, stance, true);
  squeezes_ = squeezes_ || window >= 0 || (used > 0.0 && window_of_motion(limb, stance, false) >= 0);
  witnessed_s_ = window >= 0 ? witnessed_s_ + dt_s : 0.0;
  const Vector3 place_m = stance.place_m(limb);
  if (!slips_ && witnessed_s_ > kWitnessed_s) {
    slips_ = true;
    if (slid_m_ == 0.0) from_m_ = place_m - way_m(stance.moved(window));
    slipped_at_ = used;
    slides_with_ = used_up_cycles_ago_ < StanceFit::kCycles[window] ? std::max(used_up_at_, used) : used;
    most_used_ = block_used_ = lately_used_ = std::min(most_used_, used);  // it began before it was seen
    still_s_ = 0.0;
  }
  const bool moved = (place_m - rest_m_).norm() > kStill_m;
  still_s_ = moved ? 0.0 : still_s_ + dt_s;
  if (moved) rest_m_ = place_m;
  // Where the grip is known to be used less than it slides with, the others move through their play.
  if (window < 0 && used > 0.0 && used < kSlides * slides_with_) from_m_ += place_m - last_m_;
  last_m_ = place_m;
  if (slips_) {
    slid_m_ = std::max(slid_m_, std::min((place_m - from_m_).norm(), stance.slid_m(limb)));
    slips_ = still_s_ < parameters_.still_time_s || window >= 0;
    out_of_hand_ = out_of_hand_ || slid_m_ > parameters_.max_slip_m;
  }
  const double slipping = slips_ || out_of_hand_ ? parameters_.relief_load : 1.0;
  const double wanted = std::exchange(gives_off_, false) ? kGivenOff : slipping;
  relief_ = std::clamp(wanted, relief_ - dt_s / kUnload_s, relief_ + dt_s / kReload_s);
}

}  // namespace crux
