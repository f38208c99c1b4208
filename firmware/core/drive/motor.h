/// The motor of a node and what stands behind it: a three-phase machine with surface magnets, its gear and its screw.
/// Numbers come from the robot description; the firmware has none of its own.
#ifndef CRUX_FIRMWARE_DRIVE_MOTOR_H
#define CRUX_FIRMWARE_DRIVE_MOTOR_H

#include <stdint.h>

typedef struct crux_motor_parameters {
  uint32_t pole_pairs;
  float resistance_ohm;  ///< of a phase
  float inductance_H;    ///< of a phase; the same along both axes of the rotor
  float flux_Wb;         ///< linked with a phase by the magnets, peak
  float peak_current_A;  ///< amplitude of the phase current
  float continuous_current_A;
  float heating_time_s;          ///< of the winding: its temperature follows current squared by a first-order lag
  float bandwidth_rad_s;         ///< of the current loop
  float max_speed_rad_s;         ///< of the rotor: what turns faster than that was read wrongly
  uint32_t encoder_counts;       ///< of a turn of the rotor
  float supply_V;                ///< nominal
  float temperature_limit_degC;  ///< of the winding: from here on the current folds back to the continuous one
} crux_motor_parameters;

/// Torque of a joint: a gear between rotor and joint.
typedef struct crux_gear_parameters {
  float ratio;       ///< rotor turns a turn of the joint
  float efficiency;  ///< 0..1, of torque from rotor to joint
} crux_gear_parameters;

/// Force of a gripper: a screw that locks itself between rotor and finger. One motor moves both fingers.
typedef struct crux_screw_parameters {
  float lead_m;      ///< travel of a finger in a turn of the rotor
  float efficiency;  ///< 0..1, of work from the rotor to the fingers while the squeeze grows
  float
      release_torque;   ///< torque that opens against a squeeze, as a share of the one that built it; > 0: locks itself
  float inertia_kg_m2;  ///< of the rotor with all that turns and moves with it
  float drag_Nms_rad;   ///< viscous friction at the rotor
} crux_screw_parameters;

typedef struct crux_joint_drive_parameters {
  crux_motor_parameters motor;
  crux_gear_parameters gear;
} crux_joint_drive_parameters;

typedef struct crux_gripper_drive_parameters {
  crux_motor_parameters motor;
  crux_screw_parameters screw;
  float coarse_travel_m;  ///< travel of a finger in a turn of the coarse encoder
} crux_gripper_drive_parameters;

/// What differs from board to board as it is mounted: measured once, kept on the board.
typedef struct crux_mounting {
  uint32_t electrical_offset_counts;  ///< motor encoder's sample at which the magnets' axis is phase a's
  uint32_t rotor_zero_counts;         ///< its sample at the axis' zero, of whatever turn
  uint32_t coarse_zero_counts;        ///< coarse encoder's sample at the axis' zero
} crux_mounting;

/// Name of the first parameter that makes no sense (not finite, wrong sign, out of range), NULL when all do.
const char *crux_motor_parameters_fault(const crux_motor_parameters *motor);
const char *crux_gear_parameters_fault(const crux_gear_parameters *gear);
const char *crux_screw_parameters_fault(const crux_screw_parameters *screw);

/// Torque of the rotor per ampere of quadrature current [Nm/A]: 3/2 pole pairs times flux, for currents and flux that
/// count amplitudes.
float crux_motor_torque_constant(const crux_motor_parameters *motor);

#endif
