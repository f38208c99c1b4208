/// A limb that yaws, pitches and pitches, with a spherical wrist, as crux_planner/reach/arm.py has it: over numbers, or
/// over `Taylor` models.
#ifndef CRUX_PLANNER_ARM_HPP
#define CRUX_PLANNER_ARM_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "reach.h"
#include "taylor.hpp"
#include "vector.hpp"

namespace crux {

constexpr std::size_t kFrames = 6;

/// Of the body, as cosines and sines.
template <class T>
struct Tilt {
  T cr, sr, cp, sp;

  /// A vector along the axes of the body's heading, in the body frame.
  [[nodiscard]] Vec<T> in_body(const T& x, const T& y, const T& z) const {
    const T above = sp * x + cp * z;
    return {cp * x - sp * z, cr * y + sr * above, cr * above - sr * y};
  }
};

/// `Posture` of arm.py.
template <class T>
struct ArmPosture {
  T radius_m;
  T ca, sa;  ///< azimuth
  T cos_elbow;
  T c2, s2;               ///< joint 2
  Vec<T> upper, forearm;  ///< ways along the links
  T sin_roll;
  T c4, s4, pitch_length;
  T east, north, side_length;
};

/// Where the elbow is along and across the way to a wrist, as shares of it; `far` is the square of its length.
template <class T>
inline std::array<T, 2> elbow(const crux_reach_arm& arm, const T& far) {
  const double l1 = arm.upper_m;
  const double l2 = arm.lower_m;
  const double squares = l1 * l1 + l2 * l2;
  const double nearest = squares + 2 * l1 * l2 * arm.cos_elbow[0];
  const T cosine = (far - squares) / (2 * l1 * l2);
  const T sine = root(1.0 - square(cosine), 1.0 - std::max(square(arm.cos_elbow[0]), square(arm.cos_elbow[1])));
  return {0.5 + 0.5 * quotient(T(l1 * l1 - l2 * l2), far, 1e-12, nearest),
          quotient(l1 * l2 * sine, far, 1e-12, nearest)};
}

/// With its wrist there in the body frame: before the shoulder's axis, seen along joint 1, where `ahead` is 1, and
/// behind it where it is -1.
template <class T>
inline ArmPosture<T> arm_posture(const crux_reach_arm& arm, const Vec<T>& wrist, const Tilt<T>& tilt,
                                 double ahead = 1.0) {
  const double l1 = arm.upper_m;
  const double l2 = arm.lower_m;
  const auto& [cr, sr, cp, sp] = tilt;
  const T out = wrist[0] - arm.shoulder_m[0];
  const T aside = wrist[1] - arm.shoulder_m[1];
  const T h = wrist[2] - arm.shoulder_m[2];
  const auto [distance, cosine, sine] = polar(out, aside);
  const T radius = ahead * distance;
  const T ca = ahead * cosine;
  const T sa = ahead * sine;
  const T far = square(out) + square(aside) + square(h);
  const auto [along, beside] = elbow(arm, far);
  const T down = beside * h;
  const T elbow_up = along * h + beside * radius;
  const Vec<T> upper{(along * out - down * ca) / l1, (along * aside - down * sa) / l1, elbow_up / l1};
  const T elbow_out = along * radius - down;
  const T ce = (radius - elbow_out) / l2;
  const T se = (h - elbow_up) / l2;
  const T ux = -sp;
  const T uy = sr * cp;
  const T uz = cr * cp;
  const T outward = ux * ca + uy * sa;
  const T east = cr * ca;
  const T north = cp * sa - sp * sr * ca;
  return {.radius_m = radius,
          .ca = ca,
          .sa = sa,
          .cos_elbow = (far - (l1 * l1 + l2 * l2)) / (2 * l1 * l2),
          .c2 = elbow_out / l1,
          .s2 = elbow_up / l1,
          .upper = upper,
          .forearm = {(out - l1 * upper[0]) / l2, (aside - l1 * upper[1]) / l2, se},
          .sin_roll = -(uy * ca - ux * sa),
          .c4 = uz * ce - outward * se,
          .s4 = outward * ce + uz * se,
          .pitch_length = root(square(outward) + square(uz)),
          .east = east,
          .north = north,
          .side_length = root(square(east) + square(north))};
}

/// Not negative where the vector (x, y) of this length is in the sector: a difference has the sign of the comparison.
template <class T, class Length>
inline T inside(const crux_reach_sector& sector, const T& x, const T& y, const Length& length) {
  return sector.cos_middle * x + sector.sin_middle * y - sector.cos_half * length;
}

template <class T>
struct Frame {
  Vec<T> origin, x, y, z;
  double at = 0.0;  ///< where along x the origin is

  [[nodiscard]] Vec<T> placed(const double* point) const {
    return origin + ((point[0] - at) * x + (point[1] * y + point[2] * z));
  }
};

/// Where a limb is: its wrist in the body frame, the direction of the gripper's opening axis along the body's heading,
/// and what `ArmPosture` says of joints 1 to 3.
template <class T>
struct ArmPlace {
  Vec<T> wrist;
  T cos_yaw, sin_yaw;
  T ca, sa;
  Vec<T> upper, forearm;
};

/// Frames of capsules, by number.
template <class T>
std::array<Frame<T>, kFrames> arm_frames(const crux_reach_arm& arm, const Tilt<T>& tilt, const ArmPlace<T>& at) {
  const T zero(0.0);
  const T one(1.0);
  const Vec<T>& wrist = at.wrist;
  const Vec<T> up = tilt.in_body(zero, zero, one);
  const Vec<T> place = wrist - arm.wrist_to_gripper_m * up;
  const Vec<T> along = tilt.in_body(at.cos_yaw, at.sin_yaw, zero);
  const Vec<T> side{-at.sa, at.ca, zero};
  const Vec<T>& upper = at.upper;
  const Vec<T>& forearm = at.forearm;
  const Vec<T> across = cross(side, up);
  const T length = root(square(across[0]) + square(across[1]) + square(across[2]));
  const Vec<T> rolled = quotient(one, length, 1e-9, 0.0) * across;
  const Vec<T> shoulder{T(arm.shoulder_m[0]), T(arm.shoulder_m[1]), T(arm.shoulder_m[2])};
  const Vec<T> tilted = cross(up, rolled);
  return {{{shoulder, upper, side, cross(upper, side)},
           {wrist, forearm, side, cross(forearm, side), arm.lower_m},
           {wrist, rolled, side, cross(rolled, side)},
           {wrist, rolled, tilted, cross(rolled, tilted)},
           {place, along, cross(up, along), up},
           {shoulder, {at.ca, at.sa, zero}, side, {zero, zero, one}}}};
}

}  // namespace crux

#endif
