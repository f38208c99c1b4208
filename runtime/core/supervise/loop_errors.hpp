// What the control loop reports of itself in a cycle, for the fault monitor to judge.
#pragma once

#include <array>

#include "core/estimate/delay_probe.hpp"
#include "core/estimate/weight_balance.hpp"
#include "core/grips/grips.hpp"
#include "core/supervise/fault_monitor.hpp"

namespace crux {

/// Errors of limbs, grips and balance; lateness, waiting and standing up are left at zero. `stands_up`: the body is on
/// its way up to where the plan has it, and joints at their stops bear what they do not tell.
LoopErrors loop_errors(const CycleView& now, const Grips& grips, const WeightBalance& balance, bool stands_up) noexcept;

/// The joint that oscillates widest in this cycle, or none.
FaultEvent oscillation(const PerLimb<LimbController>& limbs) noexcept;

/// Dead time [s] of each joint's drive; -1: not known.
std::array<double, kAllJoints> dead_time_s(const DelayProbe& probe, double rate_Hz) noexcept;

/// The joint whose drive answers latest, where it is later than its gains bear.
FaultEvent late_joint(const DelayProbe& probe, const RobotDescription& robot) noexcept;

}  // namespace crux
