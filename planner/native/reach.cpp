#include "reach.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "solids.hpp"
#include "vector.hpp"

namespace crux {
namespace {

constexpr std::size_t kBlock = 64;
constexpr std::size_t kFrames = 6;

using Column = std::array<double, kBlock>;

enum Input { X, Y, Z, CosRoll, SinRoll, CosPitch, SinPitch, CosYaw, SinYaw, SideCos, SideSin, SideHalf };

/// Some poses in a row, and what of the limb's posture its links are placed by.
struct Block {
  std::array<Column, CRUX_REACH_INPUTS> in;
  Column cos_azimuth, sin_azimuth, cos_upper, sin_upper, cos_forearm, sin_forearm;
  Column slack;  ///< of the limit that is nearest or most exceeded, each by its own measure
};

struct Frame {
  Vector origin, x, y, z;
};

/// Not negative where the vector (x, y) of this length is in the sector: a difference has the sign of the comparison.
double inside(const crux_reach_sector& sector, double x, double y, double length) {
  return sector.cos_middle * x + sector.sin_middle * y - sector.cos_half * length;
}

double least(double a, double b) { return a < b ? a : b; }

/// Joint limits, for all poses of a block: no branches, so that the loop becomes vectors.
void within_limits(const crux_reach_arm& arm, Block& block, std::size_t count) {
  const double l1 = arm.upper_m;
  const double l2 = arm.lower_m;
  const double squares = l1 * l1 + l2 * l2;
  const double product = 2 * l1 * l2;
  for (std::size_t i = 0; i < count; ++i) {
    const double cr = block.in[CosRoll][i];
    const double sr = block.in[SinRoll][i];
    const double cp = block.in[CosPitch][i];
    const double sp = block.in[SinPitch][i];
    const double across = block.in[Y][i];
    const double high = block.in[Z][i] + arm.wrist_to_gripper_m;
    const double above = sp * block.in[X][i] + cp * high;
    const double x = cp * block.in[X][i] - sp * high - arm.shoulder_m[0];
    const double y = cr * across + sr * above - arm.shoulder_m[1];
    const double h = cr * above - sr * across - arm.shoulder_m[2];
    const double squared = x * x + y * y;
    const double radius = std::sqrt(squared);
    const double ca = x / std::max(radius, 1e-9);
    const double sa = y / std::max(radius, 1e-9);
    const double c3 = (squared + h * h - squares) / product;
    const double s3 = std::sqrt(std::max(1.0 - c3 * c3, 0.0));
    const double far = std::max(squared + h * h, 1e-12);
    const double c2 = (radius * (l1 + l2 * c3) - h * (l2 * s3)) / far;
    const double s2 = (h * (l1 + l2 * c3) + radius * (l2 * s3)) / far;
    const double ce = (radius * (l2 + l1 * c3) + h * (l1 * s3)) / far;
    const double se = (h * (l2 + l1 * c3) - radius * (l1 * s3)) / far;
    const double ux = -sp;
    const double uy = sr * cp;
    const double uz = cr * cp;
    const double outward = ux * ca + uy * sa;
    const double sin_roll = -(uy * ca - ux * sa);
    const double c4 = uz * ce - outward * se;
    const double s4 = outward * ce + uz * se;
    const double east = cr * ca;
    const double north = cp * sa - sp * sr * ca;
    const double pitch_length = std::sqrt(outward * outward + uz * uz);
    const double side_length = std::sqrt(east * east + north * north);
    const crux_reach_sector last{block.in[SideCos][i], block.in[SideSin][i], block.in[SideHalf][i]};
    const double elbow = least(c3 - arm.cos_elbow[0], arm.cos_elbow[1] - c3);
    const double roll = least(sin_roll - arm.sin_roll[0], arm.sin_roll[1] - sin_roll);
    const double shoulder = least(inside(arm.azimuth, ca, sa, 1.0), inside(arm.upper, c2, s2, 1.0));
    const double wrist = least(inside(arm.pitch, c4, s4, pitch_length), inside(last, east, north, side_length));
    block.slack[i] = least(least(radius - arm.least_radius_m, elbow), least(roll, least(shoulder, wrist)));
    block.cos_azimuth[i] = ca;
    block.sin_azimuth[i] = sa;
    block.cos_upper[i] = c2;
    block.sin_upper[i] = s2;
    block.cos_forearm[i] = ce;
    block.sin_forearm[i] = se;
  }
}

/// Frames of capsules, by number.
std::array<Frame, kFrames> frames(const crux_reach_arm& arm, const Block& block, std::size_t i) {
  const double cr = block.in[CosRoll][i];
  const double sr = block.in[SinRoll][i];
  const double cp = block.in[CosPitch][i];
  const double sp = block.in[SinPitch][i];
  const auto in_body = [&](double x, double y, double z) {
    const double above = sp * x + cp * z;
    return Vector{cp * x - sp * z, cr * y + sr * above, cr * above - sr * y};
  };
  const double ca = block.cos_azimuth[i];
  const double sa = block.sin_azimuth[i];
  const Vector place = in_body(block.in[X][i], block.in[Y][i], block.in[Z][i]);
  const Vector up = in_body(0.0, 0.0, 1.0);
  const Vector along = in_body(block.in[CosYaw][i], block.in[SinYaw][i], 0.0);
  const Vector side{-sa, ca, 0.0};
  const Vector upper{ca * block.cos_upper[i], sa * block.cos_upper[i], block.sin_upper[i]};
  const Vector forearm{ca * block.cos_forearm[i], sa * block.cos_forearm[i], block.sin_forearm[i]};
  const Vector across = cross(side, up);
  const double length = std::sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]);
  const Vector rolled = (1.0 / std::max(length, 1e-9)) * across;
  const Vector shoulder = vector(arm.shoulder_m);
  const Vector wrist = place + arm.wrist_to_gripper_m * up;
  const Vector tilted = cross(up, rolled);
  return {{{shoulder, upper, side, cross(upper, side)},
           {shoulder + arm.upper_m * upper, forearm, side, cross(forearm, side)},
           {wrist, rolled, side, cross(rolled, side)},
           {wrist, rolled, tilted, cross(rolled, tilted)},
           {place, along, cross(up, along), up},
           {shoulder, {ca, sa, 0.0}, side, {0.0, 0.0, 1.0}}}};
}

