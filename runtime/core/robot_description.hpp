// The robot as the runtime sees it: msgs/robots/NAME/robot.yaml and its URDF. Every robot number of the runtime comes
// from here.
#pragma once

#include <array>
#include <kdl/chain.hpp>
#include <string>
#include <utility>

#include "core/geometry.hpp"
#include "core/result.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {

struct JointLimits {
  double lower_rad = 0.0;
  double upper_rad = 0.0;
  double velocity_rad_s = 0.0;
  double effort_Nm = 0.0;
};

struct LimbDescription {
  std::string name;  ///< LF, RF, LR, RR
  int bus = 0;
  /// Body link to gripper frame. The last segment carries the fingers' mass as well.
  KDL::Chain chain;
  std::array<JointLimits, kJoints> joints{};
  /// What hangs on the far side of the F/T sensor: gripper and fingers, in the gripper frame.
  double hand_mass_kg = 0.0;
  Vector3 hand_com_G_m = Vector3::Zero();
};

struct CanDescription {
  double rate_Hz = 0.0;
  int watchdog_cycles = 0;
  std::array<int, kJoints> joint_nodes{};
  int gripper_node = 0;
};

struct ServoDescription {
  std::array<double, kJoints> position_gain_Nm_rad{};
  std::array<double, kJoints> velocity_gain_Nms_rad{};
  std::array<double, kJoints> damping_Nms_rad{};  ///< viscous friction of the joints
  double setpoint_time_constant_s = 0.0;          ///< of the nodes' first-order filter of what they are told
  double torque_time_constant_s = 0.0;
  double dead_time_s = 0.0;     ///< until a torque asked for is first made, at most
  double delay_margin_s = 0.0;  ///< from which the position loops oscillate, in the worst posture
};

struct GripperDescription {
  double min_opening_m = 0.0;  ///< pad face to gripper centre
  double max_opening_m = 0.0;
  double max_finger_force_N = 0.0;
  double max_finger_speed_m_s = 0.0;
  double stiffness_N_m = 0.0;  ///< of the actuator's position loop, a finger
  double damping_Ns_m = 0.0;
  double pad_radius_m = 0.0;
};

struct ForceTorqueDescription {
  double range_N = 0.0;
  double range_Nm = 0.0;
};

/// M·a + D·v + K·x = wrench error, one set for translation, one for rotation.
struct AdmittanceParameters {
  double mass_kg = 0.0;
  double damping_Ns_m = 0.0;
  double stiffness_N_m = 0.0;
  double inertia_kg_m2 = 0.0;
  double rotational_damping_Nms_rad = 0.0;
  double rotational_stiffness_Nm_rad = 0.0;
  double max_speed_m_s = 0.0;
  double max_rate_rad_s = 0.0;
  double max_offset_m = 0.0;
  double max_rotation_rad = 0.0;
  double environment_N_m = 0.0;  ///< the stiffest that a gripper may meet
  double environment_Nm_rad = 0.0;
  double delay_s = 0.0;  ///< until what it does is felt as a force
};

/// The longest delay that calibration can reckon with.
inline constexpr int kMostDelay_cycles = crux_msgs::robot::kMaxDelayCycles;

/// Of the calibration of those gains.
struct CalibrationParameters {
  double window_s = 0.0;
  double tolerated_N = 0.0;
  double tolerated_Nm = 0.0;
  double max_change = 0.0;
};

struct ControlParameters {
  double force_filter_s = 0.0;
  double tare_time_constant_s = 0.0;
  double contact_force_N = 0.0;
  double unload_force_N = 0.0;
  double grasp_force_factor = 0.0;
  double grasp_force_reserve_N = 0.0;
  double trusted_friction = 0.0;
  double min_grasp_force_N = 0.0;
  double grasp_damping_Ns_m = 0.0;
  double grasp_force_time_constant_s = 0.0;
  double grasp_force_lead_s = 0.0;
  double closing_speed_m_s = 0.0;
  double body_gain_1_s = 0.0;
  double max_body_correction_m = 0.0;
  double max_body_rotation_rad = 0.0;
  double twist_length_m = 0.0;
  double moment_length_m = 0.0;
  double swing_decay_s = 0.0;
  double engage_time_s = 0.0;
  double max_contact_offset_m = 0.0;
};

/// Standard deviations.
struct LocalisationParameters {
  double hold_sigma_m = 0.0;
  double grasp_sigma_m = 0.0;
  double grasp_sigma_rad = 0.0;
  double tilt_sigma_rad = 0.0;
};

/// Of the rigid fit of the grips, and of slips.
struct StanceParameters {
  double shift_sigma_m = 0.0;
  double turn_sigma_rad = 0.0;
  double idle_torque_Nm = 0.0;
  double most_play_rad = 0.0;
  double play_memory_s = 0.0;
  double slip_m = 0.0;
  double max_slip_m = 0.0;
  double still_time_s = 0.0;
  double relief_load = 0.0;
  double max_misfit_m = 0.0;
  double balance_memory_s = 0.0;
  double max_unbalanced_N = 0.0;
  double unbalanced_time_s = 0.0;
};

struct SupervisorParameters {
  double start_tolerance_m = 0.0;
  double start_tolerance_rad = 0.0;
  double settle_time_s = 0.0;
  double event_timeout_s = 0.0;
  double arrive_tolerance_m = 0.0;
  double open_tolerance_m = 0.0;
  int silent_cycles = 0;
  double max_body_error_m = 0.0;
  double max_tracking_error_rad = 0.0;
  double min_stance_force_N = 0.0;
  double max_ik_error_m = 0.0;
  double oscillation_rad = 0.0;
  double encoder_standstill_rad = 0.0;
  double max_ft_residual_Nm = 0.0;
  double max_ft_residual_share = 0.0;
  double max_finger_residual_N = 0.0;
  double max_late_s = 0.0;
  double persistence_s = 0.0;
};

struct RobotDescription {
  std::string name;
  std::string sha256;                                        ///< of what both files mean
  std::array<std::pair<std::string, std::string>, 2> files;  ///< robot.yaml and the URDF: name and bytes
  PerLimb<LimbDescription> limbs;
  double body_mass_kg = 0.0;
  Vector3 body_com_B_m = Vector3::Zero();
  double total_mass_kg = 0.0;
  CanDescription can;
  ServoDescription servo;
  GripperDescription gripper;
  ForceTorqueDescription force_torque;
  AdmittanceParameters admittance;
  CalibrationParameters calibration;
  bool calibrates = false;  ///< not of the file: whoever starts the core switches it on
  ControlParameters control;
  LocalisationParameters localisation;
  StanceParameters stance;
  SupervisorParameters supervisor;
};

/// Reads robot.yaml at `yaml_path` and the URDF it names. A refusal says file, key, value and what would be right.
Result<RobotDescription> load_robot(const std::string& yaml_path);

}  // namespace crux
