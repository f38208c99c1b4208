// What a robot description means, as a text: the same for any form that says the same. msgs/README.md defines it.
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>

namespace crux {

/// Canonical text of robot.yaml and the URDF's XML; its SHA-256 is the robot's hash.
/// @throws std::runtime_error where `urdf` is no XML
std::string robot_meaning(const YAML::Node& yaml, const std::string& urdf);

}  // namespace crux
