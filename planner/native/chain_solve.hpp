/// Newton's method for the inverse kinematics in chain.h, for a chain of N joints.
#ifndef CRUX_PLANNER_CHAIN_SOLVE_HPP
#define CRUX_PLANNER_CHAIN_SOLVE_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "chain.h"
#include "vector.hpp"

namespace crux {

inline constexpr std::size_t kPose = CRUX_CHAIN_POSE;
inline constexpr double kLeast = 1e-13;  // of damping

template <std::size_t N>
using Slots = std::array<double, N>;
template <std::size_t N>
using Square = std::array<Slots<N>, N>;

/// Where a gripper is to be.
struct Pose {
  Vector place;
  Matrix rotation;
};

/// Where some angles have the links: what turned with them from the zero posture, and where the body's origin came to.
template <std::size_t N>
struct Posture {
  std::array<Vector, N> axes, points;
  std::array<Matrix, N> turns;
  std::array<Vector, N> at;
};

/// `v` turned about a unit vector.
inline Vector turned(const Vector& axis, double sine, double cosine, const Vector& v) {
  return cosine * v + (sine * cross(axis, v) + ((1.0 - cosine) * dot(axis, v)) * axis);
}

template <std::size_t N>
Posture<N> placed(const crux_chain& chain, const Slots<N>& q) {
  Posture<N> found;
  Matrix turn{Vector{1, 0, 0}, Vector{0, 1, 0}, Vector{0, 0, 1}};
  Vector at{};
  for (std::size_t j = 0; j < N; ++j) {
    const Vector own = vector(chain.axes + 3 * j);
    const Vector point = vector(chain.points_m + 3 * j);
    found.axes[j] = turn * own;
    found.points[j] = at + turn * point;
    if (dot(own, own) > 0.0) {  // a slot without an axis is at rest
      const double sine = std::sin(q[j]);
      const double cosine = std::cos(q[j]);
      turn[0] = turned(found.axes[j], sine, cosine, turn[0]);
      turn[1] = turned(found.axes[j], sine, cosine, turn[1]);
      turn[2] = cross(turn[0], turn[1]);
    }
    at = found.points[j] - turn * point;
    found.turns[j] = turn;
    found.at[j] = at;
  }
  return found;
}

/// Rows of the gripper's motion, then the rule's.
template <std::size_t N>
Square<N> jacobian(const crux_chain& chain, const Posture<N>& at, const Vector& gripper) {
  Square<N> found;
  for (std::size_t j = 0; j < N; ++j) {
    const Vector linear = cross(at.axes[j], gripper - at.points[j]);
    for (std::size_t i = 0; i < 3; ++i) {
      found[i][j] = linear[i];
      found[3 + i][j] = at.axes[j][i];
    }
    for (std::size_t i = kPose; i < N; ++i) {
      found[i][j] = chain.rule[(i - kPose) * N + j];
    }
  }
  return found;
}

template <std::size_t N>
Vector gripper_of(const crux_chain& chain, const Posture<N>& at) {
  return at.at[N - 1] + at.turns[N - 1] * vector(chain.gripper_m);
}

/// Where some angles put the gripper: what is left to its pose, and the Jacobian.
template <std::size_t N>
struct Look {
  Slots<N> error;
  Square<N> jacobian;
  double left;
  bool facing;
};

template <std::size_t N>
Look<N> look(const crux_chain& chain, const Slots<N>& q, const Pose& pose) {
  const Posture<N> at = placed<N>(chain, q);
  const Matrix zero = matrix(chain.rotation);
  const Matrix& turn = at.turns[N - 1];
  const Matrix hand{turn * zero[0], turn * zero[1], turn * zero[2]};
  const Vector gripper = gripper_of<N>(chain, at);
  const Matrix& to = pose.rotation;
  const Vector off = pose.place - gripper;
  const Vector way = 0.5 * (cross(hand[0], to[0]) + cross(hand[1], to[1]) + cross(hand[2], to[2]));
  Look<N> found{{}, jacobian<N>(chain, at, gripper), 0.0, false};
  for (std::size_t i = 0; i < 3; ++i) {
    found.error[i] = off[i];
    found.error[3 + i] = way[i];
  }
  for (std::size_t i = kPose; i < N; ++i) {
    for (std::size_t j = 0; j < N; ++j) {
      found.error[i] += found.jacobian[i][j] * (chain.middle_rad[j] - q[j]);
    }
  }
  for (const double each : found.error) {
    found.left = std::max(found.left, std::abs(each));
  }
  found.facing = dot(hand[0], to[0]) + dot(hand[1], to[1]) + dot(hand[2], to[2]) > 1.0;
  return found;
}

/// The sign of a determinant, 0 where it is 0.
template <std::size_t N>
double sign_of(Square<N> a) {
  double sign = 1.0;
  for (std::size_t k = 0; k < N; ++k) {
    std::size_t pivot = k;
    for (std::size_t i = k + 1; i < N; ++i) {
      pivot = std::abs(a[i][k]) > std::abs(a[pivot][k]) ? i : pivot;
    }
    if (a[pivot][k] == 0.0) {
      return 0.0;
    }
    if (pivot != k) {
      std::swap(a[pivot], a[k]);
      sign = -sign;
    }
    sign = a[k][k] < 0.0 ? -sign : sign;
    for (std::size_t i = k + 1; i < N; ++i) {
      const double share = a[i][k] / a[k][k];
      for (std::size_t j = k; j < N; ++j) {
        a[i][j] -= share * a[k][j];
      }
    }
  }
  return sign;
}

/// Cholesky's decomposition of J Jᵀ + damping.
template <std::size_t N>
class Normal {
 public:
  Normal(const Square<N>& jacobian, double damping) : jacobian_(jacobian) {
    for (std::size_t i = 0; i < N; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        double sum = i == j ? damping : 0.0;
        for (std::size_t k = 0; k < N; ++k) {
          sum += jacobian[i][k] * jacobian[j][k];
        }
        for (std::size_t k = 0; k < j; ++k) {
          sum -= lower_[i][k] * lower_[j][k];
        }
        lower_[i][j] = i == j ? std::sqrt(std::max(sum, kLeast)) : sum / lower_[j][j];
      }
    }
  }

