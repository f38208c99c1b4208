/// Where two segments are nearest to each other.
#ifndef CRUX_PLANNER_SEGMENTS_HPP
#define CRUX_PLANNER_SEGMENTS_HPP

#include <algorithm>
#include <array>
#include <cmath>

#include "vector.hpp"

namespace crux {

/// 0 where the whole is none: parallel segments, or points.
inline double ratio(double part, double whole) { return whole > 1e-15 ? std::clamp(part / whole, 0.0, 1.0) : 0.0; }

/// Shares of the way along each, from a0 to a1 and from b0 to b1; a point is a segment, too.
inline std::array<double, 2> nearest_shares(const Vector& a0, const Vector& a1, const Vector& b0, const Vector& b1) {
  const Vector u = a1 - a0;
  const Vector v = b1 - b0;
  const Vector off = a0 - b0;
  const double uu = dot(u, u);
  const double vv = dot(v, v);
  const double uv = dot(u, v);
  const double uo = dot(u, off);
  const double vo = dot(v, off);
  const double s = ratio(uv * vo - uo * vv, uu * vv - uv * uv);
  const double t = ratio(uv * s + vo, vv);
  return {ratio(uv * t - uo, uu), t};
}

inline double distance(const Vector& a0, const Vector& a1, const Vector& b0, const Vector& b1) {
  const auto [s, t] = nearest_shares(a0, a1, b0, b1);
  const Vector way = (a0 - b0) + (s * (a1 - a0) - t * (b1 - b0));
  return std::sqrt(dot(way, way));
}

}  // namespace crux

#endif
