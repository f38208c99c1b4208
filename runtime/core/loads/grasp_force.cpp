#include "core/loads/grasp_force.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>

namespace crux {
namespace {

constexpr double kSensorsApart_N = 5.0;  // finger force and opening of one gripper

/// What one pad bears: along its face, and how hard it is pressed, each without squeeze and a newton of it.
struct PadLoad {
  Vector3 along_N = Vector3::Zero(), along_by = Vector3::Zero();
  double pressed_N = 0.0, pressed_by = 0.0;
  double twist_N = 0.0;

  PadLoad(const PadForm& form, const Vector6& wrench_W) {
    const Vector3 force_N = form.force * wrench_W;
    pressed_N = force_N.dot(form.normal_W);
    pressed_by = form.by_squeeze.dot(form.normal_W);
    along_N = force_N - pressed_N * form.normal_W;
    along_by = form.by_squeeze - pressed_by * form.normal_W;
    twist_N = form.twist * wrench_W;
  }

  /// The least squeeze [N] with which `factor` times the demand is within friction: the larger root of a quadratic.
  double least_squeeze_N(double friction, double factor) const {
    const double mu2 = friction * friction, f2 = factor * factor;
    const double square = mu2 * pressed_by * pressed_by - f2 * along_by.squaredNorm();
    if (square <= 0.0) return kNoSqueeze_N;
    const double both = along_N.dot(along_by), demand2 = along_N.squaredNorm() + twist_N * twist_N;
    const double apart2 = (pressed_by * along_N - pressed_N * along_by).squaredNorm();
    const double root2 = f2 * mu2 * (apart2 + pressed_by * pressed_by * twist_N * twist_N) -
                         f2 * f2 * (along_by.squaredNorm() * demand2 - both * both);
    const double half_slope = mu2 * pressed_N * pressed_by - f2 * both;
    return (std::sqrt(std::max(root2, 0.0)) - half_slope) / square;
  }
};

Vector6 stacked(const Wrench& wrench) {
  Vector6 vector;
  vector << wrench.force_N, wrench.moment_Nm;
  return vector;
}

}  // namespace

PadForm pad_form(const Vector3& finger_axis_W, int finger, const Contact& contact) {
  const Vector3 &e = finger_axis_W, up = Vector3::UnitZ();  // grippers on faces that lean are upright
  const double side = finger == 0 ? 1.0 : -1.0;
  PerFinger<Vector3> normal, touch_m;
  for (int f = 0; f < 2; ++f) {
    const Vector3 outward = f == 0 ? e : Vector3(-e);
    normal[f] = std::cos(contact.lean_rad[f]) * outward + std::sin(contact.lean_rad[f]) * up;
    touch_m[f] = contact.pad_radius_m * (outward - normal[f]);
  }
  const Matrix3 couple = -skew(e) / (2.0 * contact.half_opening_m);  // M × e = −e × M
  const Matrix3 to_middle = -skew(0.5 * (touch_m[0] + touch_m[1]));  // of the moment, where the pads touch
  PadForm form;
  form.force << 0.5 * Matrix3::Identity() + side * couple * to_middle, side * couple;
  const Vector3 apart_m = touch_m[0] - touch_m[1];
  // The couple's forces turn about e where one pad touches lower than the other.
  const Eigen::RowVector3d turn = e.transpose() * (Matrix3::Identity() - skew(apart_m) * couple) /
                                  (e.dot(normal[0] - normal[1]) * contact.patch_k_m);
  form.twist << turn * to_middle, turn;
  form.by_squeeze = side * (e - couple * apart_m.cross(e));
  form.normal_W = normal[finger];
  return form;
}

double needed_grasp_force_N(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                            const ControlParameters& control) {
  double needed_N = 0.0;
  for (int finger = 0; finger < 2; ++finger) {
    const PadLoad pad(pad_form(finger_axis_W, finger, contact), stacked(wrench_W));
    needed_N = std::max(needed_N, pad.least_squeeze_N(contact.friction, control.grasp_force_factor));
  }
  return needed_N + control.grasp_force_reserve_N;
}

double required_grasp_force_N(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                              const ControlParameters& control) {
  const double needed_N = needed_grasp_force_N(wrench_W, finger_axis_W, contact, control);
  return std::min(std::max(needed_N, control.min_grasp_force_N), contact.max_normal_N);
}

double limit_surface_utilisation(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                                 double squeeze_N) {
  double worst = 0.0;
  for (int finger = 0; finger < 2; ++finger) {
    const PadLoad pad(pad_form(finger_axis_W, finger, contact), stacked(wrench_W));
    const double pressed_N = squeeze_N * pad.pressed_by + pad.pressed_N;
    const double demand_N = std::hypot((pad.along_N + squeeze_N * pad.along_by).norm(), pad.twist_N);
    const double bearable_N = contact.friction * std::max(pressed_N, 0.0);
    const bool slight = demand_N < kMostUtilisation * bearable_N;
    worst = std::max(worst, slight ? demand_N / bearable_N : kMostUtilisation);
  }
  return worst;
}

void GraspController::reset(double opening_m, double force_N) noexcept {
  // The actuator's position loop gives stiffness·(opening − command) when it stands; its least opening bounds that.
  opening_command_m_ = std::max(opening_m - std::max(force_N, 0.0) / gripper_.stiffness_N_m, gripper_.opening_m.low);
  force_reference_N_ = std::max(force_N, 0.0);
  pace_.stand_at(opening_command_m_);
}

double GraspController::expected_force_N(double opening_m, double speed_m_s) const noexcept {
  return std::clamp(gripper_.stiffness_N_m * (opening_m - pace_.setpoint_m()) + gripper_.damping_Ns_m * speed_m_s,
                    -gripper_.max_finger_force_N, gripper_.max_finger_force_N);
}

void GraspController::open_to(double opening_m, double dt_s) noexcept {
  const double step_m = gripper_.max_finger_speed_m_s * dt_s;
  const double next_m = opening_command_m_ + std::clamp(opening_m - opening_command_m_, -step_m, step_m);
  opening_command_m_ = pace_.follow(next_m, seen_m_, dt_s);
  force_reference_N_ = 0.0;
}

void GraspController::press(double wanted_force_N, double measured_force_N, double opening_m, double dt_s) noexcept {
  double speed_m_s = -(hurries_ ? gripper_.max_finger_speed_m_s : control_.closing_speed_m_s);
  double most_m = gripper_.opening_m.high;
  if (touches(measured_force_N)) {
    // From the force of first touch upwards, so that the grip does not jump.
    force_reference_N_ =
        std::max(force_reference_N_, measured_force_N < wanted_force_N ? control_.contact_force_N : 0.0);
    force_reference_N_ += dt_s / (control_.grasp_force_time_constant_s + dt_s) * (wanted_force_N - force_reference_N_);
    speed_m_s = std::clamp((measured_force_N - force_reference_N_) / control_.grasp_damping_Ns_m,
                           -gripper_.max_finger_speed_m_s, gripper_.max_finger_speed_m_s);
    // A sensor that says too much opens the grip no further than to about the wanted force by its opening.
    const double least_N = std::max(force_reference_N_ - kSensorsApart_N, control_.min_grasp_force_N);
    most_m = std::min(most_m, std::max(opening_m - least_N / gripper_.stiffness_N_m, opening_command_m_));
  }
  // No further than the actuator closes: against wind-up on nothing.
  const double next_m = std::clamp(opening_command_m_ + dt_s * speed_m_s, gripper_.opening_m.low, most_m);
  opening_command_m_ = pace_.follow(next_m, seen_m_, dt_s);
}

}  // namespace crux
