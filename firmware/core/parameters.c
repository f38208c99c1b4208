#include "parameters.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

/// An E2E counter counts 256 frames, so silence must be noticed well within half of that.
#define MAX_WATCHDOG_CYCLES 100U
#define MAX_PERIOD_US 100000U

static bool positive(float value) { return isfinite(value) && (value > 0.0F); }

static bool not_negative(float value) { return isfinite(value) && (value >= 0.0F); }

static bool is_range(float lower, float upper) { return isfinite(lower) && isfinite(upper) && (lower < upper); }

static const char *timing_fault(uint32_t period_us, uint32_t watchdog_cycles) {
  if ((period_us == 0U) || (period_us > MAX_PERIOD_US)) {
    return "period_us";
  }
  if ((watchdog_cycles == 0U) || (watchdog_cycles > MAX_WATCHDOG_CYCLES)) {
    return "watchdog_cycles";
  }
  return NULL;
}

const char *crux_joint_parameters_fault(const crux_joint_parameters *parameters) {
  const char *fault = timing_fault(parameters->period_us, parameters->watchdog_cycles);
  if (!is_range(parameters->position_min_rad, parameters->position_max_rad)) {
    fault = "position_min_rad, position_max_rad";
  } else if (!positive(parameters->velocity_limit_rad_s)) {
    fault = "velocity_limit_rad_s";
  } else if (!positive(parameters->torque_limit_Nm)) {
    fault = "torque_limit_Nm";
  } else if (!positive(parameters->position_gain_Nm_rad)) {
    fault = "position_gain_Nm_rad";
  } else if (!not_negative(parameters->velocity_gain_Nms_rad)) {
    fault = "velocity_gain_Nms_rad";
  } else if (!not_negative(parameters->setpoint_time_constant_s)) {
    fault = "setpoint_time_constant_s";
  } else if (!positive(parameters->max_deceleration_rad_s2)) {
    fault = "max_deceleration_rad_s2";
  } else if (!positive(parameters->temperature_limit_degC)) {
    fault = "temperature_limit_degC";
  } else {
    // the timing's verdict stands
  }
  return fault;
}

const char *crux_gripper_parameters_fault(const crux_gripper_parameters *parameters) {
  const char *fault = timing_fault(parameters->period_us, parameters->watchdog_cycles);
  if (!is_range(parameters->opening_min_m, parameters->opening_max_m)) {
    fault = "opening_min_m, opening_max_m";
  } else if (!positive(parameters->speed_limit_m_s)) {
    fault = "speed_limit_m_s";
  } else if (!positive(parameters->force_limit_N)) {
    fault = "force_limit_N";
  } else if (!positive(parameters->stiffness_N_m)) {
    fault = "stiffness_N_m";
  } else if (!not_negative(parameters->damping_Ns_m)) {
    fault = "damping_Ns_m";
  } else if (!positive(parameters->force_range_N)) {
    fault = "force_range_N";
  } else if (!positive(parameters->moment_range_Nm)) {
    fault = "moment_range_Nm";
  } else if (!positive(parameters->temperature_limit_degC)) {
    fault = "temperature_limit_degC";
  } else {
    // the timing's verdict stands
  }
  return fault;
}
