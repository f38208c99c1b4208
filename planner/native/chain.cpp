#include "chain.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <type_traits>

#include "chain_solve.hpp"
#include "vector.hpp"

namespace crux {
namespace {

/// Calls `solves(pose, angles)` for every pose.
template <std::size_t N, typename Solves>
void for_poses(std::int64_t poses, const double* places_m, const double* rotations, double* angles_rad,
               std::uint8_t* reached, const Solves& solves) {
  for (std::size_t n = 0; n < static_cast<std::size_t>(poses); ++n) {
    Slots<N> q;
    std::copy_n(angles_rad + n * N, N, q.begin());
    reached[n] = solves(Pose{vector(places_m + 3 * n), matrix(rotations + 9 * n)}, q) ? 1 : 0;
    std::copy(q.begin(), q.end(), angles_rad + n * N);
  }
}

template <std::size_t N>
void write_back(const crux_chain& chain, std::size_t postures, const double* angles_rad, const double* damping,
                double* back) {
  for (std::size_t n = 0; n < postures; ++n) {
    Slots<N> q;
    std::copy_n(angles_rad + n * N, N, q.begin());
    const Posture<N> at = placed<N>(chain, q);
    const Square<N> slopes = jacobian<N>(chain, at, gripper_of<N>(chain, at));
    const Normal<N> normal(slopes, damping[n]);
    for (std::size_t i = 0; i < kPose; ++i) {
      Slots<N> error{};
      error[i] = 1.0;
      const Slots<N> move = normal.back(error);
      for (std::size_t j = 0; j < N; ++j) {
        back[(n * N + j) * kPose + i] = move[j];
      }
    }
  }
}

}  // namespace
}  // namespace crux

void crux_chain_inverse(const crux_chain* chain, int64_t poses, const double* places_m, const double* rotations,
                        double* angles_rad, uint8_t* reached) {
  crux::for_joints(*chain, [&](const auto& joints) {
    constexpr std::size_t kSlots = std::tuple_size_v<std::decay_t<decltype(joints)>>;
    crux::for_poses<kSlots>(poses, places_m, rotations, angles_rad, reached,
                            [&](const auto& pose, auto& q) { return crux::solve<kSlots>(*chain, pose, q); });
  });
}

void crux_chain_found(const crux_chain* chain, const crux_chain_lattice* lattice, int64_t poses, const double* places_m,
                      const double* rotations, double* angles_rad, uint8_t* reached) {
  crux::for_joints(*chain, [&](const auto& joints) {
    constexpr std::size_t kSlots = std::tuple_size_v<std::decay_t<decltype(joints)>>;
    crux::for_poses<kSlots>(poses, places_m, rotations, angles_rad, reached,
                            [&](const auto& pose, auto& q) { return crux::solve<kSlots>(*chain, *lattice, pose, q); });
  });
}

void crux_chain_back(const crux_chain* chain, int64_t postures, const double* angles_rad, const double* damping,
                     double* back) {
  crux::for_joints(*chain, [&](const auto& joints) {
    constexpr std::size_t kSlots = std::tuple_size_v<std::decay_t<decltype(joints)>>;
    crux::write_back<kSlots>(*chain, static_cast<std::size_t>(postures), angles_rad, damping, back);
  });
}
