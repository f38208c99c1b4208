#include "joint_drive.h"

#include <math.h>

void crux_joint_drive_init(crux_joint_drive *joint, const crux_joint_drive_parameters *parameters,
                           const crux_mounting *mounting, const crux_drive_timing *timing) {
  *joint = (crux_joint_drive){.gear = parameters->gear, .mounting = *mounting};
  crux_drive_init(&joint->drive, &parameters->motor, mounting->electrical_offset_counts, timing);
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

void crux_joint_drive_measure(const crux_joint_drive *joint, crux_joint_inputs *inputs) {
  const crux_gear_parameters *gear = &joint->gear;
  const bool known = crux_drive_measures(&joint->drive);
  inputs->position_rad = known ? (crux_encoder_position_rad(&joint->drive.encoder) / gear->ratio) : NAN;
  inputs->velocity_rad_s = known ? (joint->drive.encoder.speed_rad_s / gear->ratio) : NAN;
  inputs->torque_Nm = crux_drive_rotor_torque_Nm(&joint->drive) * gear->ratio * gear->efficiency;
}

void crux_joint_drive_tick(crux_joint_drive *joint, float dt_s, float joint_torque_Nm, float temperature_degC) {
  const crux_gear_parameters *gear = &joint->gear;
  crux_drive_tick(&joint->drive, dt_s, joint_torque_Nm / (gear->ratio * gear->efficiency), temperature_degC);
}
