#include "core/robot/linkage_limits.hpp"

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

constexpr int kEdgeHalvings = 30;
constexpr double kEdge_rad = 1e-6;  // what is nearer to the edge is at it

/// The greatest share, to rounding, that `holds` where share 0 does.
template <class Holds>
double greatest_share(const Holds& holds) noexcept {
  if (holds(1.0)) return 1.0;
  double in = 0.0, out = 1.0;
  for (int i = 0; i < kEdgeHalvings; ++i) {
    const double middle = (in + out) / 2.0;
    (holds(middle) ? in : out) = middle;
  }
  return in;
}

}  // namespace

LinkageLimits::LinkageLimits(const LimbDescription& limb)
    : bar_(limb.transmission.five_bar()), crank_(limb.crank), transmission_(limb.transmission), turns_(limb.turns()) {
  for (int j = 0; j < kJoints; ++j) {
    const bool of_bar = bar_ && (j == bar_->first() || j == bar_->first() + 1);
    const JointLimits& limits = of_bar ? limb.own[j] : limb.joints[j];
    lower_rad[j] = limits.lower_rad;
    upper_rad[j] = limits.upper_rad;
    velocity_rad_s[j] = limits.velocity_rad_s;
    middle_rad_[j] = (limb.joints[j].lower_rad + limb.joints[j].upper_rad) / 2.0;
    actuators_rad_s_[j] = limb.actuators[j].velocity_rad_s;
  }
}

bool LinkageLimits::at_an_end(const JointVector& q_rad) const noexcept {
  if ((q_rad.array() <= lower_rad.array()).any() || (q_rad.array() >= upper_rad.array()).any()) return true;
  if (!bar_) return false;
  for (const int j : {bar_->first(), bar_->first() + 1}) {
    for (const double off_rad : {-kEdge_rad, kEdge_rad}) {
      JointVector beside = q_rad;
      beside[j] += off_rad;
      if (!holds(beside)) return true;
    }
  }
  return false;
}

JointVector LinkageLimits::inside(const JointVector& q_rad) const noexcept {
  JointVector clamped = q_rad.cwiseMax(lower_rad).cwiseMin(upper_rad);
  if (holds(clamped)) return clamped;
  JointVector middle = clamped;
  middle.segment<2>(bar_->first()) = middle_rad_.segment<2>(bar_->first());
  return as_far(middle, clamped);
}

void LinkageLimits::edges(const JointVector& q_rad, JointVector& lower, JointVector& upper) const noexcept {
  lower = lower_rad;
  upper = upper_rad;
  if (!bar_) return;
  const int next = bar_->first() + 1;
  for (JointVector* end : {&lower, &upper}) {
    JointVector there = q_rad;
    there[next] = (*end)[next];
    (*end)[next] = as_far(q_rad, there)[next];
  }
}

JointVector LinkageLimits::as_far(const JointVector& q_rad, const JointVector& there_rad) const noexcept {
  const JointVector way = there_rad - q_rad;
  const double share = greatest_share([&](double part) { return holds(q_rad + part * way); });
  return share < 1.0 ? JointVector(q_rad + share * way) : there_rad;
}

double LinkageLimits::speed_share(const JointVector& dq, const JointVector& q_rad, double dt_s) const noexcept {
  double share = 1.0;
  const auto slow_down = [&](double way, double most_rad_s) {
    const double allowed = most_rad_s * dt_s;
    if (std::abs(way) > allowed) share = std::min(share, allowed / std::abs(way));
  };
  for (int j = 0; j < turns_; ++j) slow_down(dq[j], velocity_rad_s[j]);
  if (!bar_) return share;
  const JointVector ways = transmission_.actuator_ways(dq, q_rad);
  for (const int j : {bar_->first(), bar_->first() + 1}) slow_down(ways[j], actuators_rad_s_[j]);
  return share;
}

}  // namespace crux
