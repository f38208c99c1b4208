#include "motor.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#define MAX_POLE_PAIRS 50U
#define MIN_ENCODER_COUNTS 64U
#define MAX_ENCODER_COUNTS 65536U

static bool positive(float value) { return isfinite(value) && (value > 0.0F); }

static bool is_share(float value) { return positive(value) && (value <= 1.0F); }

const char *crux_motor_parameters_fault(const crux_motor_parameters *motor) {
  const char *fault = NULL;
  if ((motor->pole_pairs == 0U) || (motor->pole_pairs > MAX_POLE_PAIRS)) {
    fault = "pole_pairs";
  } else if (!positive(motor->resistance_ohm)) {
    fault = "resistance_ohm";
  } else if (!positive(motor->inductance_H)) {
    fault = "inductance_H";
  } else if (!positive(motor->flux_Wb)) {
    fault = "flux_Wb";
  } else if (!positive(motor->peak_current_A)) {
    fault = "peak_current_A";
  } else if (!positive(motor->continuous_current_A) || (motor->continuous_current_A > motor->peak_current_A)) {
    fault = "continuous_current_A";
  } else if (!positive(motor->heating_time_s)) {
    fault = "heating_time_s";
  } else if (!positive(motor->bandwidth_rad_s)) {
    fault = "bandwidth_rad_s";
  } else if (!positive(motor->max_speed_rad_s)) {
    fault = "max_speed_rad_s";
  } else if ((motor->encoder_counts < MIN_ENCODER_COUNTS) || (motor->encoder_counts > MAX_ENCODER_COUNTS)) {
    fault = "encoder_counts";
  } else if (!positive(motor->supply_V)) {
    fault = "supply_V";
  } else if (!positive(motor->temperature_limit_degC)) {
    fault = "temperature_limit_degC";
  } else {
    // all of them make sense
  }
  return fault;
}

const char *crux_gear_parameters_fault(const crux_gear_parameters *gear) {
  const char *fault = NULL;
  if (!positive(gear->ratio)) {
    fault = "ratio";
  } else if (!is_share(gear->efficiency)) {
    fault = "efficiency";
  } else {
    // both make sense
  }
  return fault;
}

const char *crux_screw_parameters_fault(const crux_screw_parameters *screw) {
  const char *fault = NULL;
  if (!positive(screw->lead_m)) {
    fault = "lead_m";
  } else if (!is_share(screw->efficiency)) {
    fault = "efficiency";
  } else if (!is_share(screw->release_torque)) {
    fault = "release_torque";
  } else if (!positive(screw->inertia_kg_m2)) {
    fault = "inertia_kg_m2";
  } else if (!isfinite(screw->drag_Nms_rad) || (screw->drag_Nms_rad < 0.0F)) {
    fault = "drag_Nms_rad";
  } else {
    // all of them make sense
  }
  return fault;
}

float crux_motor_torque_constant(const crux_motor_parameters *motor) {
  return 1.5F * (float)motor->pole_pairs * motor->flux_Wb;
}
