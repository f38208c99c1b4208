// The robot as the runtime sees it: msgs/robots/NAME/robot.yaml and its URDF. Every robot number of the runtime comes
// from here.
#pragma once

#include <algorithm>
#include <array>
#include <kdl/chain.hpp>
#include <string>
#include <utility>

#include "core/robot/geometry.hpp"
#include "core/robot/transmission.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {

struct LimbDescription {
  std::string name;  ///< LF, RF, LR, RR
  int bus = 0;
  /// Body link to gripper frame, then the turns of the gripper that a limb of fewer than kPlacing joints does not make
  /// (still_turns.hpp). The gripper's segment carries the fingers' mass as well.
  KDL::Chain chain;
  Transmission transmission;
  LimbLimits own{};        ///< of the joints, whatever turns them
  LimbLimits joints{};     ///< as far as the actuators let them
  LimbLimits actuators{};  ///< what their nodes take
  Range crank;             ///< of the five-bar, where there is one
  int driven = kPlacing;   ///< joints; behind them come the turns, and slots that nothing fills

  /// How many of the slots the chain has.
  [[nodiscard]] int turns() const { return std::max(driven, kPlacing); }

  /// What hangs on the far side of the F/T sensor: gripper and fingers, in the gripper frame.
  double hand_mass_kg = 0.0;
  Vector3 hand_com_G_m = Vector3::Zero();
};

// Sections of robot.yaml, as msgs/robot_keys.yaml has them.
using CanDescription = crux_msgs::robot::Can;
using ServoDescription = crux_msgs::robot::Servo;
using GripperDescription = crux_msgs::robot::Gripper;
using ForceTorqueDescription = crux_msgs::robot::ForceTorque;
using AdmittanceParameters = crux_msgs::robot::Admittance;
using ControlParameters = crux_msgs::robot::Control;
using GraspTestParameters = crux_msgs::robot::GraspTest;
using LocalisationParameters = crux_msgs::robot::Localisation;
using StanceParameters = crux_msgs::robot::Stance;
using SupervisorParameters = crux_msgs::robot::Supervisor;

/// The longest delay that calibration can reckon with.
inline constexpr int kMostDelay_cycles = crux_msgs::robot::kMaxDelayCycles;

struct RobotDescription : crux_msgs::robot::Sections {
  std::string name;
  std::string sha256;                                        ///< of what both files mean
  std::array<std::pair<std::string, std::string>, 2> files;  ///< robot.yaml and the URDF: name and bytes
  PerLimb<LimbDescription> limbs;
  double body_mass_kg = 0.0;
  Vector3 body_com_B_m = Vector3::Zero();
  double total_mass_kg = 0.0;
  double delay_margin_s = 0.0;  ///< from which the position loops oscillate, in the worst posture
  bool calibrates = false;      ///< not of the file: whoever starts the core switches it on
};

}  // namespace crux
