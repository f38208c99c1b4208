/// Drive of a joint: a gear between rotor and joint, homed without motion.
#ifndef CRUX_FIRMWARE_DRIVE_JOINT_DRIVE_H
#define CRUX_FIRMWARE_DRIVE_JOINT_DRIVE_H

#include "drive.h"
#include "joint_node.h"

typedef struct crux_joint_drive {
  crux_drive drive;
  crux_gear_parameters gear;
  crux_mounting mounting;
} crux_joint_drive;

/// The parameters must have passed crux_motor_parameters_fault and crux_gear_parameters_fault.
void crux_joint_drive_init(crux_joint_drive *joint, const crux_joint_drive_parameters *parameters,
                           const crux_mounting *mounting, const crux_drive_timing *timing);

/// Finds the joint's position from the coarse encoder on the joint and the motor encoder's first sample, which the
/// drive must have seen. `middle_rad`: of the joint's range. False when the two encoders contradict each other.
bool crux_joint_drive_home(crux_joint_drive *joint, uint32_t coarse_raw, float middle_rad);

/// The position was lost and both encoders answer: homes again, and after ten times in a row the position is known.
void crux_joint_drive_find(crux_joint_drive *joint, uint32_t motor_raw, uint32_t coarse_raw, float middle_rad);

/// Position, velocity and torque of the joint; position and velocity are no numbers when they are not known.
void crux_joint_drive_measure(const crux_joint_drive *joint, crux_joint_inputs *inputs);

/// One control period of dt_s > 0 seconds.
void crux_joint_drive_tick(crux_joint_drive *joint, float dt_s, float joint_torque_Nm, float temperature_degC);

#endif
