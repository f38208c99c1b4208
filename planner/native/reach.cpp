#include "reach.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "arm.hpp"
#include "segments.hpp"
#include "solids.hpp"
#include "vector.hpp"

namespace crux {
namespace {

constexpr std::size_t kBlock = 64;

using Column = std::array<double, kBlock>;

enum Input { X, Y, Z, CosRoll, SinRoll, CosPitch, SinPitch, CosYaw, SinYaw, SideCos, SideSin, SideHalf };

/// Some poses in a row, and what of the limb's posture its links are placed by.
struct Block {
  std::array<Column, CRUX_REACH_INPUTS> in;
  Column cos_azimuth, sin_azimuth;
  std::array<Column, 3> upper, forearm;  ///< ways along these links
  Column slack;                          ///< of the limit that is nearest or most exceeded, each by its own measure
};

double least(double a, double b) { return a < b ? a : b; }

Tilt<double> tilt_of(const Block& block, std::size_t i) {
  return {block.in[CosRoll][i], block.in[SinRoll][i], block.in[CosPitch][i], block.in[SinPitch][i]};
}

Vector wrist_of(const crux_reach_arm& arm, const Block& block, std::size_t i) {
  return tilt_of(block, i).in_body(block.in[X][i], block.in[Y][i], block.in[Z][i] + arm.wrist_to_gripper_m);
}

/// Joint limits, for all poses of a block: no branches, so that the loop becomes vectors.
void within_limits(const crux_reach_arm& arm, Block& block, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const ArmPosture<double> at = arm_posture(arm, wrist_of(arm, block, i), tilt_of(block, i));
    const crux_reach_sector last{block.in[SideCos][i], block.in[SideSin][i], block.in[SideHalf][i]};
    const double elbow = least(at.cos_elbow - arm.cos_elbow[0], arm.cos_elbow[1] - at.cos_elbow);
    const double roll = least(at.sin_roll - arm.sin_roll[0], arm.sin_roll[1] - at.sin_roll);
    const double shoulder = least(inside(arm.azimuth, at.ca, at.sa, 1.0), inside(arm.upper, at.c2, at.s2, 1.0));
    const double wrist =
        least(inside(arm.pitch, at.c4, at.s4, at.pitch_length), inside(last, at.east, at.north, at.side_length));
    block.slack[i] = least(least(at.radius_m - arm.least_radius_m, elbow), least(roll, least(shoulder, wrist)));
    block.cos_azimuth[i] = at.ca;
    block.sin_azimuth[i] = at.sa;
    for (std::size_t a = 0; a < 3; ++a) {
      block.upper[a][i] = at.upper[a];
      block.forearm[a][i] = at.forearm[a];
    }
  }
}

/// Frames of capsules, by number.
std::array<Frame<double>, kFrames> frames(const crux_reach_arm& arm, const Block& block, std::size_t i) {
  const auto at = [i](const std::array<Column, 3>& of) { return Vector{of[0][i], of[1][i], of[2][i]}; };
  return arm_frames<double>(arm, tilt_of(block, i),
                            {wrist_of(arm, block, i), block.in[CosYaw][i], block.in[SinYaw][i], block.cos_azimuth[i],
                             block.sin_azimuth[i], at(block.upper), at(block.forearm)});
}

bool off_trunk(const crux_reach_arm& arm, const Block& block, std::size_t i) {
  const std::array<Frame<double>, kFrames> at = frames(arm, block, i);
  for (std::int64_t k = 0; k < arm.capsules; ++k) {
    const crux_reach_capsule& capsule = arm.links[k];
    const Frame<double>& frame = at[static_cast<std::size_t>(capsule.frame)];
    const Vector start = frame.placed(capsule.start_m);
    const Vector end = frame.placed(capsule.end_m);
    for (std::int64_t j = 0; j < arm.boxes; ++j) {
      if (!keeps_off(arm.trunk[j], start, end, capsule.radius_m + arm.clear_m)) {
        return false;
      }
    }
  }
  return true;
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

Vector placed(const double* origin, const double* axes, const double* point) {
  Vector found{};
  for (std::size_t a = 0; a < 3; ++a) {
    found[a] = origin[a] + axes[3 * a] * point[0] + axes[3 * a + 1] * point[1] + axes[3 * a + 2] * point[2];
  }
  return found;
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
      const std::array<crux::Frame<double>, crux::kFrames> at = crux::frames(*arm, block, i);
      std::int64_t to = 3 * arm->all_capsules * (first + static_cast<std::int64_t>(i));
      for (std::int64_t k = 0; k < arm->all_capsules; ++k, to += 3) {
        const crux_reach_capsule& capsule = arm->links[k];
        const crux::Frame<double>& frame = at[static_cast<std::size_t>(capsule.frame)];
        const crux::Vector start = frame.placed(capsule.start_m);
        const crux::Vector end = frame.placed(capsule.end_m);
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

void crux_reach_off_boxes(const crux_reach_capsules* links, int64_t poses, const double* origins, const double* axes,
                          const crux_reach_box* boxes, int64_t count, double clear_m, uint8_t* off) {
  for (int64_t pose = 0; pose < poses; ++pose) {
    bool clear = true;
    for (int64_t k = 0; k < links->count && clear; ++k) {
      const int64_t at = 3 * (pose * links->count + k);
      if (links->hand[k] == 0) {
        const crux::Vector start = crux::placed(origins + 3 * pose, axes + 9 * pose, links->starts + at);
        const crux::Vector end = crux::placed(origins + 3 * pose, axes + 9 * pose, links->ends + at);
        clear = crux::keeps_off(boxes, count, start, end, links->radius_m[k] + clear_m);
      }
    }
    off[pose] = clear ? 1 : 0;
  }
}
