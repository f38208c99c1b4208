// What planner and runtime stand on beyond the form of a URDF, with the checks of crux_contracts.robot_rules in their
// order: a tree of bodies with masses, four limbs of four to seven revolute joints, fingers that close along the
// gripper's x.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "core/robot/robot_urdf.hpp"

namespace crux {

/// Joints of one limb from the body outwards, fixed ones among them and the gripper's mount last, and its fingers.
struct LimbChain {
  std::vector<const UrdfJoint*> joints;
  std::array<const UrdfJoint*, 2> fingers{};
};

/// Of robot.yaml, what the URDF has to fit; names with their prefixes, limbs in the order LF, RF, LR, RR.
struct LimbNames {
  std::vector<std::string> joints;  ///< of which a limb has the first alone
  std::string gripper_link;
  std::array<std::string, 2> finger_joints;
};

/// @throws std::runtime_error naming file, link or joint, value and what would be right
PerLimb<LimbChain> checked_limbs(const Urdf& urdf, const std::string& path, const std::string& body_link,
                                 const PerLimb<LimbNames>& names, const std::array<double, 2>& opening_m);

}  // namespace crux
