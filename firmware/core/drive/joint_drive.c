#include "joint_drive.h"

#include <math.h>

/// Of the peak current, to see which way the motor turns.
#define PULSE 0.1F

void crux_joint_drive_init(crux_joint_drive *joint, const crux_joint_drive_parameters *parameters,
                           const crux_mounting *mounting, const crux_drive_timing *timing) {
  *joint = (crux_joint_drive){.gear = parameters->gear, .mounting = *mounting};
  crux_drive_init(&joint->drive, &parameters->motor, mounting->electrical_offset_counts, timing);
  crux_direction_init(&joint->drive.direction, PULSE * parameters->motor.peak_current_A);
}

bool crux_joint_drive_home(crux_joint_drive *joint, uint32_t coarse_raw, float middle_rad) {
  const crux_mounting *mounting = &joint->mounting;
  const float joint_rad =
      crux_encoder_coarse_rad(coarse_raw, mounting->coarse_zero_counts, joint->drive.motor.encoder_counts, middle_rad);
  joint->drive.at_home =
      joint->drive.encoder.seen &&
      crux_encoder_home(&joint->drive.encoder, joint_rad * joint->gear.ratio, mounting->rotor_zero_counts);
  return joint->drive.at_home;
}

void crux_joint_drive_find(crux_joint_drive *joint, uint32_t motor_raw, uint32_t coarse_raw, float middle_rad) {
  crux_encoder_restart(&joint->drive.encoder, motor_raw);
  crux_encoder_found(&joint->drive.encoder, crux_joint_drive_home(joint, coarse_raw, middle_rad));
}

void crux_joint_drive_measure(const crux_joint_drive *joint, crux_joint_inputs *inputs) {
  const crux_gear_parameters *gear = &joint->gear;
  const bool known = crux_drive_measures(&joint->drive);
  inputs->position_rad = known ? (crux_encoder_position_rad(&joint->drive.encoder) / gear->ratio) : NAN;
  inputs->velocity_rad_s = known ? (joint->drive.encoder.speed_rad_s / gear->ratio) : NAN;
  inputs->health = crux_drive_health(&joint->drive);
  inputs->torque_Nm = crux_drive_rotor_torque_Nm(&joint->drive) * gear->ratio * gear->efficiency;
}

void crux_joint_drive_tick(crux_joint_drive *joint, float dt_s, float joint_torque_Nm, float temperature_degC) {
  const crux_gear_parameters *gear = &joint->gear;
  crux_drive_tick(&joint->drive, dt_s, joint_torque_Nm / (gear->ratio * gear->efficiency), temperature_degC);
}
