#include "knot_bounds.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "vector.hpp"

namespace crux {
namespace {

constexpr double kNowhere = std::numeric_limits<double>::infinity();

/// What accelerations add at most.
double most(const crux_knot_accelerations& given, const Vector& force, const Vector& moment, const Vector& low,
            const Vector& high) {
  Vector middle;
  Vector half;
  for (std::size_t i = 0; i < 3; ++i) {
    const double first = low[i] + given.offset_m[i];
    const double last = high[i] + given.offset_m[3 + i];
    middle[i] = (first + last) / 2;
    half[i] = std::max(last - first, 0.0) / 2;
  }
  const Vector lever = force + cross(moment, middle);
  double push = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    push += std::abs(lever[i]) + std::abs(moment[i]) * (half[(i + 1) % 3] + half[(i + 2) % 3]);
  }
  return given.push_N * push + given.spin_Nm * std::sqrt(dot(moment, moment));
}

/// Least of distance (r - goal)^2 + slope r for r in [near, far].
double along(double distance, double goal, double slope, double near, double far) {
  if (near > far) {
    return kNowhere;
  }
  double r = slope > 0.0 ? near : far;
  if (distance > 0.0) {
    r = std::clamp(goal - slope / (2.0 * distance), near, far);
  }
  return distance * (r - goal) * (r - goal) + slope * r;
}

double least(const crux_knot& knot, const crux_knot_pairs& pairs, std::size_t p) {
  const double* multipliers = pairs.multipliers + (pairs.one_multiplier != 0 ? 0 : 6 * p);
  const double* rest = pairs.rest + (pairs.one_rest != 0 ? 0 : 6 * static_cast<std::size_t>(knot.tilts) * p);
  const Vector force = vector(multipliers);
  const Vector moment = vector(multipliers + 3);
  const Vector weight = vector(knot.weight_N);
  const Vector slope = cross(weight, moment);  // of pi_M . (c x M g) in c
  Vector near = vector(pairs.low + 3 * p);
  Vector far = vector(pairs.high + 3 * p);
  const Vector low = near;
  const Vector high = far;
  const auto at = [&](std::size_t axis, double shift) {
    near[axis] = low[axis] - shift;
    far[axis] = high[axis] + shift;
    if (pairs.box != nullptr) {
      near[axis] = std::max(near[axis], pairs.box[axis]);
      far[axis] = std::min(far[axis], pairs.box[3 + axis]);
    }
    return along(knot.distance, knot.goal_m[axis], pairs.follow[3 * p + axis] * slope[axis], near[axis], far[axis]);
  };
  double tilted = kNowhere;
  for (std::size_t t = 0; t < static_cast<std::size_t>(knot.tilts); ++t, rest += 6) {  // the last shifts the most
    double cost = knot.tilt_cost[t] + at(0, knot.shift_m[t]) + at(1, knot.shift_m[t]);
    for (std::size_t i = 0; i < 3; ++i) {
      cost += std::min(slope[i] * rest[i], slope[i] * rest[3 + i]);
    }
    tilted = std::min(tilted, cost);
  }
  const double body = knot.yaw_cost[pairs.cell[p]] + dot(force, weight) + tilted + at(2, 0.0);
  return body - most(knot.accelerations, force, moment, near, far);
}

}  // namespace
}  // namespace crux

void crux_knot_most(const crux_knot_accelerations* accelerations, int64_t n, const double* multipliers,
                    const double* low, const double* high, double* most) {
  for (int64_t i = 0; i < n; ++i) {
    most[i] = crux::most(*accelerations, crux::vector(multipliers + 6 * i), crux::vector(multipliers + 6 * i + 3),
                         crux::vector(low + 3 * i), crux::vector(high + 3 * i));
  }
}

void crux_knot_least(const crux_knot* knot, const crux_knot_pairs* pairs, double* least) {
  for (int64_t p = 0; p < pairs->pairs; ++p) {
    least[p] = crux::least(*knot, *pairs, static_cast<std::size_t>(p));
  }
}
