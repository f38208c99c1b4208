#include "core/estimate/delay_probe.hpp"

#include <algorithm>

namespace crux {
namespace {

constexpr double kProbe_Nm = 0.2;
constexpr int kPeriod = 63;
constexpr int kApart = 10;  // of two joints' sequences: one is not taken for the other's
// What is asked for in one cycle is told in the next. Nodes that answer Sync before they read their commands tell it a
// cycle later: they seem a cycle later than they are, never earlier.
constexpr int kDescribed = 1;
constexpr double kSeen = 0.25;  // of what a drive that answers at once makes of the sequence

/// x⁶ + x + 1 over GF(2): a maximal-length sequence. It and its shifts correlate with each other at one shift alone.
constexpr std::array<double, kPeriod> sequence() {
  std::array<double, kPeriod> bits{};
  unsigned state = 1;
  for (double& bit : bits) {
    bit = (state & 1U) != 0 ? 1.0 : -1.0;
    state = state >> 1U | ((state ^ state >> 1U) & 1U) << 5U;
  }
  return bits;
}

constexpr std::array<double, kPeriod> kBits = sequence();

double bit(int joint, int cycle) { return kBits[static_cast<std::size_t>((cycle + kApart * joint) % kPeriod)]; }

}  // namespace

double DelayProbe::torque_Nm(int joint) const noexcept {
  return cycle_ >= 0 && cycle_ < kSequence ? kProbe_Nm * bit(joint % kJoints, cycle_) : 0.0;
}

void DelayProbe::step(const double* measured_Nm) noexcept {
  if (done()) return;
  ++cycle_;
  for (int joint = 0; joint < kAllJoints; ++joint) {
    // From one cycle to the next: what the position loop makes of the motion changes slowly.
    const double change_Nm = measured_Nm[joint] - last_Nm_[joint];
    last_Nm_[joint] = measured_Nm[joint];
    if (cycle_ < kLongest) continue;
    for (int late = 0; late < kLongest; ++late) {
      const int sent = cycle_ - late;
      if (sent < 1 || sent >= kSequence) continue;
      correlation_[joint][late] += change_Nm * (bit(joint % kJoints, sent) - bit(joint % kJoints, sent - 1));
    }
  }
}

std::optional<int> DelayProbe::dead_cycles(int joint) const noexcept {
  const auto& found = correlation_[joint];
  const auto first = std::ranges::max_element(found);
  // Half of a sequence's steps change it, by twice its size.
  if (*first < kSeen * kProbe_Nm * 2.0 * kSequence) return std::nullopt;
  return static_cast<int>(first - found.begin()) - kDescribed;
}

}  // namespace crux
