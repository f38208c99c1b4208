/// Motor of a node under control: encoder, heat and current loop in one, for joint and gripper alike.
///
/// `crux_drive_step` runs in the PWM interrupt, `crux_drive_tick` in the node's control period; the one word that goes
/// from the second to the first is `quadrature_wanted_A`.
///
/// Encoder lost: the field stops where it was last and the current stays. The rotor's magnets then lock to the standing
/// field as in a stepping motor, so that a joint which carries load settles by a fraction of a turn of the rotor
/// instead of falling.
#ifndef CRUX_FIRMWARE_DRIVE_DRIVE_H
#define CRUX_FIRMWARE_DRIVE_DRIVE_H

#include "current_control.h"
#include "encoder.h"
#include "heat.h"
#include "motor.h"

typedef struct crux_drive_inputs {
  uint32_t encoder_raw;
  bool encoder_valid;  ///< parity and error flag of the sensor's answer
  float phase_a_A;
  float phase_b_A;
  float supply_V;
} crux_drive_inputs;

typedef struct crux_drive {
  crux_motor_parameters motor;
  uint32_t electrical_offset_counts;  ///< of the board: encoder sample at which the magnets' axis is phase a's
  crux_encoder encoder;
  crux_heat heat;
  crux_current_control current;
  crux_current_outputs outputs;
  float standing_rad;  ///< electrical angle of the field, kept when the encoder is lost
  volatile float quadrature_wanted_A;
} crux_drive;

/// The parameters must have passed crux_motor_parameters_fault; period_s > 0 is that of the PWM.
void crux_drive_init(crux_drive *drive, const crux_motor_parameters *motor, uint32_t electrical_offset_counts,
                     float period_s);

/// One PWM period: the duties are in drive->outputs.
void crux_drive_step(crux_drive *drive, const crux_drive_inputs *inputs);

/// One control period of dt_s > 0 seconds: sets the current for a rotor torque, as far as heat allows.
void crux_drive_tick(crux_drive *drive, float dt_s, float rotor_torque_Nm);

/// Torque of the rotor by its current [Nm].
float crux_drive_rotor_torque_Nm(const crux_drive *drive);

/// Joint behind a gear: torque of the joint to torque of the rotor and back, position and speed of the joint.
float crux_gear_rotor_torque_Nm(const crux_gear_parameters *gear, float joint_torque_Nm);
float crux_gear_joint_torque_Nm(const crux_gear_parameters *gear, float rotor_torque_Nm);

#endif
