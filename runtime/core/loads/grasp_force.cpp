#include "core/loads/grasp_force.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>

namespace crux {
namespace {

constexpr double kSensorsApart_N = 5.0;    // finger force and opening of one gripper
constexpr double kMostUtilisation = 10.0;  // of a pad that all but hangs in the air

/// What one pad bears along its face, and how much harder than the squeeze the wrench presses it [N].
struct PadLoad {
  double demand_N = 0.0;
  double pressed_N = 0.0;
};

/// Of the pads at +axis and −axis.
std::array<PadLoad, 2> pad_loads(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact) {
  const double normal_N = wrench_W.force_N.dot(finger_axis_W);
  const Vector3 shear_W_N = 0.5 * (wrench_W.force_N - normal_N * finger_axis_W);
  const Vector3 couple_W_N = wrench_W.moment_Nm.cross(finger_axis_W) / (2.0 * contact.half_opening_m);
  const double twist_N = 0.5 * wrench_W.moment_Nm.dot(finger_axis_W) / contact.patch_k_m;
  const auto pad = [&](double side) {
    return PadLoad{std::hypot((shear_W_N + side * couple_W_N).norm(), twist_N), side * 0.5 * normal_N};
  };
  return {pad(1.0), pad(-1.0)};
}

}  // namespace

double needed_grasp_force_N(const Wrench& wrench_W, const Vector3& finger_axis_W, const Contact& contact,
                            const ControlParameters& control) {
  double needed_N = 0.0;
  for (const PadLoad& pad : pad_loads(wrench_W, finger_axis_W, contact)) {
    needed_N = std::max(needed_N, control.grasp_force_factor * pad.demand_N / contact.friction - pad.pressed_N);
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
  for (const PadLoad& pad : pad_loads(wrench_W, finger_axis_W, contact)) {
    const double bearable_N = contact.friction * std::max(squeeze_N + pad.pressed_N, 0.0);
    const bool slight = pad.demand_N < kMostUtilisation * bearable_N;
    worst = std::max(worst, slight ? pad.demand_N / bearable_N : kMostUtilisation);
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
