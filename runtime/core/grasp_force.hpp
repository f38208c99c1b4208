// How hard the fingers must press, and the opening command that makes the linear actuator press so.
#pragma once

#include "core/geometry.hpp"
#include "core/robot_description.hpp"

namespace crux {

/// What a pad bears along its face: across the face along the wall, along the wall's normal z, and about the face's
/// normal as a force, m/k [N]. Equation (2) bounds its norm, (3) each of its components.
using PadShear = Vector3;

using PerFinger = Eigen::Vector2d;  ///< of fingers 1 and 2 of a gripper

struct Contact {
  PerFinger friction = PerFinger::Zero();
  double patch_k_m = 0.0;       ///< k of equation (2)
  double max_normal_N = 0.0;    ///< of the plan's hold and the robot's actuator
  double half_opening_m = 0.0;  ///< pad face to gripper centre
  /// Most that the spines of fingers 1 and 2 hold by themselves (3), a column each; 0 where they are not counted on.
  Eigen::Matrix<double, 3, 2> spines_N = Eigen::Matrix<double, 3, 2>::Zero();
};

/// (F, M).
Vector6 stacked(const Wrench& wrench);

/// PadShear of a finger (0, 1) of the wrench (F, M) on the robot about the gripper centre, both pads at ±half opening a
/// along the finger axis e (unit vector along the wall, towards finger 1). By (4) they share shear and twist; a moment
/// across e is a couple of tangential forces on the arm 2a: t = F_t/2 ± M×e/(2a), m = M·e/2.
Eigen::Matrix<double, 3, 6> pad_map(const Vector3& finger_axis_W, int finger, const Contact& contact);

/// What spines leave of it for friction: a wrench is in the sum of (2) and (3) where this is in (2).
PadShear left_by_spines(const PadShear& shear_N, const Contact& contact, int finger);

/// Squeeze [N] a finger needs so that both pads bear `wrench_W`: normal forces are squeeze ± F·e/2, so by (2) the
/// larger of  factor·√(|t|² + (m/k)²)/μ ∓ F·e/2  of the two pads, t and m as spines leave them, and a reserve.
double needed_grasp_force_N(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                            const ControlParameters& control);

/// The same between the least grasp force and the most that the contact allows.
double required_grasp_force_N(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                              const ControlParameters& control);

/// Share of the limit surface (2) that `wrench_W` uses where the fingers press with `squeeze_N`, of the pad that is
/// closer to slipping. At 1 it slips; at most 10, also where a pad does not press at all.
double limit_surface_utilisation(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                                 double squeeze_N);

/// One gripper's actuator: it is commanded by opening and measures force through its motor current.
class GraspController {
 public:
  GraspController(const GripperDescription& gripper, const ControlParameters& control)
      : gripper_(gripper), control_(control) {}

  /// Takes over from an actuator at rest without a jolt.
  void reset(double opening_m, double force_N) noexcept;

  /// In the air: moves towards `opening_m`.
  void open_to(double opening_m, double dt_s) noexcept;

  /// On a hold: closes until the fingers touch, then makes them press with `force_N`: opening speed = force error / D.
  void press(double wanted_force_N, double measured_force_N, double opening_m, double dt_s) noexcept;

  /// Squeeze [N] that the actuator makes of its command where the fingers stand `opening_m` apart and move.
  double expected_force_N(double opening_m, double speed_m_s) const noexcept;

  double opening_command_m() const { return opening_command_m_; }
  double force_reference_N() const { return force_reference_N_; }

 private:
  GripperDescription gripper_;
  ControlParameters control_;
  double opening_command_m_ = 0.0;
  double force_reference_N_ = 0.0;
};

}  // namespace crux
