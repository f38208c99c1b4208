/// Conditions on a limb that holds an upright grip, and on two of them, over numbers or models of them.
#ifndef CRUX_PLANNER_HELD_LIMB_HPP
#define CRUX_PLANNER_HELD_LIMB_HPP

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "arm.hpp"
#include "range.hpp"
#include "refute.h"
#include "segments.hpp"
#include "solids.hpp"
#include "vector.hpp"

namespace crux {

constexpr std::size_t kBody = 6;  ///< x, y, z, yaw, roll and pitch

/// Forms that must not be negative, and points that are off others.
template <class T>
struct Conditions {
  std::vector<T> forms;
  std::vector<Apart<T>> apart;
};

inline Vector middle(const Vector& v) { return v; }
template <std::size_t N>
Vector middle(const Vec<Affine<N>>& v) {
  return {v[0].middle, v[1].middle, v[2].middle};
}

/// Adds that a point is off something, if it is not so in the middle of the box.
template <class T>
void add_apart(const Apart<T>& apart, Conditions<T>& to) {
  if (squared_off(middle(apart.point), apart.half) < square(apart.by_m)) {
    to.forms.push_back(squared_off(apart.point, apart.half) - square(apart.by_m));
    to.apart.push_back(apart);
  }
}

/// That a body is at the goal.
template <class T>
std::vector<T> at_goal(const crux_refute_goal& goal, const std::array<T, kBody>& body) {
  Vec<T> off{body[0] - goal.middle[0], body[1] - goal.middle[1], body[2] - goal.middle[2]};
  const T place = square(goal.place_m) - (square(off[0]) + square(off[1]) + square(off[2]));
  T turn(square(goal.turn_rad));
  off = {body[4] - goal.middle[4], body[5] - goal.middle[5], body[3] - goal.middle[3]};  // roll, pitch, yaw
  for (std::size_t row = 0; row < 3; ++row) {
    const double* rate = goal.rates + 3 * row;
    turn = turn - square(rate[0] * off[0] + rate[1] * off[1] + rate[2] * off[2]);
  }
  return {place, turn};
}

/// The conditions on one limb, and its links.
template <class T>
struct HeldLimb {
  Conditions<T> needs;
  std::array<T, 2> last;  ///< joint 6, with fingers one way round and the other: one of both must not be negative
  std::vector<std::array<Vec<T>, 2>> links;
};

/// The wrist in the body frame of a limb whose gripper is so far aside and so high on its grip.
template <class T>
Vec<T> wrist_on(const crux_refute_grip& grip, const std::array<T, kBody>& body, const T& aside, const T& height) {
  using std::cos;
  using std::sin;
  const T c = cos(body[3]);
  const T s = sin(body[3]);
  const T east = grip.centre_m[0] + grip.tangent[0] * aside - body[0];
  const T north = grip.centre_m[1] + grip.tangent[1] * aside - body[1];
  const Tilt<T> tilt{cos(body[4]), sin(body[4]), cos(body[5]), sin(body[5])};
  return tilt.in_body(c * east + s * north, c * north - s * east, height - body[2] + grip.arm->wrist_to_gripper_m);
}

/// A limb with its wrist there in the body frame, within joint limits, under a body of this yaw, roll and pitch,
/// `ahead` as in `arm_posture`; `keep_off_trunk` and `keep_apart` add the rest.
template <class T>
HeldLimb<T> held_limb(const crux_refute_grip& grip, double ahead, const std::array<T, 3>& turn, const Vec<T>& wrist) {
  using std::cos;
  using std::sin;
  const crux_reach_arm& arm = *grip.arm;
  const Tilt<T> tilt{cos(turn[1]), sin(turn[1]), cos(turn[2]), sin(turn[2])};
  const ArmPosture<T> at = arm_posture(arm, wrist, tilt, ahead);
  const T yaw = grip.yaw_rad - turn[0];
  const T side = yaw - grip.last_middle_rad;  // of the limb, where joint 6 is in the middle of its range
  const T in_front = cos(side) * at.east + sin(side) * at.north;
  const T least = grip.cos_last_half * at.side_length;
  HeldLimb<T> limb;
  limb.last = {in_front - least, -in_front - least};
  limb.needs.forms = {at.cos_elbow - arm.cos_elbow[0],
                      arm.cos_elbow[1] - at.cos_elbow,
                      at.sin_roll - arm.sin_roll[0],
                      arm.sin_roll[1] - at.sin_roll,
                      inside(arm.azimuth, at.ca, at.sa, 1.0),
                      inside(arm.upper, at.c2, at.s2, 1.0),
                      inside(arm.pitch, at.c4, at.s4, at.pitch_length)};
  const auto frames = arm_frames<T>(arm, tilt, {wrist, cos(yaw), sin(yaw), at.ca, at.sa, at.upper, at.forearm});
  for (std::int64_t k = 0; k < arm.all_capsules; ++k) {
    const Frame<T>& frame = frames[static_cast<std::size_t>(arm.links[k].frame)];
    limb.links.push_back({frame.placed(arm.links[k].start_m), frame.placed(arm.links[k].end_m)});
  }
  return limb;
}

/// Adds that the links keep off the trunk: those which meet it in the middle of the box, by the points that are deepest
/// there.
template <class T>
void keep_off_trunk(const crux_reach_arm& arm, HeldLimb<T>& limb) {
  for (std::int64_t k = 0; k < arm.capsules; ++k) {
    const auto& [start, end] = limb.links[static_cast<std::size_t>(k)];
    for (std::int64_t j = 0; j < arm.boxes; ++j) {
      const crux_reach_box& box = arm.trunk[j];
      const Vec<T> from = in_axes(box, start);
      const Vec<T> way = in_axes(box, end) - from;
      const double share = nearest_share(middle(from), middle(way), box.half_m);
      add_apart<T>({from + share * way, vector(box.half_m), arm.links[k].radius_m}, limb.needs);
    }
  }
}

/// Adds that links of two limbs keep off each other, as `keep_off_trunk` does.
template <class T>
void keep_apart(const crux_refute_grip& one, const crux_refute_grip& other, const HeldLimb<T>& a, const HeldLimb<T>& b,
                double clear_m, Conditions<T>& to) {
  for (std::size_t i = 0; i < a.links.size(); ++i) {
    const auto& [a0, a1] = a.links[i];
    for (std::size_t j = 0; j < b.links.size(); ++j) {
      const auto& [b0, b1] = b.links[j];
      const auto [s, t] = nearest_shares(middle(a0), middle(a1), middle(b0), middle(b1));
      const double by_m = one.arm->links[i].radius_m + other.arm->links[j].radius_m + clear_m;
      const Vector off = middle(a0) - middle(b0) + (s * (middle(a1) - middle(a0)) - t * (middle(b1) - middle(b0)));
      if (dot(off, off) < square(by_m)) {
        add_apart<T>({(a0 - b0) + (s * (a1 - a0) - t * (b1 - b0)), {}, by_m}, to);
      }
    }
  }
}

}  // namespace crux

#endif
