#include "gripper_drive.h"

#include <math.h>

#define TWO_PI 6.28318531F

/// Of the peak current, to see which way the motor turns.
#define PULSE 0.02F

void crux_gripper_drive_init(crux_gripper_drive *gripper, const crux_gripper_drive_parameters *parameters,
                             const crux_gripper_parameters *limits, const crux_mounting *mounting,
                             const crux_drive_timing *timing) {
  *gripper = (crux_gripper_drive){
      .travel = {.opening_min_m = limits->opening_min_m,
                 .opening_max_m = limits->opening_max_m,
                 .speed_limit_m_s = limits->speed_limit_m_s,
                 .force_limit_N = limits->force_limit_N},
      .mounting = *mounting,
      .coarse_travel_m = parameters->coarse_travel_m,
  };
  crux_drive_init(&gripper->drive, &parameters->motor, mounting->electrical_offset_counts, timing);
  crux_direction_init(&gripper->drive.direction, PULSE * parameters->motor.peak_current_A);
  crux_screw_init(&gripper->screw, &parameters->screw);
}

bool crux_gripper_drive_home(crux_gripper_drive *gripper, uint32_t coarse_raw) {
  const crux_mounting *mounting = &gripper->mounting;
  const float coarse_turns = (gripper->travel.opening_max_m - gripper->travel.opening_min_m) / gripper->coarse_travel_m;
  const float coarse_rad = crux_encoder_coarse_rad(coarse_raw, mounting->coarse_zero_counts,
                                                   gripper->drive.motor.encoder_counts, 0.5F * TWO_PI * coarse_turns);
  const float rotor_rad = coarse_rad * (gripper->coarse_travel_m / gripper->screw.parameters.lead_m);
  gripper->drive.at_home =
      gripper->drive.encoder.seen && crux_encoder_home(&gripper->drive.encoder, rotor_rad, mounting->rotor_zero_counts);
  return gripper->drive.at_home;
}

/// Travel of a finger by an angle of the rotor.
static float travel_m(const crux_gripper_drive *gripper, float rotor_rad) {
  return rotor_rad * (gripper->screw.parameters.lead_m / TWO_PI);
}

void crux_gripper_drive_find(crux_gripper_drive *gripper, uint32_t motor_raw, uint32_t coarse_raw) {
  crux_encoder_restart(&gripper->drive.encoder, motor_raw);
  crux_encoder_found(&gripper->drive.encoder, crux_gripper_drive_home(gripper, coarse_raw));
}

void crux_gripper_drive_measure(const crux_gripper_drive *gripper, crux_gripper_inputs *inputs) {
  const crux_encoder *encoder = &gripper->drive.encoder;
  const bool known = crux_drive_measures(&gripper->drive);
  const float closed_m = travel_m(gripper, crux_encoder_position_rad(encoder));
  inputs->opening_m = known ? (gripper->travel.opening_max_m - closed_m) : NAN;
  inputs->speed_m_s = known ? -travel_m(gripper, encoder->speed_rad_s) : NAN;
  inputs->force_N = gripper->screw.force_N;
  inputs->health = crux_drive_health(&gripper->drive);
}

/// Whether an end of the travel takes the force: then the screw holds alone, and the motor need not press against it.
static bool at_an_end(const crux_gripper_drive *gripper) {
  return (gripper->stall.kind == CRUX_STALL_CLOSED_END) || (gripper->stall.kind == CRUX_STALL_OPEN_END);
}

void crux_gripper_drive_tick(crux_gripper_drive *gripper, float dt_s, float force_N, bool may_release,
                             float temperature_degC) {
  const crux_encoder *encoder = &gripper->drive.encoder;
  crux_gripper_inputs measured = {0};
  crux_gripper_drive_measure(gripper, &measured);
  crux_screw_observe(&gripper->screw, dt_s, crux_drive_rotor_torque_Nm(&gripper->drive), encoder->speed_rad_s);
  crux_stall_tick(&gripper->stall, &gripper->travel, dt_s, force_N, measured.opening_m, measured.speed_m_s);
  const float torque_Nm = crux_screw_rotor_torque_Nm(&gripper->screw, force_N, may_release);
  crux_drive_tick(&gripper->drive, dt_s, at_an_end(gripper) ? 0.0F : torque_Nm, temperature_degC);
}
