// How late a joint's answer may come before its position loop oscillates.
#pragma once

#include <vector>

#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Position loops of a limb's actuators.
struct JointLoops {
  JointVector position_gain_Nm_rad;
  JointVector velocity_gain_Nms_rad;
  JointVector damping_Nms_rad;  ///< viscous friction
  double lag_s = 0.0;           ///< of the torque
};

/// Mass matrices, with rotors, as its actuators feel a limb in the air, in the postures that
/// msgs/python/crux_contracts/ joint_loop_checks.py names; the fingers are closed.
std::vector<JointMatrix> limb_inertias(const LimbDescription& limb, const JointVector& armature_kg_m2);

/// Delay at which the loops begin to oscillate with that mass matrix: the least (π + arg λ) / ω over the frequencies ω
/// at which an eigenvalue λ of (M·s² + b·s)⁻¹ (k_d·s + k_p) / (1 + T·s), s = jω, has absolute value 1 (generalised
/// Nyquist criterion); infinite where none has.
double delay_margin_s(const JointMatrix& inertia, const JointLoops& loops);

/// Refuses gains of robot.yaml at `path` that leave less than kDeadTimeMargin times `dead_time_s`; gives the margin in
/// the worst posture.
double checked_delay_margin_s(const LimbDescription& limb, const JointLoops& loops, const JointVector& armature_kg_m2,
                              double dead_time_s, const std::string& path);

}  // namespace crux
