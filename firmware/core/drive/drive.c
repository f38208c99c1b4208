#include "drive.h"

#include <math.h>

#include "codec.h"

#define HALF_PI 1.57079633F

/// A supply further than this from its nominal voltage is measured wrongly.
#define SUPPLY_LOWEST 0.5F
#define SUPPLY_HIGHEST 1.5F

/// No control overshoots to so many times the peak current.
#define WILD_CURRENTS 2.0F

/// Square of the difference between the currents measured and those that the voltage must have driven, against the
/// squares of the latter and of the peak current: more than a winding 30 % from its nominal resistance, dead time and
/// a flux 10 % from the description explain together.
#define MISFIT 0.1F
#define WILD_PERIODS 10U

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
      .stood = true,
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

/// Whether the phases can carry such currents, and no others than the voltage must have driven.
static bool can_be(const crux_drive *drive, const crux_drive_inputs *inputs, bool modelled) {
  const float peak_A = drive->motor.peak_current_A;
  const float limit_A = WILD_CURRENTS * peak_A;
  const float phase_c_A = -inputs->phase_a_A - inputs->phase_b_A;
  const bool fits = drive->outputs.misfit_A2 <= (MISFIT * ((peak_A * peak_A) + drive->outputs.modelled_A2));
  return (fabsf(inputs->phase_a_A) <= limit_A) && (fabsf(inputs->phase_b_A) <= limit_A) &&
         (fabsf(phase_c_A) <= limit_A) && (!modelled || fits);
}

static void judge_currents(crux_drive *drive, const crux_drive_inputs *inputs, bool modelled) {
  drive->wild_periods = can_be(drive, inputs, modelled) ? 0U : (drive->wild_periods + 1U);
  drive->current_lost = drive->current_lost || (drive->wild_periods >= WILD_PERIODS);
}

/// What is further from the nominal voltage is measured wrongly.
static float supply_V(const crux_drive *drive, float measured_V) {
  const float nominal_V = drive->motor.supply_V;
  const bool sensible = (measured_V >= (SUPPLY_LOWEST * nominal_V)) && (measured_V <= (SUPPLY_HIGHEST * nominal_V));
  return sensible ? measured_V : nominal_V;
}

void crux_drive_step(crux_drive *drive, const crux_drive_inputs *inputs) {
  const bool silent = ((float)drive->silent_periods * drive->encoder.period_s) > MAX_SILENCE_S;
  drive->silent_periods += silent ? 0U : 1U;
  crux_encoder_step(&drive->encoder, inputs->encoder_raw, inputs->encoder_valid);
  drive->supply_V = supply_V(drive, inputs->supply_V);
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
      .direct_wanted_A = stands ? 0.0F : drive->direct_wanted_A,
      .follow = inputs->bridge_stopped || (stands != drive->stood),
  };
  crux_current_control_step(&drive->current, &current, &drive->outputs);
  drive->stood = stands;
  judge_currents(drive, inputs, !stands);
  if (drive->current_lost) {
    stand_by_voltage(drive, drive->outputs.duty);
  }
}

void crux_drive_tick(crux_drive *drive, float dt_s, float rotor_torque_Nm, float temperature_degC) {
  const float direct_A = drive->outputs.direct_A;
  const float quadrature_A = drive->outputs.quadrature_A;
  crux_heat_tick(&drive->heat, &drive->motor, dt_s, sqrtf((direct_A * direct_A) + (quadrature_A * quadrature_A)),
                 temperature_degC);
  float wanted_A = drive->quadrature_wanted_A;
  if (crux_drive_measures(drive)) {
    wanted_A = rotor_torque_Nm / crux_motor_torque_constant(&drive->motor);
    const bool direct = drive->direction.direct;
    const float pulse_A = crux_direction_tick(&drive->direction, drive->encoder.speed_rad_s, quadrature_A, wanted_A);
    drive->direct_wanted_A = direct ? pulse_A : 0.0F;
    wanted_A += direct ? 0.0F : pulse_A;
  }
  drive->quadrature_wanted_A = fminf(fmaxf(wanted_A, -drive->heat.allowed_A), drive->heat.allowed_A);
  drive->silent_periods = 0U;
  stand_by_voltage(drive, drive->standing_duty);
}

bool crux_drive_sees(const crux_drive *drive) { return drive->at_home && !drive->encoder.lost; }

bool crux_drive_measures(const crux_drive *drive) {
  return crux_drive_sees(drive) && !drive->current_lost && (drive->direction.verdict != CRUX_DIRECTION_WRONG);
}

static uint8_t cause_of(const crux_drive *drive) {
  uint8_t cause = (uint8_t)CRUX_CAUSE_NONE;
  if (drive->current_lost) {
    cause = (uint8_t)CRUX_CAUSE_CURRENTS;
  } else if (drive->direction.verdict == CRUX_DIRECTION_WRONG) {
    cause = (uint8_t)CRUX_CAUSE_DIRECTION;
  } else if (!crux_drive_measures(drive)) {
    cause = (uint8_t)CRUX_CAUSE_SENSOR;
  } else {
    // all is well
  }
  return cause;
}

crux_health crux_drive_health(const crux_drive *drive) {
  return (crux_health){.cause = cause_of(drive),
                       .direction_unchecked = drive->direction.verdict == CRUX_DIRECTION_UNCHECKED,
                       .encoder_errors = drive->encoder.refused};
}

float crux_drive_rotor_torque_Nm(const crux_drive *drive) {
  return crux_motor_torque_constant(&drive->motor) * drive->outputs.quadrature_A;
}
