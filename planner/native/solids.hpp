/// Whether links keep off the trunk.
#ifndef CRUX_PLANNER_SOLIDS_HPP
#define CRUX_PLANNER_SOLIDS_HPP

#include <algorithm>
#include <array>
#include <cstddef>

#include "reach.h"
#include "vector.hpp"

namespace crux {

template <class T>
inline Vec<T> in_axes(const crux_reach_box& box, const Vec<T>& point) {
  const Vec<T> off{point[0] - box.centre_m[0], point[1] - box.centre_m[1], point[2] - box.centre_m[2]};
  Vec<T> seen{};
  for (std::size_t a = 0; a < 3; ++a) {
    seen[a] = box.rotation[a] * off[0] + box.rotation[3 + a] * off[1] + box.rotation[6 + a] * off[2];
  }
  return seen;
}

/// How a point's distance to the box |x| <= half changes along a way, times that distance.
inline double slope(const Vector& point, const Vector& way, const double* half) {
  double sum = 0.0;
  for (std::size_t a = 0; a < 3; ++a) {
    sum += (point[a] - std::clamp(point[a], -half[a], half[a])) * way[a];
  }
  return sum;
}

/// How far along a segment it is nearest to the box |x| <= half: the slope along it is linear between the places where
/// it crosses planes of faces.
inline double nearest_share(const Vector& start, const Vector& way, const double* half) {
  std::array<double, 8> places{0.0, 1.0};
  std::size_t count = 2;
  for (std::size_t a = 0; a < 3; ++a) {
    for (const double face : {-half[a], half[a]}) {
      const double at = way[a] == 0.0 ? 0.0 : (face - start[a]) / way[a];
      if (at > 0.0 && at < 1.0) {  // in order: the first place is below all of them
        std::size_t k = count++;
        for (; k > 1 && places[k - 1] > at; --k) {
          places[k] = places[k - 1];
        }
        places[k] = at;
      }
    }
  }
  double best = 0.0;
  double before = slope(start, way, half);
  for (std::size_t k = 1; k < count && before < 0.0; ++k) {
    const double after = slope(start + places[k] * way, way, half);
    best = after <= 0.0 ? places[k] : places[k - 1] + before / (before - after) * (places[k] - places[k - 1]);
    before = after;
  }
  return best;
}

/// Square of the distance of a segment to that box.
inline double squared_distance(const Vector& start, const Vector& way, const double* half) {
  const Vector nearest = start + nearest_share(start, way, half) * way;
  double squared = 0.0;
  for (std::size_t a = 0; a < 3; ++a) {
    const double off = nearest[a] - std::clamp(nearest[a], -half[a], half[a]);
    squared += off * off;
  }
  return squared;
}

inline bool keeps_off(const crux_reach_box& box, const Vector& first, const Vector& last, double by_m) {
  const Vector start = in_axes(box, first);
  const Vector end = in_axes(box, last);
  for (std::size_t a = 0; a < 3; ++a) {  // one face alone shows it, mostly
    if (std::max(std::min(start[a], end[a]), -std::max(start[a], end[a])) - box.half_m[a] >= by_m) {
      return true;
    }
  }
  return squared_distance(start, end - start, box.half_m) >= by_m * by_m;
}

/// Of one capsule, a link's, and all of some boxes.
inline bool keeps_off(const crux_reach_box* boxes, std::int64_t count, const Vector& start, const Vector& end,
                      double by_m) {
  return std::all_of(boxes, boxes + count, [&](const auto& box) { return keeps_off(box, start, end, by_m); });
}

}  // namespace crux

#endif
