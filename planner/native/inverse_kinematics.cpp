#include "inverse_kinematics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "vector.hpp"

// Damped Gauss-Newton on the pose error; a radian counts as a metre.

namespace crux {
namespace {

constexpr double kPi = 3.141592653589793;
constexpr std::size_t kMost = CRUX_ARM_MOST;
constexpr std::size_t kRows = 7;  // of the pose, and of what is spare
constexpr int kIterations = 30;
constexpr double kMostStepRad = 0.4;
constexpr double kConverged = 1e-7;
constexpr double kDamping = 0.01;  // of the squared error
constexpr double kLeastDamping = 1e-12;
constexpr double kStill = 1e-9;     // sines of a turn that is none
constexpr double kHalfTurn = 1e-6;  // sines of a turn whose axis they do not tell

using Angles = std::array<double, kMost>;
using Rows = std::array<Angles, kRows>;

struct Posture {
  Vector position{};
  Matrix rotation{Vector{1, 0, 0}, Vector{0, 1, 0}, Vector{0, 0, 1}};
  std::array<Vector, kMost> origins{}, axes{};
};

Posture placed(const crux_arm& arm, const double* angles) {
  Posture at;
  Matrix& turn = at.rotation;
  for (int64_t j = 0; j < arm.joints; ++j) {
    if (j > 0) {
      const Matrix next = matrix(arm.turns + 9 * (j - 1));
      turn = {turn * next[0], turn * next[1], turn * next[2]};
    }
    at.origins[j] = at.position;
    at.axes[j] = turn[2];
    const double sine = std::sin(angles[j]);
    const double cosine = std::cos(angles[j]);
    turn = {cosine * turn[0] + sine * turn[1], cosine * turn[1] - sine * turn[0], turn[2]};
    at.position = at.position + turn * vector(arm.offsets_m + 3 * j);
  }
  return at;
}

void write_jacobian(const crux_arm& arm, const Posture& at, Rows& rows) {
  for (int64_t j = 0; j < arm.joints; ++j) {
    const Vector linear = cross(at.axes[j], at.position - at.origins[j]);
    for (std::size_t i = 0; i < 3; ++i) {
      rows[i][j] = linear[i];
      rows[3 + i][j] = at.axes[j][i];
    }
  }
}

/// The rotation vector from one rotation to another; of a half turn, about an axis of no sign.
Vector turn_between(const Matrix& from, const Matrix& to) {
  const Vector skew = 0.5 * (cross(from[0], to[0]) + (cross(from[1], to[1]) + cross(from[2], to[2])));
  const double trace = dot(from[0], to[0]) + dot(from[1], to[1]) + dot(from[2], to[2]);
  const double cosine = std::clamp(0.5 * (trace - 1.0), -1.0, 1.0);
  const double sine = std::sqrt(dot(skew, skew));
  if (sine <= kHalfTurn && cosine < 0.0) {
    Vector axis;
    for (std::size_t i = 0; i < 3; ++i) {
      const double same = to[0][i] * from[0][i] + to[1][i] * from[1][i] + to[2][i] * from[2][i];
      axis[i] = kPi * std::sqrt(std::clamp(0.5 * (same + 1.0), 0.0, 1.0));
    }
    return axis;
  }
  return (sine > kStill ? std::atan2(sine, cosine) / sine : 1.0) * skew;
}

/// x of A x = b for a symmetric positive definite A, both overwritten, by A = L D Lᵀ.
void solve(std::size_t size, std::array<Angles, kMost>& a, Angles& x) {
  for (std::size_t j = 0; j < size; ++j) {
    for (std::size_t i = j + 1; i < size; ++i) {
      const double below = a[i][j] / a[j][j];
      for (std::size_t k = j + 1; k < size; ++k) {
        a[i][k] -= below * a[j][k];
      }
      x[i] -= below * x[j];
    }
  }
  for (std::size_t j = size; j-- > 0;) {
    for (std::size_t k = j + 1; k < size; ++k) {
      x[j] -= a[j][k] * x[k];
    }
    x[j] /= a[j][j];
  }
}

/// Jᵀ error of (Jᵀ J + damping) step = Jᵀ error.
Angles step_of(std::size_t joints, std::size_t rows, const Rows& slopes, const std::array<double, kRows>& error) {
  double damping = kLeastDamping;
  for (std::size_t i = 0; i < rows; ++i) {
    damping += kDamping * error[i] * error[i];
  }
  std::array<Angles, kMost> normal{};
  Angles step{};
  for (std::size_t j = 0; j < joints; ++j) {
    for (std::size_t i = 0; i < rows; ++i) {
      step[j] += slopes[i][j] * error[i];
      for (std::size_t k = 0; k < joints; ++k) {
        normal[j][k] += slopes[i][j] * slopes[i][k];
      }
    }
    normal[j][j] += damping;
  }
  solve(joints, normal, step);
  return step;
}

void reach(const crux_arm& arm, const Vector& position, const Matrix& rotation, double* angles, double* left) {
  const auto joints = static_cast<std::size_t>(arm.joints);
  const std::size_t rows = 6 + static_cast<std::size_t>(arm.spares);
  Rows slopes{};
  std::copy_n(arm.spare, arm.spares * arm.joints, slopes[6].begin());
  for (int iteration = 0;; ++iteration) {
    const Posture at = placed(arm, angles);
    const Vector off = position - at.position;
    const Vector turn = turn_between(at.rotation, rotation);
    std::array<double, kRows> error{off[0], off[1], off[2], turn[0], turn[1], turn[2], 0.0};
    for (std::size_t j = 0; rows > 6 && j < joints; ++j) {
      error[6] += slopes[6][j] * (arm.middle_rad[j] - angles[j]);
    }
    left[0] = std::sqrt(dot(off, off));
    left[1] = std::sqrt(dot(turn, turn) + error[6] * error[6]);
    if (std::max(left[0], left[1]) <= kConverged || iteration == kIterations - 1) {
      break;
    }
    write_jacobian(arm, at, slopes);
    const Angles step = step_of(joints, rows, slopes, error);
    double size = 1e-12;
    for (std::size_t j = 0; j < joints; ++j) {
      size = std::max(size, std::abs(step[j]));
    }
    const double share = std::min(1.0, kMostStepRad / size);
    for (std::size_t j = 0; j < joints; ++j) {
      angles[j] += share * step[j];
    }
  }
  for (std::size_t j = 0; j < joints; ++j) {  // into the turn about the middle
    const double beyond = angles[j] - arm.middle_rad[j] + kPi;
    angles[j] -= 2.0 * kPi * std::floor(beyond / (2.0 * kPi));
  }
}

}  // namespace
}  // namespace crux

void crux_arm_place(const crux_arm* arm, int64_t n, const double* angles_rad, double* positions_m, double* rotations,
                    double* jacobians) {
  for (int64_t p = 0; p < n; ++p) {
    const crux::Posture at = crux::placed(*arm, angles_rad + p * arm->joints);
    crux::Rows rows{};
    crux::write_jacobian(*arm, at, rows);
    for (std::size_t i = 0; i < 3; ++i) {
      positions_m[3 * p + i] = at.position[i];
      for (std::size_t j = 0; j < 3; ++j) {
        rotations[9 * p + 3 * i + j] = at.rotation[j][i];
      }
    }
    for (std::size_t i = 0; i < 6; ++i) {
      jacobians = std::copy_n(rows[i].begin(), arm->joints, jacobians);
    }
  }
}

void crux_arm_reach(const crux_arm* arm, int64_t n, const double* positions_m, const double* rotations,
                    double* angles_rad, double* left) {
  for (int64_t p = 0; p < n; ++p) {
    crux::reach(*arm, crux::vector(positions_m + 3 * p), crux::matrix(rotations + 9 * p), angles_rad + p * arm->joints,
                left + 2 * p);
  }
}
