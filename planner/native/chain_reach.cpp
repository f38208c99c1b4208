#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <type_traits>
#include <vector>

#include "chain.h"
#include "chain_solve.hpp"
#include "solids.hpp"
#include "vector.hpp"

namespace crux {
namespace {

enum Input { X, Y, Z, CosRoll, SinRoll, CosPitch, SinPitch, CosYaw, SinYaw, Inputs };

/// Of a gripper that the body sees, in the body's frame.
Pose in_body(const std::array<double, Inputs>& in) {
  const auto seen = [&](double x, double y, double z) {
    const double above = in[SinPitch] * x + in[CosPitch] * z;
    return Vector{in[CosPitch] * x - in[SinPitch] * z, in[CosRoll] * y + in[SinRoll] * above,
                  in[CosRoll] * above - in[SinRoll] * y};
  };
  return {seen(in[X], in[Y], in[Z]),
          {seen(in[CosYaw], in[SinYaw], 0.0), seen(-in[SinYaw], in[CosYaw], 0.0), seen(0.0, 0.0, 1.0)}};
}

/// Calls `use(pose, number)` for all poses.
template <typename Use>
void for_seen(const crux_reach_poses& poses, const Use& use) {
  std::int64_t count = 1;
  for (const std::int64_t each : poses.shape) {
    count *= each;
  }
  std::array<double, Inputs> in;
  for (std::int64_t n = 0; n < count; ++n) {
    std::int64_t rest = n;
    std::array<std::int64_t, Inputs> at{};
    for (std::size_t axis = CRUX_REACH_AXES; axis-- > 0; rest /= poses.shape[axis]) {
      for (std::size_t k = 0; k < Inputs; ++k) {
        at[k] += rest % poses.shape[axis] * poses.strides[k][axis];
      }
    }
    for (std::size_t k = 0; k < Inputs; ++k) {
      in[k] = poses.values[k][at[k]];
    }
    use(in_body(in), n);
  }
}

/// A limb's capsules: one on the gripper as that is to be, the others as the angles have their links.
template <std::size_t N>
class Capsules {
 public:
  explicit Capsules(const crux_chain_limb& limb) : limb_(limb) {
    for (std::int64_t k = 0; k < limb.all_capsules; ++k) {
      const crux_reach_capsule& capsule = limb.links[k];
      starts_.push_back(at_zero(capsule, capsule.start_m));
      ends_.push_back(at_zero(capsule, capsule.end_m));
    }
  }

  /// Start and end of one.
  [[nodiscard]] std::array<Vector, 2> ends(std::size_t k, const Posture<N>& at, const Pose& pose) const {
    if (limb_.links[k].frame < 0) {
      return {pose.place + pose.rotation * starts_[k], pose.place + pose.rotation * ends_[k]};
    }
    const auto link = static_cast<std::size_t>(limb_.links[k].frame);
    return {at.at[link] + at.turns[link] * starts_[k], at.at[link] + at.turns[link] * ends_[k]};
  }

  [[nodiscard]] bool off_trunk(const Posture<N>& at, const Pose& pose) const {
    for (std::size_t k = 0; k < static_cast<std::size_t>(limb_.capsules); ++k) {
      const auto [start, end] = ends(k, at, pose);
      if (!keeps_off(limb_.trunk, limb_.boxes, start, end, limb_.links[k].radius_m + limb_.clear_m)) {
        return false;
      }
    }
    return true;
  }

 private:
  /// In the gripper's frame, else in the body's at the zero posture.
  [[nodiscard]] Vector at_zero(const crux_reach_capsule& capsule, const double* place) const {
    if (capsule.frame < 0) {
      return vector(place);
    }
    const auto link = static_cast<std::size_t>(capsule.frame);
    return vector(limb_.chain.points_m + 3 * link) + matrix(limb_.rotations + 9 * link) * vector(place);
  }

  const crux_chain_limb& limb_;
  std::vector<Vector> starts_, ends_;
};

template <std::size_t N>
bool within_limits(const crux_chain_limb& limb, const Slots<N>& q) {
  for (std::size_t j = 0; j < N; ++j) {
    if (std::min(q[j] - limb.lower_rad[j], limb.upper_rad[j] - q[j]) < limb.margin_rad[j]) {
      return false;
    }
  }
  return true;
}

}  // namespace
}  // namespace crux

void crux_chain_reaches(const crux_chain_limb* limb, const crux_reach_poses* poses, uint8_t* reached) {
  crux::for_joints(limb->chain, [&](auto q) {
    constexpr std::size_t kSlots = std::tuple_size_v<decltype(q)>;
    const crux::Capsules<kSlots> capsules(*limb);
    crux::for_seen(*poses, [&](const crux::Pose& pose, std::int64_t n) {
      const bool ok = crux::solve<kSlots>(limb->chain, limb->lattice, pose, q) && crux::within_limits(*limb, q) &&
                      (limb->boxes == 0 || capsules.off_trunk(crux::placed<kSlots>(limb->chain, q), pose));
      reached[n] = ok ? 1 : 0;
    });
  });
}

void crux_chain_links(const crux_chain_limb* limb, const crux_reach_poses* poses, double* starts, double* ends) {
  crux::for_joints(limb->chain, [&](auto q) {
    constexpr std::size_t kSlots = std::tuple_size_v<decltype(q)>;
    const crux::Capsules<kSlots> capsules(*limb);
    crux::for_seen(*poses, [&](const crux::Pose& pose, std::int64_t n) {
      crux::solve<kSlots>(limb->chain, limb->lattice, pose, q);
      const crux::Posture<kSlots> at = crux::placed<kSlots>(limb->chain, q);
      for (std::int64_t k = 0; k < limb->all_capsules; ++k) {
        const auto [start, end] = capsules.ends(static_cast<std::size_t>(k), at, pose);
        const std::int64_t to = 3 * (n * limb->all_capsules + k);
        std::copy(start.begin(), start.end(), starts + to);
        std::copy(end.begin(), end.end(), ends + to);
      }
    });
  });
}
