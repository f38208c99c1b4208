// How hard the fingers must press, and the opening command that makes the linear actuator press so.
#pragma once

#include <array>

#include "core/loads/actuator_pace.hpp"
#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

inline constexpr double kNoSqueeze_N = 1e3;
inline constexpr double kMostUtilisation = 10.0;  ///< of a pad or foot that all but hangs in the air
template <class T>
using PerFinger = std::array<T, 2>;

struct Contact {
  double friction = 0.0;
  double patch_k_m = 0.0;        ///< k of equation (2)
  double max_normal_N = 0.0;     ///< of the plan's hold and the robot's actuator
  double half_opening_m = 0.0;   ///< pad face to gripper centre
  PerFinger<double> lean_rad{};  ///< of the faces' normals off the wall, in W
  double pad_radius_m = 0.0;     ///< pads are balls, which touch a leaning face beside the finger axis
};

/// How one pad, at side·axis, bears a wrench (F, M) on the robot about the gripper centre and a squeeze P: its force is
/// force·(F, M) + P·by_squeeze, its twist, as a force at k, twist·(F, M). The pads touch at ±half opening a along the
/// axis e, on faces with normals n that lean by t beside it. By (4) they share what is across e and the twist; a moment
/// across e is a couple of forces across e on the arm 2a.
struct PadForm {
  Eigen::Matrix<double, 3, 6> force;
  Eigen::Matrix<double, 1, 6> twist;
  Vector3 by_squeeze;
  Vector3 normal_W;
};
PadForm pad_form(const Vector3& finger_axis_W, int finger, const Contact& contact);

/// Squeeze [N] a finger needs so that friction alone, without spines, bears `wrench_W` [on the robot about the gripper
/// centre] in both pads, at ±half opening a along the finger axis e (unit vector, towards finger 1). By (4) they share
/// shear and twist; a moment across e is a couple of tangential forces on the arm 2a:
///   t = F_t/2 ± M×e/(2a),  m = M·e/2,  normal forces squeeze ± F·e/2,
/// so by (2) the larger of  factor·√(|t|² + (m/k)²)/μ ∓ F·e/2  of the two pads, and a reserve. On faces that lean, the
/// least squeeze with which force and twist of `pad_form` are in the cone about the face's normal; kNoSqueeze_N where
/// no squeeze is enough.
double needed_grasp_force_N(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                            const ControlParameters& control);

/// The same between the least grasp force and the most that the contact allows.
double required_grasp_force_N(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                              const ControlParameters& control);

/// Share of the limit surface (2) that `wrench_W` uses where the fingers press with `squeeze_N`, of the pad that is
/// closer to slipping; spines are not counted on. At 1 it slips; at most 10, also where a pad does not press at all.
double limit_surface_utilisation(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                                 double squeeze_N);

/// One gripper's actuator: it is commanded by opening and measures force through its motor current.
class GraspController {
 public:
  GraspController(const GripperDescription& gripper, const ControlParameters& control)
      : gripper_(gripper), control_(control), pace_(gripper) {}

  /// Takes over from an actuator at rest without a jolt.
  void reset(double opening_m, double force_N) noexcept;

  /// What the sensors say of the fingers, before each command.
  void see(double opening_m, double speed_m_s, double force_N) noexcept {
    seen_m_ = opening_m - (force_N - gripper_.damping_Ns_m * speed_m_s) / gripper_.stiffness_N_m;
  }

  /// In the air: moves towards `opening_m`.
  void open_to(double opening_m, double dt_s) noexcept;

  /// On a hold: closes until the fingers touch, then makes them press with `force_N`: opening speed = force error / D.
  void press(double wanted_force_N, double measured_force_N, double opening_m, double dt_s) noexcept;
  /// Fingers that press less are still on their way.
  bool touches(double force_N) const noexcept { return force_N >= kTouchShare * control_.contact_force_N; }
  /// It closes as fast as it can from now on, or no longer.
  void hurry(bool hurries) noexcept { hurries_ = hurries; }

  /// Squeeze [N] that the actuator, as quick as it was found to be, makes of its commands where the fingers stand
  /// `opening_m` apart and move.
  double expected_force_N(double opening_m, double speed_m_s) const noexcept;

  double opening_command_m() const { return opening_command_m_; }
  double force_reference_N() const { return force_reference_N_; }

 private:
  static constexpr double kTouchShare = 0.3;  // of the contact force

  GripperDescription gripper_;
  ControlParameters control_;
  ActuatorPace pace_;
  double opening_command_m_ = 0.0;
  double seen_m_ = 0.0;  ///< the actuator's setpoint by see()
  double force_reference_N_ = 0.0;
  bool hurries_ = false;
};

}  // namespace crux
