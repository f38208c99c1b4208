#include "box_distance.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "vector.hpp"

namespace crux {
namespace {

constexpr int kIterations = 24;
constexpr double kRatio = 0.6180339887498949;  // of the golden section

double outside(const Vector& point, const Vector& half) {
  double squares = 0.0;
  double deepest = std::abs(point[0]) - half[0];
  for (std::size_t i = 0; i < 3; ++i) {
    const double beyond = std::abs(point[i]) - half[i];
    deepest = std::max(deepest, beyond);
    squares += beyond > 0.0 ? beyond * beyond : 0.0;
  }
  return std::sqrt(squares) + std::min(deepest, 0.0);
}

/// The signed distance to a convex set is convex, hence convex along the segment: golden-section search finds the least
/// (to 1e-5 of the segment's length). Not a number where an end is none.
double segment_to_box(const Vector& start, const Vector& end, const Vector& half) {
  const Vector along = end - start;
  if (std::isnan(dot(start, end))) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const auto distance = [&](double share) { return outside(start + share * along, half); };
  double low = 0.0;
  double high = 1.0;
  double a = high - kRatio;
  double b = kRatio;
  double at_a = distance(a);
  double at_b = distance(b);
  for (int i = 0; i < kIterations; ++i) {
    if (at_a < at_b) {
      high = b;
      b = a;
      at_b = at_a;
      a = high - kRatio * (high - low);
      at_a = distance(a);
    } else {
      low = a;
      a = b;
      at_a = at_b;
      b = low + kRatio * (high - low);
      at_b = distance(b);
    }
  }
  return std::min({at_a, at_b, distance(0.0), distance(1.0)});
}

}  // namespace
}  // namespace crux

void crux_segment_to_box(int64_t n, const double* starts_m, const double* ends_m, const double* halves_m,
                         double* distances_m) {
  for (int64_t i = 0; i < n; ++i) {
    distances_m[i] = crux::segment_to_box(crux::vector(starts_m + 3 * i), crux::vector(ends_m + 3 * i),
                                          crux::vector(halves_m + 3 * i));
  }
}
