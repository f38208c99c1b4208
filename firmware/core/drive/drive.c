#include "drive.h"

#include <math.h>

void crux_drive_init(crux_drive *drive, const crux_motor_parameters *motor, uint32_t electrical_offset_counts,
                     float period_s) {
  *drive = (crux_drive){.motor = *motor, .electrical_offset_counts = electrical_offset_counts};
  crux_encoder_init(&drive->encoder, motor, period_s);
  crux_heat_init(&drive->heat, motor);
  crux_current_control_init(&drive->current, motor, period_s);
}

void crux_drive_step(crux_drive *drive, const crux_drive_inputs *inputs) {
  float speed_rad_s = 0.0F;
  crux_encoder_step(&drive->encoder, inputs->encoder_raw, inputs->encoder_valid);
  if (!drive->encoder.lost) {
    drive->standing_rad =
        crux_encoder_electrical_rad(&drive->encoder, drive->motor.pole_pairs, drive->electrical_offset_counts);
    speed_rad_s = (float)drive->motor.pole_pairs * drive->encoder.speed_rad_s;
  }
  const crux_current_inputs current = {
      .phase_a_A = inputs->phase_a_A,
      .phase_b_A = inputs->phase_b_A,
      .supply_V = inputs->supply_V,
      .angle_rad = drive->standing_rad,
      .speed_rad_s = speed_rad_s,
      .quadrature_wanted_A = drive->quadrature_wanted_A,
  };
  crux_current_control_step(&drive->current, &current, &drive->outputs);
}

void crux_drive_tick(crux_drive *drive, float dt_s, float rotor_torque_Nm) {
  const float direct_A = drive->outputs.direct_A;
  const float quadrature_A = drive->outputs.quadrature_A;
  crux_heat_tick(&drive->heat, &drive->motor, dt_s, sqrtf((direct_A * direct_A) + (quadrature_A * quadrature_A)));
  float wanted_A = rotor_torque_Nm / crux_motor_torque_constant(&drive->motor);
  if (drive->encoder.lost) {
    // The standing field holds by its strength, so it gets all that the winding bears for good.
    const float held_A = drive->quadrature_wanted_A;
    wanted_A = copysignf(fmaxf(fabsf(held_A), drive->motor.continuous_current_A), held_A);
  }
  drive->quadrature_wanted_A = fminf(fmaxf(wanted_A, -drive->heat.allowed_A), drive->heat.allowed_A);
}

float crux_drive_rotor_torque_Nm(const crux_drive *drive) {
  return crux_motor_torque_constant(&drive->motor) * drive->outputs.quadrature_A;
}

float crux_gear_rotor_torque_Nm(const crux_gear_parameters *gear, float joint_torque_Nm) {
  return joint_torque_Nm / (gear->ratio * gear->efficiency);
}

float crux_gear_joint_torque_Nm(const crux_gear_parameters *gear, float rotor_torque_Nm) {
  return rotor_torque_Nm * gear->ratio * gear->efficiency;
}
