#include "core/robot/motor_checks.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/robot/description_problem.hpp"
#include "core/robot/stability.hpp"

namespace crux {
namespace {

namespace bounds = crux_msgs::robot;

void check_speed(const bounds::Machine& motor, const std::string& path, const std::string& name, double fastest_rad_s) {
  if (motor.max_speed_rad_s <= fastest_rad_s)
    refuse(path, name + ".max_speed_rad_s", shown(motor.max_speed_rad_s),
           "expected more than the " + shown(fastest_rad_s, "%.4g") + " that the speed limit asks of the rotor");
}

/// Continuous current at full speed must be within what the supply makes: the circle of radius supply / sqrt 3.
void check_voltage(const bounds::Machine& motor, double supply_V, const std::string& path, const std::string& name,
                   double fastest_rad_s) {
  const double electrical_rad_s = motor.pole_pairs * fastest_rad_s;
  const double flux_Wb = motor.torque_constant_Nm_A / (1.5 * motor.pole_pairs);
  const double along_V = motor.resistance_ohm * motor.continuous_current_A + electrical_rad_s * flux_Wb;
  const double across_V = electrical_rad_s * motor.inductance_H * motor.continuous_current_A;
  const double needed_V = std::sqrt(3.0) * std::hypot(along_V, across_V);
  if (needed_V > supply_V)
    refuse(path, "drive.supply_V", shown(supply_V),
           "expected at least " + shown(needed_V, "%.3g") + ", for " + name + "'s continuous current at full speed");
}

void check_damping(double damping, double least, double delay_s, const std::string& path, const std::string& key,
                   const std::string& environment) {
  if (damping < least)
    refuse(path, "admittance." + key, shown(damping),
           "expected at least " + shown(least, "%.4g") + ": stable against " + shown(bounds::kGainMargin) + " times " +
               environment + ", felt " + shown(delay_s) + " s late");
}

}  // namespace

void check_motors(const bounds::Sections& robot, const std::string& path, double fastest_rad_s) {
  const bounds::Motor& motor = robot.motor;
  const double Nm_A = motor.gear_ratio * motor.gear_efficiency * motor.torque_constant_Nm_A;
  const double asked_Nm = std::ranges::max(robot.servo.continuous_torque_Nm);
  if (motor.continuous_current_A * Nm_A < asked_Nm)
    refuse(path, "motor.continuous_current_A", shown(motor.continuous_current_A),
           "expected at least " + shown(asked_Nm / Nm_A, "%.3g") + ", for the " + shown(asked_Nm) +
               " Nm of continuous_torque_Nm");
  check_speed(motor, path, "motor", fastest_rad_s * motor.gear_ratio);
  check_voltage(motor, robot.drive.supply_V, path, "motor", fastest_rad_s * motor.gear_ratio);

  const bounds::Gripper& gripper = robot.gripper;
  const bounds::GripperMotor& screw = robot.gripper_motor;
  const auto [low_m, high_m] = gripper.opening_m;
  if (gripper.open_opening_m < low_m || gripper.open_opening_m > high_m)
    refuse(path, "gripper.open_opening_m", shown(gripper.open_opening_m),
           "expected " + shown(low_m) + ".." + shown(high_m) + ", opening_m");
  if (screw.screw_efficiency >= 0.5)
    refuse(path, "gripper_motor.screw_efficiency", shown(screw.screw_efficiency),
           "expected below 0.5: the screw must hold a squeeze by itself");
  if (screw.coarse_travel_m <= high_m - low_m)
    refuse(path, "gripper_motor.coarse_travel_m", shown(screw.coarse_travel_m),
           "expected more than the travel of the fingers, " + shown(high_m - low_m) +
               ": the encoder must not repeat in it");
  const double fastest = gripper.max_finger_speed_m_s / screw.screw_lead_m * 2.0 * std::numbers::pi;
  check_speed(screw, path, "gripper_motor", fastest);
  check_voltage(screw, robot.drive.supply_V, path, "gripper_motor", fastest);
}

void check_gains(const bounds::Sections& robot, const std::string& path) {
  const bounds::Admittance& a = robot.admittance;
  const double most_s = bounds::kMaxDelayCycles / robot.can.rate_Hz;
  if (a.delay_s > most_s)
    refuse(path, "admittance.delay_s", shown(a.delay_s),
           "expected at most " + shown(most_s) + ": " + std::to_string(bounds::kMaxDelayCycles) + " cycles");
  check_damping(a.damping_Ns_m, least_damping(a.mass_kg, a.stiffness_N_m, a.environment_N_m, a.delay_s), a.delay_s,
                path, "damping_Ns_m", "environment_N_m");
  check_damping(a.rotational_damping_Nms_rad,
                least_damping(a.inertia_kg_m2, a.rotational_stiffness_Nm_rad, a.environment_Nm_rad, a.delay_s),
                a.delay_s, path, "rotational_damping_Nms_rad", "environment_Nm_rad");
  const double most_N_s = robot.control.unload_force_N / robot.control.force_filter_s;
  if (robot.grasp_test.rate_N_s > most_N_s)
    refuse(path, "grasp_test.rate_N_s", shown(robot.grasp_test.rate_N_s),
           "expected at most " + shown(most_N_s, "%.4g") + ": control.unload_force_N over control.force_filter_s");
}

}  // namespace crux
