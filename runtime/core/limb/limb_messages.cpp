// What a limb tells its nodes, and what it shows of itself.
#include <algorithm>

#include "core/limb/limb_controller.hpp"

namespace crux {

void LimbController::write(NodeMode joint_mode, NodeMode gripper_mode,
                           crux_msgs::control_output_t& out) const noexcept {
  const JointVector unled_rad = transmission_.actuators_rad(command_q_rad_);
  const JointVector led_rad = command_q_rad_ + setpoint_lead_rad_;
  JointVector actuators_rad = transmission_.actuators_rad(led_rad);
  JointVector actuators_rad_s = transmission_.actuator_ways(command_dq_rad_s_ + velocity_lead_rad_s_, led_rad);
  const JointVector actuators_Nm = transmission_.actuator_torque_Nm(command_torque_Nm_, q_rad_);
  for (int j = 0; j < kJoints; ++j) {
    // A lead beyond what a node takes would be clamped there, and reported.
    const JointLimits& limits = actuators_[j];
    actuators_rad[j] = std::clamp(actuators_rad[j], std::min(unled_rad[j], limits.lower_rad),
                                  std::max(unled_rad[j], limits.upper_rad));
    actuators_rad_s[j] = std::clamp(actuators_rad_s[j], -limits.velocity_rad_s, limits.velocity_rad_s);
  }
  for (int j = 0; j < kJoints; ++j) {
    const int i = limb_ * kJoints + j;
    out.joint_mode[i] = static_cast<std::int8_t>(joint_mode);
    out.joint_position_rad[i] = encoders_.raw_rad(j, actuators_rad[j]);
    out.joint_velocity_rad_s[i] = actuators_rad_s[j];
    out.joint_torque_nm[i] = actuators_Nm[j];
  }
  out.gripper_mode[limb_] = static_cast<std::int8_t>(gripper_mode);
  out.finger_opening_m[limb_] = fingers_.opening_command_m();
  out.finger_speed_limit_m_s[limb_] = gripper_.max_finger_speed_m_s;
  out.finger_force_limit_n[limb_] = gripper_.max_finger_force_N;
}

void LimbController::write(const Pose& body_W, const Wrench& wrench_reference_W,
                           crux_msgs::limb_telemetry_t& out) const noexcept {
  const Pose gripper_W = body_W * state_.gripper_B;
  const std::array<double, 4> quaternion = quaternion_wxyz(gripper_W.rotation);
  out.limb = static_cast<std::int8_t>(limb_);
  std::copy(quaternion.begin(), quaternion.end(), out.gripper_quaternion_w);
  for (int i = 0; i < 3; ++i) {
    out.gripper_position_w_m[i] = gripper_W.position_m[i];
    out.force_w_n[i] = wrench_W().force_N[i];
    out.moment_w_nm[i] = wrench_W().moment_Nm[i];
    out.force_reference_w_n[i] = wrench_reference_W.force_N[i];
    out.moment_reference_w_nm[i] = wrench_reference_W.moment_Nm[i];
    out.admittance_offset_m[i] = admittance_.offset_m()[i];
    out.admittance_rotation_rad[i] = admittance_.rotation_rad()[i];
    out.tare_force_g_n[i] = wrench_.bias_G().force_N[i];
    out.tare_moment_g_nm[i] = wrench_.bias_G().moment_Nm[i];
  }
  const AdmittanceParameters& a = admittance_.parameters();
  const std::array<double, 6> gains = {a.mass_kg,
                                       a.damping_Ns_m,
                                       a.stiffness_N_m,
                                       a.inertia_kg_m2,
                                       a.rotational_damping_Nms_rad,
                                       a.rotational_stiffness_Nm_rad};
  std::copy(gains.begin(), gains.end(), out.admittance_gains);
  out.grasp_force_reference_n = fingers_.force_reference_N();
  out.grasp_force_n = fingers_.measured_force_N();
  out.ik_limited = static_cast<std::int8_t>(ik_.limited);
}

}  // namespace crux