  /// Jᵀ (J Jᵀ + damping)⁻¹ error.
  [[nodiscard]] Slots<N> back(Slots<N> error) const {
    for (std::size_t i = 0; i < N; ++i) {
      for (std::size_t k = 0; k < i; ++k) {
        error[i] -= lower_[i][k] * error[k];
      }
      error[i] /= lower_[i][i];
    }
    for (std::size_t i = N; i-- > 0;) {
      for (std::size_t k = i + 1; k < N; ++k) {
        error[i] -= lower_[k][i] * error[k];
      }
      error[i] /= lower_[i][i];
    }
    Slots<N> move{};
    for (std::size_t i = 0; i < N; ++i) {
      for (std::size_t j = 0; j < N; ++j) {
        move[j] += jacobian_[i][j] * error[i];
      }
    }
    return move;
  }

 private:
  const Square<N>& jacobian_;
  Square<N> lower_;
};

/// Whether the pose is reached, with its angles in `q`.
template <std::size_t N>
bool solve(const crux_chain& chain, const Pose& pose, Slots<N>& q) {
  for (int64_t round = 0; round < chain.iterations; ++round) {
    const Look<N> at = look<N>(chain, q, pose);
    if (at.left < chain.close && at.facing) {
      return sign_of<N>(at.jacobian) == chain.sign;
    }
    const double reduced = std::min(at.left, 1.0);
    const Slots<N> move = Normal<N>(at.jacobian, reduced * reduced * chain.damping + kLeast).back(at.error);
    double most = 1e-12;
    for (const double each : move) {
      most = std::max(most, std::abs(each));
    }
    const double share = std::min(1.0, chain.largest_rad / most);
    for (std::size_t j = 0; j < N; ++j) {
      q[j] += share * move[j];
    }
  }
  return false;
}

/// The same from the lattice's node that is nearest.
template <std::size_t N>
bool solve(const crux_chain& chain, const crux_chain_lattice& lattice, const Pose& pose, Slots<N>& q) {
  const int64_t side = 2 * lattice.half + 1;
  int64_t node = 0;
  for (std::size_t a = 0; a < 3; ++a) {
    const double steps = std::nearbyint((pose.place[a] - lattice.middle_m[a]) / lattice.step_m);
    const auto half = static_cast<double>(lattice.half);
    node = node * side + static_cast<int64_t>(std::clamp(steps, -half, half)) + lattice.half;
  }
  const double turn = 6.283185307179586 / static_cast<double>(lattice.turns);
  const auto turns = static_cast<int64_t>(std::nearbyint(std::atan2(pose.rotation[0][1], pose.rotation[0][0]) / turn));
  node = node * lattice.turns + (turns + lattice.turns) % lattice.turns;
  const double* start = lattice.angles_rad + static_cast<std::size_t>(node) * N;
  const bool known = !std::isnan(start[0]);
  std::copy_n(known ? start : chain.middle_rad, N, q.begin());
  return known && solve<N>(chain, pose, q);
}

/// Calls `use` with an array of as many numbers as the chain has joints.
template <typename Use>
void for_joints(const crux_chain& chain, const Use& use) {
  if (chain.slots == CRUX_CHAIN_POSE) {
    use(Slots<CRUX_CHAIN_POSE>{});
  } else {
    use(Slots<CRUX_CHAIN_MOST>{});
  }
}

}  // namespace crux

#endif
