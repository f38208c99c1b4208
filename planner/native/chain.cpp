#include "chain.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace {

constexpr std::size_t kPose = CRUX_CHAIN_POSE;
constexpr std::size_t kMost = CRUX_CHAIN_MOST;
constexpr double kLeast = 1e-13;  // of damping

using Vector = std::array<double, 3>;
using Matrix = std::array<Vector, 3>;  ///< columns
using Slots = std::array<double, kMost>;
using Square = std::array<Slots, kMost>;

Vector operator+(const Vector& a, const Vector& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
Vector operator-(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vector operator*(double s, const Vector& a) { return {s * a[0], s * a[1], s * a[2]}; }
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vector operator*(const Matrix& m, const Vector& v) { return v[0] * m[0] + v[1] * m[1] + v[2] * m[2]; }

Vector vector(const double* v) { return {v[0], v[1], v[2]}; }

Matrix matrix(const double* rows) {
  return {Vector{rows[0], rows[3], rows[6]}, Vector{rows[1], rows[4], rows[7]}, Vector{rows[2], rows[5], rows[8]}};
}

/// `v` turned about a unit vector.
Vector turned(const Vector& axis, double sine, double cosine, const Vector& v) {
  return cosine * v + sine * cross(axis, v) + ((1.0 - cosine) * dot(axis, v)) * axis;
}

/// Where some angles put the gripper: what is left to its pose, and the Jacobian with the rule's rows.
struct Look {
  Slots error;
  Square jacobian;  ///< rows
  double left;
  bool facing;
};

Look look(const crux_chain& chain, const Slots& q, const Vector& place, const Matrix& rotation) {
  const auto slots = static_cast<std::size_t>(chain.slots);
  Matrix turn{Vector{1, 0, 0}, Vector{0, 1, 0}, Vector{0, 0, 1}};
  Vector at{};
  std::array<Vector, kMost> axes;
  std::array<Vector, kMost> points;
  for (std::size_t j = 0; j < slots; ++j) {
    const Vector own = vector(chain.axes + 3 * j);
    const Vector point = vector(chain.points_m + 3 * j);
    axes[j] = turn * own;
    points[j] = at + turn * point;
    const double sine = std::sin(q[j]);
    const double cosine = std::cos(q[j]);
    const bool turns = dot(own, own) > 0.0;  // a slot without an axis is at rest
    for (Vector& column : turn) column = turns ? turned(axes[j], sine, cosine, column) : column;
    at = points[j] - turn * point;
  }
  const Matrix zero = matrix(chain.rotation);
  const Matrix hand{turn * zero[0], turn * zero[1], turn * zero[2]};
  const Vector gripper = at + turn * vector(chain.gripper_m);
  Look found{};
  const Vector off = place - gripper;
  const Vector way = 0.5 * (cross(hand[0], rotation[0]) + cross(hand[1], rotation[1]) + cross(hand[2], rotation[2]));
  for (std::size_t i = 0; i < 3; ++i) {
    found.error[i] = off[i];
    found.error[3 + i] = way[i];
  }
  for (std::size_t j = 0; j < slots; ++j) {
    const Vector linear = cross(axes[j], gripper - points[j]);
    for (std::size_t i = 0; i < 3; ++i) {
      found.jacobian[i][j] = linear[i];
      found.jacobian[3 + i][j] = axes[j][i];
    }
  }
  for (std::size_t i = kPose; i < slots; ++i) {
    for (std::size_t j = 0; j < slots; ++j) {
      found.jacobian[i][j] = chain.rule[(i - kPose) * slots + j];
      found.error[i] += found.jacobian[i][j] * (chain.middle_rad[j] - q[j]);
    }
  }
  for (std::size_t i = 0; i < slots; ++i) found.left = std::max(found.left, std::abs(found.error[i]));
  found.facing = dot(hand[0], rotation[0]) + dot(hand[1], rotation[1]) + dot(hand[2], rotation[2]) > 1.0;
  return found;
}

/// The sign of a determinant, 0 where it is 0.
double sign_of(Square a, std::size_t size) {
  double sign = 1.0;
  for (std::size_t k = 0; k < size; ++k) {
    std::size_t pivot = k;
    for (std::size_t i = k + 1; i < size; ++i) pivot = std::abs(a[i][k]) > std::abs(a[pivot][k]) ? i : pivot;
    if (a[pivot][k] == 0.0) return 0.0;
    if (pivot != k) {
      std::swap(a[pivot], a[k]);
      sign = -sign;
    }
    if (a[k][k] < 0.0) sign = -sign;
    for (std::size_t i = k + 1; i < size; ++i) {
      const double share = a[i][k] / a[k][k];
      for (std::size_t j = k; j < size; ++j) a[i][j] -= share * a[k][j];
    }
  }
  return sign;
}

/// Jᵀ (J Jᵀ + damping)⁻¹ error, by Cholesky's decomposition.
Slots step(const Look& at, double damping, std::size_t size) {
  Square lower{};
  Slots solved{};
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = i == j ? damping : 0.0;
      for (std::size_t k = 0; k < size; ++k) sum += at.jacobian[i][k] * at.jacobian[j][k];
      for (std::size_t k = 0; k < j; ++k) sum -= lower[i][k] * lower[j][k];
      lower[i][j] = i == j ? std::sqrt(std::max(sum, kLeast)) : sum / lower[j][j];
    }
    solved[i] = at.error[i];
    for (std::size_t k = 0; k < i; ++k) solved[i] -= lower[i][k] * solved[k];
    solved[i] /= lower[i][i];
  }
  for (std::size_t i = size; i-- > 0;) {
    for (std::size_t k = i + 1; k < size; ++k) solved[i] -= lower[k][i] * solved[k];
    solved[i] /= lower[i][i];
  }
  Slots move{};
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t j = 0; j < size; ++j) move[j] += at.jacobian[i][j] * solved[i];
  }
  return move;
}

/// Whether the pose is reached, with its angles in `q`.
bool solve(const crux_chain& chain, const Vector& place, const Matrix& rotation, Slots& q) {
  const auto slots = static_cast<std::size_t>(chain.slots);
  for (int64_t round = 0; round < chain.iterations; ++round) {
    const Look at = look(chain, q, place, rotation);
    if (at.left < chain.close && at.facing) return sign_of(at.jacobian, slots) == chain.sign;
    const double reduced = std::min(at.left, 1.0);
    const Slots move = step(at, reduced * reduced * chain.damping + kLeast, slots);
    double most = 1e-12;
    for (std::size_t j = 0; j < slots; ++j) most = std::max(most, std::abs(move[j]));
    const double share = std::min(1.0, chain.largest_rad / most);
    for (std::size_t j = 0; j < slots; ++j) q[j] += share * move[j];
  }
  return false;
}

}  // namespace

void crux_chain_inverse(const crux_chain* chain, int64_t poses, const double* places_m, const double* rotations,
                        double* angles_rad, uint8_t* reached) {
  const auto slots = static_cast<std::size_t>(chain->slots);
  for (std::size_t n = 0; n < static_cast<std::size_t>(poses); ++n) {
    Slots q{};
    std::copy_n(angles_rad + n * slots, slots, q.begin());
    reached[n] = solve(*chain, vector(places_m + 3 * n), matrix(rotations + 9 * n), q) ? 1 : 0;
    std::copy_n(q.begin(), slots, angles_rad + n * slots);
  }
}
