// Equilibrium about the robot's centre of mass. A plan balances it at the knots; between them its wrenches blend while
// body and limbs move on, and the real robot is not quite where the plan has it. The smallest correction of the planned
// wrenches that makes them hold the robot as it stands.
#pragma once

#include "core/robot/geometry.hpp"

namespace crux {

/// What a limb on a foothold can bear: a force at its foot point, by friction, and never a pull.
struct FootCone {
  bool stands = false;  ///< the limb is on a foothold
  Vector3 normal_W = Vector3::UnitZ();
  double friction = 0.0;
  double max_normal_N = 0.0;
  Vector3 to_foot_W_m = Vector3::Zero();  ///< from the gripper centre

  /// The force it can bear that is nearest to `force_W_N`.
  Vector3 nearest_W_N(const Vector3& force_W_N) const noexcept;
  /// Share of the friction that a force uses: above 1 it slips; at most 10.
  double utilisation(const Vector3& force_W_N) const noexcept;
};

/// One limb as bearer of load.
struct Bearer {
  Vector3 position_W_m = Vector3::Zero();    ///< gripper centre, of one on a foothold its foot point
  Vector3 finger_axis_W = Vector3::UnitX();  ///< unit vector through both pads
  double load = 0.0;                         ///< 0..1
  Wrench planned_W;                          ///< about its position
  FootCone foot{};
  bool fixed = false;  ///< bears what is planned, and nothing else
};

/// Wrenches [on the robot, about each gripper centre] with Σ F = −weight and no net moment about `com_W_m`, nearest to
/// the planned ones: least Σ (|ΔF|² + (Δm/twist_length)²)/load, where Δm turns about the finger axis, the only moment
/// two fingers bear by friction alone. Limbs without load get nothing. With too few bearers it comes as near as they
/// can.
PerLimb<Wrench> balanced_wrenches(const PerLimb<Bearer>& limbs, const Vector3& com_W_m, const Vector3& weight_W_N,
                                  double twist_length_m) noexcept;

/// `wrenches`, balanced for `limbs`, with what feet on footholds cannot bear given to the others: a foot beyond its
/// cone bears the nearest force in it, and the rest are balanced anew about that. Wrenches of feet are about foot
/// points.
PerLimb<Wrench> within_cones(const PerLimb<Wrench>& wrenches, const PerLimb<Bearer>& limbs, const Vector3& com_W_m,
                             const Vector3& weight_W_N, double twist_length_m) noexcept;

/// Forces of point feet on one plane z = const, `wrenches` balanced there, with what acts along the plane shared anew:
/// the same normal forces, the same net force and moment, least Σ |f_t|²/fz. So every foot uses the same share of its
/// friction but for what turns the body. Balancing alone may halve a foot's planned normal force and leave it the
/// planned force along a slope, more than friction holds. Moments at the feet are left alone.
void share_along_plane(const PerLimb<Vector3>& foot_W_m, PerLimb<Wrench>& wrenches) noexcept;

}  // namespace crux
