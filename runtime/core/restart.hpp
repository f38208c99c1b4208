// A runtime that starts while its robot hangs on the wall: whether joints, fingers and force/torque sensors agree with
// what the run before left behind.
#pragma once

#include <crux_msgs/restart_t.hpp>

#include "core/grips/cycle_view.hpp"
#include "core/robot/reason.hpp"

namespace crux {

/// Where in its plan a robot was found hanging.
struct FoundHanging {
  Reason refusal;  ///< empty unless something does not agree
  PlanTime at;
};

/// `left`: by the run before; `at`: its plan time; `unbalanced_N`: what sensors feel beside the robot's weight.
FoundHanging find_hanging(const CycleView& now, const crux_msgs::restart_t& left, const PlanTime& at,
                          double unbalanced_N) noexcept;

}  // namespace crux
