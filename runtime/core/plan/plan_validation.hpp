// Does a plan fit the robot that is to climb it?
#pragma once

#include <crux_msgs/plan_t.hpp>
#include <string>

#include "core/plan/prepared_plan.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Format, identity, sizes, finite numbers, phases, gripper and wrench limits. Empty when all is well, else the reason.
std::string plan_message_defect(const RobotDescription& robot, const crux_msgs::plan_t& plan);

/// Follows every limb along the plan from interval `first` on by inverse kinematics, between the knots too. Empty when
/// every pose is in reach.
std::string plan_reach_defect(const RobotDescription& robot, const PreparedPlan& plan, int first);

}  // namespace crux
