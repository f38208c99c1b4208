// Which gains keep an admittance stable against what it presses on.
#pragma once

#include "crux_msgs/robot.hpp"

namespace crux {

/// So many times stiffer than described may be what a gripper meets.
inline constexpr double kGainMargin = crux_msgs::robot::kGainMargin;

/// M·v̇ + D·v + K·x = e against a spring that answers `delay_s` late, e(t) = −stiffness · x(t − delay): the loop
/// stiffness · exp(−s·delay) / (M·s² + D·s + K) must have less than half a turn of lag where its gain is 1 (Nyquist).
bool stable(double mass, double damping, double spring, double stiffness, double delay_s) noexcept;

/// The least damping that is stable against kGainMargin times `stiffness`; within 1e-4 of it, on the safe side.
double least_damping(double mass, double spring, double stiffness, double delay_s) noexcept;

}  // namespace crux
