// From a plan's message to a plan for the real-time thread.
#pragma once

#include <crux_msgs/plan_t.hpp>
#include <memory>

#include "core/plan/prepared_plan.hpp"
#include "core/robot/result.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Validates `plan` against `robot` and prepares it. Not for the real-time thread. A refusal says which knot, limb and
/// value do not fit, and what would. The plan says so if it goes on from the `running` one, and its limbs are then
/// followed from where it does.
Result<std::unique_ptr<const PreparedPlan>> prepare_plan(const RobotDescription& robot, const crux_msgs::plan_t& plan,
                                                         const PreparedPlan* running = nullptr);

}  // namespace crux
