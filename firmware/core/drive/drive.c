#include "drive.h"

#include <math.h>

#define HALF_PI 1.57079633F

/// A supply further than this from its nominal voltage is measured wrongly.
#define SUPPLY_LOWEST 0.5F
#define SUPPLY_HIGHEST 1.5F

/// No control overshoots to so many times the peak current.
#define WILD_CURRENTS 2.0F
#define WILD_PERIODS 20U

/// Control periods come every millisecond; ten that fail are code that hangs.
#define MAX_SILENCE_S 0.01F

void crux_drive_init(crux_drive *drive, const crux_motor_parameters *motor, uint32_t electrical_offset_counts,
                     const crux_drive_timing *timing) {
  *drive = (crux_drive){
      .motor = *motor,
      .electrical_offset_counts = electrical_offset_counts,
      .supply_V = motor->supply_V,
      .outputs = {.duty = {0.5F, 0.5F, 0.5F}},
      .standing_duty = {0.5F, 0.5F, 0.5F},
  };
  crux_encoder_init(&drive->encoder, motor, timing->period_s, timing->encoder_age_s);
  crux_heat_init(&drive->heat, motor);
  crux_current_control_init(&drive->current, motor, timing->period_s);
}

/// Current of a field that stands: it holds by its strength, so it gets all that the winding bears for good.
static float standing_A(const crux_drive *drive) {
  const float wanted_A = drive->quadrature_wanted_A;
  return copysignf(fmaxf(fabsf(wanted_A), drive->motor.continuous_current_A), wanted_A);
}

/// Without feedback: at right angles to the magnets, on the side that makes the torque wanted last.
static void stand_by_voltage(const crux_drive *drive, float duty[3]) {
  const float side_rad = copysignf(HALF_PI, drive->quadrature_wanted_A);
  crux_current_control_stand(&drive->motor, drive->standing_rad + side_rad, drive->motor.continuous_current_A,
                             drive->supply_V, duty);
}

static void judge_currents(crux_drive *drive, const crux_drive_inputs *inputs) {
  const float limit_A = WILD_CURRENTS * drive->motor.peak_current_A;
  const float phase_c_A = -inputs->phase_a_A - inputs->phase_b_A;
  const bool can_be =
      (fabsf(inputs->phase_a_A) <= limit_A) && (fabsf(inputs->phase_b_A) <= limit_A) && (fabsf(phase_c_A) <= limit_A);
  drive->wild_periods = can_be ? 0U : (drive->wild_periods + 1U);
  drive->current_lost = drive->current_lost || (drive->wild_periods >= WILD_PERIODS);
}

void crux_drive_step(crux_drive *drive, const crux_drive_inputs *inputs) {
  const bool silent = ((float)drive->silent_periods * drive->encoder.period_s) > MAX_SILENCE_S;
  drive->silent_periods += silent ? 0U : 1U;
  crux_encoder_step(&drive->encoder, inputs->encoder_raw, inputs->encoder_valid);
  judge_currents(drive, inputs);
  drive->supply_V =
      fminf(fmaxf(inputs->supply_V, SUPPLY_LOWEST * drive->motor.supply_V), SUPPLY_HIGHEST * drive->motor.supply_V);
  const bool stands = silent || !crux_drive_measures(drive);
  if (drive->encoder.seen && !(stands && drive->placed)) {
    drive->standing_rad =
        crux_encoder_electrical_rad(&drive->encoder, drive->motor.pole_pairs, drive->electrical_offset_counts);
    // A field that stands from the start lies along the magnets: they are in the middle of what it holds.
    drive->standing_rad -= stands ? copysignf(HALF_PI, drive->quadrature_wanted_A) : 0.0F;
    drive->placed = true;
  }
  const crux_current_inputs current = {
      .phase_a_A = inputs->phase_a_A,
      .phase_b_A = inputs->phase_b_A,
      .supply_V = drive->supply_V,
      .angle_rad = drive->standing_rad,
      .speed_rad_s = stands ? 0.0F : ((float)drive->motor.pole_pairs * drive->encoder.speed_rad_s),
      .quadrature_wanted_A = stands ? standing_A(drive) : drive->quadrature_wanted_A,
  };
  crux_current_control_step(&drive->current, &current, &drive->outputs);
  if (drive->current_lost) {
    stand_by_voltage(drive, drive->outputs.duty);
  }
}

void crux_drive_forget(crux_drive *drive) {
  drive->current.direct_integral_V = 0.0F;
  drive->current.quadrature_integral_V = 0.0F;
}

void crux_drive_tick(crux_drive *drive, float dt_s, float rotor_torque_Nm, float temperature_degC) {
  const float direct_A = drive->outputs.direct_A;
  const float quadrature_A = drive->outputs.quadrature_A;
  crux_heat_tick(&drive->heat, &drive->motor, dt_s, sqrtf((direct_A * direct_A) + (quadrature_A * quadrature_A)),
                 temperature_degC);
  const float wanted_A = crux_drive_measures(drive) ? (rotor_torque_Nm / crux_motor_torque_constant(&drive->motor))
                                                    : drive->quadrature_wanted_A;
  drive->quadrature_wanted_A = fminf(fmaxf(wanted_A, -drive->heat.allowed_A), drive->heat.allowed_A);
  drive->silent_periods = 0U;
  stand_by_voltage(drive, drive->standing_duty);
}

bool crux_drive_measures(const crux_drive *drive) {
  return drive->at_home && !drive->encoder.lost && !drive->current_lost;
}

float crux_drive_rotor_torque_Nm(const crux_drive *drive) {
  return crux_motor_torque_constant(&drive->motor) * drive->outputs.quadrature_A;
}
