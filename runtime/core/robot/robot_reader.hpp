// Reads a robot's description and checks it.
#pragma once

#include <string>

#include "core/robot/result.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Reads robot.yaml at `yaml_path` and the URDF it names. A refusal says file, key, value and what would be right.
Result<RobotDescription> load_robot(const std::string& yaml_path);

}  // namespace crux