Vector placed(const Frame& frame, const double* point) {
  return frame.origin + (point[0] * frame.x + (point[1] * frame.y + point[2] * frame.z));
}

bool off_trunk(const crux_reach_arm& arm, const Block& block, std::size_t i) {
  const std::array<Frame, kFrames> at = frames(arm, block, i);
  for (std::int64_t k = 0; k < arm.capsules; ++k) {
    const crux_reach_capsule& capsule = arm.links[k];
    const Frame& frame = at[static_cast<std::size_t>(capsule.frame)];
    const Vector start = placed(frame, capsule.start_m);
    const Vector end = placed(frame, capsule.end_m);
    for (std::int64_t j = 0; j < arm.boxes; ++j) {
      if (!keeps_off(arm.trunk[j], start, end, capsule.radius_m + arm.clear_m)) {
        return false;
      }
    }
  }
  return true;
}

/// 0 where the whole is none: parallel segments, or points.
double ratio(double part, double whole) { return whole > 1e-15 ? std::clamp(part / whole, 0.0, 1.0) : 0.0; }

/// Between two segments; a point is one, too.
double distance(const Vector& a0, const Vector& a1, const Vector& b0, const Vector& b1) {
  const Vector u = a1 - a0;
  const Vector v = b1 - b0;
  const Vector off = a0 - b0;
  const double uu = dot(u, u);
  const double vv = dot(v, v);
  const double uv = dot(u, v);
  const double uo = dot(u, off);
  const double vo = dot(v, off);
  double s = ratio(uv * vo - uo * vv, uu * vv - uv * uv);
  const double t = ratio(uv * s + vo, vv);
  s = ratio(uv * t - uo, uu);
  const Vector way = off + (s * u - t * v);
  return std::sqrt(dot(way, way));
}

/// Whether boxes around two capsules are apart: quick, and enough for most.
bool boxes_apart(const double* a0, const double* a1, const double* b0, const double* b1, double by_m) {
  for (std::size_t a = 0; a < 3; ++a) {
    if (std::max(std::min(a0[a], a1[a]) - std::max(b0[a], b1[a]), std::min(b0[a], b1[a]) - std::max(a0[a], a1[a])) >=
        by_m) {
      return true;
    }
  }
  return false;
}

