#include "core/motor_checks.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/description_problem.hpp"
#include "core/stability.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {
namespace {

namespace bounds = crux_msgs::robot;

void check_speed(const YamlSection& file, const std::string& path, const std::string& name, double fastest_rad_s) {
  const double most_rad_s = file.section(name).number("max_speed_rad_s");
  if (most_rad_s <= fastest_rad_s)
    refuse(path, name + ".max_speed_rad_s", shown(most_rad_s),
           "expected more than the " + shown(fastest_rad_s, "%.4g") + " that the speed limit asks of the rotor");
}

/// Continuous current at full speed must be within what the supply makes: the circle of radius supply / sqrt 3.
void check_voltage(const YamlSection& file, const std::string& path, const std::string& name, double fastest_rad_s) {
  const YamlSection motor = file.section(name);
  const double current_A = motor.number("continuous_current_A"), pole_pairs = motor.number("pole_pairs");
  const double electrical_rad_s = pole_pairs * fastest_rad_s;
  const double flux_Wb = motor.number("torque_constant_Nm_A") / (1.5 * pole_pairs);
  const double along_V = motor.number("resistance_ohm") * current_A + electrical_rad_s * flux_Wb;
  const double across_V = electrical_rad_s * motor.number("inductance_H") * current_A;
  const double needed_V = std::sqrt(3.0) * std::hypot(along_V, across_V);
  const double supply_V = file.section("drive").number("supply_V");
  if (needed_V > supply_V)
    refuse(path, "drive.supply_V", shown(supply_V),
           "expected at least " + shown(needed_V, "%.3g") + ", for " + name + "'s continuous current at full speed");
}

void check_damping(const YamlSection& admittance, const std::string& path, const std::string& key,
                   const std::string& mass, const std::string& spring, const std::string& environment) {
  const double delay_s = admittance.number("delay_s"), damping = admittance.number(key);
  const double least =
      least_damping(admittance.number(mass), admittance.number(spring), admittance.number(environment), delay_s);
  if (damping < least)
    refuse(path, "admittance." + key, shown(damping),
           "expected at least " + shown(least, "%.4g") + ": stable against " + shown(bounds::kGainMargin) + " times " +
               environment + ", felt " + shown(delay_s) + " s late");
}

}  // namespace

void check_motors(const YamlSection& file, const std::string& path, double fastest_rad_s) {
  const YamlSection motor = file.section("motor");
  const double ratio = motor.number("gear_ratio");
  const double Nm_A = ratio * motor.number("gear_efficiency") * motor.number("torque_constant_Nm_A");
  const double current_A = motor.number("continuous_current_A");
  const double asked_Nm = std::ranges::max(file.section("servo").numbers<kJoints>("continuous_torque_Nm"));
  if (current_A * Nm_A < asked_Nm)
    refuse(path, "motor.continuous_current_A", shown(current_A),
           "expected at least " + shown(asked_Nm / Nm_A, "%.3g") + ", for the " + shown(asked_Nm) +
               " Nm of continuous_torque_Nm");
  check_speed(file, path, "motor", fastest_rad_s * ratio);
  check_voltage(file, path, "motor", fastest_rad_s * ratio);

  const YamlSection gripper = file.section("gripper"), screw = file.section("gripper_motor");
  const auto [low_m, high_m] = gripper.numbers<2>("opening_m");
  if (const double open_m = gripper.number("open_opening_m"); open_m < low_m || open_m > high_m)
    refuse(path, "gripper.open_opening_m", shown(open_m),
           "expected " + shown(low_m) + ".." + shown(high_m) + ", opening_m");
  if (const double efficiency = screw.number("screw_efficiency"); efficiency >= 0.5)
    refuse(path, "gripper_motor.screw_efficiency", shown(efficiency),
           "expected below 0.5: the screw must hold a squeeze by itself");
  if (const double coarse_m = screw.number("coarse_travel_m"); coarse_m <= high_m - low_m)
    refuse(path, "gripper_motor.coarse_travel_m", shown(coarse_m),
           "expected more than the travel of the fingers, " + shown(high_m - low_m) +
               ": the encoder must not repeat in it");
  const double fastest = gripper.number("max_finger_speed_m_s") / screw.number("screw_lead_m") * 2.0 * std::numbers::pi;
  check_speed(file, path, "gripper_motor", fastest);
  check_voltage(file, path, "gripper_motor", fastest);
}

void check_gains(const YamlSection& file, const std::string& path) {
  const YamlSection a = file.section("admittance");
  const double most_s = bounds::kMaxDelayCycles / file.section("can").number("rate_Hz");
  if (const double delay_s = a.number("delay_s"); delay_s > most_s)
    refuse(path, "admittance.delay_s", shown(delay_s),
           "expected at most " + shown(most_s) + ": " + std::to_string(bounds::kMaxDelayCycles) + " cycles");
  check_damping(a, path, "damping_Ns_m", "mass_kg", "stiffness_N_m", "environment_N_m");
  check_damping(a, path, "rotational_damping_Nms_rad", "inertia_kg_m2", "rotational_stiffness_Nm_rad",
                "environment_Nm_rad");
}

}  // namespace crux
