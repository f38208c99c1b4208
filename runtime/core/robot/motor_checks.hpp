// What the motors and gains of a robot description must be able to do, judged beside the loads that stand elsewhere in
// it: the checks of crux_contracts.motor_checks and gain_checks.
#pragma once

#include <string>

#include "crux_msgs/robot.hpp"

namespace crux {

/// `fastest_rad_s`: the highest speed limit of a limb's joint.
/// @throws std::runtime_error naming file, key, value and what would be right
void check_motors(const crux_msgs::robot::Sections& robot, const std::string& path, double fastest_rad_s);

/// The admittance must be stable against what it presses on, and the sensors see the pull on a new grasp.
/// @throws std::runtime_error as check_motors
void check_gains(const crux_msgs::robot::Sections& robot, const std::string& path);

}  // namespace crux
