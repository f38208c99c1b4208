// The meshes that a robot's URDF names: files of the robot's folder that only pictures need.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace crux {

struct RobotMesh {
  std::string name;  ///< inside the robot's folder, and in a log: no step of it leads out of a folder
  std::filesystem::path path;
};

/// Every file once that is there and lies in the robot's folder: a log shows its meshes to all who can read it.
std::vector<RobotMesh> meshes_of(const std::string& urdf, const std::filesystem::path& folder);

}  // namespace crux