bool pose_apart(const crux_reach_capsules& one, const crux_reach_capsules& two, std::int64_t pose, double clear_m,
                bool hands) {
  for (std::int64_t i = 0; i < one.count; ++i) {
    const double* a0 = one.starts + 3 * (pose * one.count + i);
    const double* a1 = one.ends + 3 * (pose * one.count + i);
    for (std::int64_t j = 0; j < two.count; ++j) {
      const double* b0 = two.starts + 3 * (pose * two.count + j);
      const double* b1 = two.ends + 3 * (pose * two.count + j);
      const double by_m = one.radius_m[i] + two.radius_m[j] + clear_m;
      const bool counts = hands || one.hand[i] == 0 || two.hand[j] == 0;
      if (counts && !boxes_apart(a0, a1, b0, b1, by_m) &&
          distance(vector(a0), vector(a1), vector(b0), vector(b1)) < by_m) {
        return false;
      }
    }
  }
  return true;
}

/// Calls `use(block, count, first)` for all poses, so many at once, of which the first is number `first`.
template <typename Use>
void for_blocks(const crux_reach_arm& arm, const crux_reach_poses& poses, const Use& use) {
  Block block{};
  const int64_t* shape = poses.shape;
  const std::int64_t row = shape[CRUX_REACH_AXES - 1];
  std::int64_t rows = 1;
  for (std::size_t axis = 0; axis + 1 < CRUX_REACH_AXES; ++axis) {
    rows *= shape[axis];
  }
  for (std::int64_t r = 0; r < rows; ++r) {
    std::array<const double*, CRUX_REACH_INPUTS> at{};
    std::int64_t rest = r;
    std::copy(std::begin(poses.values), std::end(poses.values), at.begin());
    for (std::size_t axis = CRUX_REACH_AXES - 1; axis-- > 0; rest /= shape[axis]) {
      for (std::size_t k = 0; k < CRUX_REACH_INPUTS; ++k) {
        at[k] += rest % shape[axis] * poses.strides[k][axis];
      }
    }
    for (std::int64_t first = 0; first < row; first += static_cast<std::int64_t>(kBlock)) {
      const auto count = static_cast<std::size_t>(std::min<std::int64_t>(row - first, kBlock));
      for (std::size_t k = 0; k < CRUX_REACH_INPUTS; ++k) {
        const std::int64_t stride = poses.strides[k][CRUX_REACH_AXES - 1];
        const double* from = at[k] + first * stride;
        for (std::size_t i = 0; i < count; ++i) {
          block.in[k][i] = from[static_cast<std::int64_t>(i) * stride];
        }
      }
      within_limits(arm, block, count);
      use(block, count, r * row + first);
    }
  }
}

}  // namespace
}  // namespace crux

void crux_reach(const crux_reach_arm* arm, const crux_reach_poses* poses, uint8_t* reached) {
  crux::for_blocks(*arm, *poses, [&](const crux::Block& block, std::size_t count, std::int64_t first) {
    for (std::size_t i = 0; i < count; ++i) {
      const bool ok = block.slack[i] >= 0.0 && (arm->boxes == 0 || crux::off_trunk(*arm, block, i));
      reached[first + static_cast<std::int64_t>(i)] = ok ? 1 : 0;
    }
  });
}

void crux_reach_links(const crux_reach_arm* arm, const crux_reach_poses* poses, double* starts, double* ends) {
  crux::for_blocks(*arm, *poses, [&](const crux::Block& block, std::size_t count, std::int64_t first) {
    for (std::size_t i = 0; i < count; ++i) {
      const std::array<crux::Frame, crux::kFrames> at = crux::frames(*arm, block, i);
      std::int64_t to = 3 * arm->all_capsules * (first + static_cast<std::int64_t>(i));
      for (std::int64_t k = 0; k < arm->all_capsules; ++k, to += 3) {
        const crux_reach_capsule& capsule = arm->links[k];
        const crux::Frame& frame = at[static_cast<std::size_t>(capsule.frame)];
        const crux::Vector start = crux::placed(frame, capsule.start_m);
        const crux::Vector end = crux::placed(frame, capsule.end_m);
        std::copy(start.begin(), start.end(), starts + to);
        std::copy(end.begin(), end.end(), ends + to);
      }
    }
  });
}

void crux_reach_apart(const crux_reach_capsules* one, const crux_reach_capsules* two, int64_t poses, double clear_m,
                      int64_t hands, uint8_t* apart) {
  for (std::int64_t pose = 0; pose < poses; ++pose) {
    apart[pose] = crux::pose_apart(*one, *two, pose, clear_m, hands != 0) ? 1 : 0;
  }
}
