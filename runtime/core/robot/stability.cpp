#include "core/robot/stability.hpp"

#include <cmath>
#include <numbers>

namespace crux {
namespace {

constexpr int kHalvings = 24;  // of the span between no damping and enough
constexpr double kFine = 1e-4;

}  // namespace

bool stable(double mass, double damping, double spring, double stiffness, double delay_s) noexcept {
  // |K − M·ω² + jDω| = stiffness, for u = ω²: M²u² + b·u − c = 0.
  const double b = damping * damping - 2.0 * spring * mass;
  const double c = stiffness * stiffness - spring * spring;
  if (c <= 0.0) return b >= 0.0;  // below 1 at any frequency, unless it resonates
  const double root = std::sqrt(b * b + 4.0 * mass * mass * c);
  const double u = b > 0.0 ? 2.0 * c / (b + root) : (root - b) / (2.0 * mass * mass);
  const double omega_1_s = std::sqrt(u);
  const double lag_rad = std::atan2(damping * omega_1_s, spring - mass * u) + omega_1_s * delay_s;
  return lag_rad < std::numbers::pi;
}

double least_damping(double mass, double spring, double stiffness, double delay_s) noexcept {
  const double hardest = kGainMargin * stiffness;
  // More than enough: a damper that crosses over at half a radian of delay, and aperiodic with its mass and springs.
  double low = 0.0, high = 2.0 * hardest * delay_s + 2.0 * std::sqrt(mass * (hardest + spring));
  for (int i = 0; i < kHalvings && high - low > kFine * high; ++i) {
    const double middle = 0.5 * (low + high);
    (stable(mass, middle, spring, hardest, delay_s) ? high : low) = middle;
  }
  return high;
}

}  // namespace crux
