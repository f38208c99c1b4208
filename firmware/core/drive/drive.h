/// Motor of a node under control: encoder, heat and current loop in one, for joint and gripper alike.
///
/// `crux_drive_step` runs in the PWM interrupt, `crux_drive_tick` in the node's control period; the words that go
/// from the second to the first are the currents wanted.
///
/// What the drive does when it cannot control any more, always by a field that stands: the rotor's magnets then lock to
/// it as in a stepping motor, so that a joint which carries load settles by a fraction of a turn of the rotor instead
/// of falling.
/// - Position not known after a start: the field stands where the rotor is found.
/// - Encoder lost: the field stops where it was last and the current stays, at least the continuous one, until it is
/// found again.
/// - The control period fails to come (its code hangs): the same, until it comes again.
/// - Currents that cannot be, or that the voltage cannot have driven at that speed, for half a millisecond: an
/// amplifier is broken, or the motor is not connected or mounted as the board believes. The field stands by a voltage
/// alone, for good.
/// - A motor that turns against its current when it is started (direction.h): the field stands, for good.
/// - The processor stops: the port's fault handler sets `standing_duty`, which is ready at any time.
#ifndef CRUX_FIRMWARE_DRIVE_DRIVE_H
#define CRUX_FIRMWARE_DRIVE_DRIVE_H

#include "current_control.h"
#include "direction.h"
#include "encoder.h"
#include "health.h"
#include "heat.h"
#include "motor.h"

typedef struct crux_drive_inputs {
  uint32_t encoder_raw;
  bool encoder_valid;  ///< parity and error flag of the sensor's answer
  float phase_a_A;
  float phase_b_A;
  float supply_V;
  bool bridge_stopped;  ///< since the last sample, by the gate driver: the voltage asked for was not made
} crux_drive_inputs;

/// How the port samples.
typedef struct crux_drive_timing {
  float period_s;       ///< of the PWM
  float encoder_age_s;  ///< of the encoder's sample when the currents are sampled
} crux_drive_timing;

typedef struct crux_drive {
  crux_motor_parameters motor;
  uint32_t electrical_offset_counts;
  crux_encoder encoder;
  crux_heat heat;
  crux_current_control current;
  crux_current_outputs outputs;
  float standing_rad;      ///< electrical angle of the magnets' axis that the field is set to, kept when it stands
  float supply_V;          ///< as taken in last, within what can be
  float standing_duty[3];  ///< would let the field stand where it is now, without feedback
  uint32_t wild_periods;   ///< in a row with currents that cannot be
  bool current_lost;
  bool stood;  ///< in the last period, or before the first one
  crux_direction direction;
  bool at_home;                      ///< set by homing
  bool placed;                       ///< the rotor has been seen: standing_rad means something
  volatile uint32_t silent_periods;  ///< since the last control period
  volatile float quadrature_wanted_A;
  volatile float direct_wanted_A;
} crux_drive;

/// The parameters must have passed crux_motor_parameters_fault.
void crux_drive_init(crux_drive *drive, const crux_motor_parameters *motor, uint32_t electrical_offset_counts,
                     const crux_drive_timing *timing);

/// One PWM period: the duties are in drive->outputs.
void crux_drive_step(crux_drive *drive, const crux_drive_inputs *inputs);

/// One control period of dt_s > 0 seconds: sets the current for a rotor torque, as far as heat allows. A temperature
/// that is not a number is not known.
void crux_drive_tick(crux_drive *drive, float dt_s, float rotor_torque_Nm, float temperature_degC);

/// Whether the position is known.
bool crux_drive_sees(const crux_drive *drive);

/// Whether position and currents are known, and the motor obeys: else nothing but holding still can be asked of the
/// drive.
bool crux_drive_measures(const crux_drive *drive);

/// What the node tells of it.
crux_health crux_drive_health(const crux_drive *drive);

/// Torque of the rotor by its current [Nm].
float crux_drive_rotor_torque_Nm(const crux_drive *drive);

#endif
