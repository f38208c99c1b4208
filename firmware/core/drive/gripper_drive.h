/// Drive of a gripper: a screw that locks itself between rotor and fingers, homed without motion, resting where
/// pressing on is no use. The rotor's axis is zero with the fingers wide open; positive closes.
#ifndef CRUX_FIRMWARE_DRIVE_GRIPPER_DRIVE_H
#define CRUX_FIRMWARE_DRIVE_GRIPPER_DRIVE_H

#include "drive.h"
#include "gripper_node.h"
#include "screw.h"
#include "stall.h"

typedef struct crux_gripper_drive {
  crux_drive drive;
  crux_screw screw;
  crux_stall stall;
  crux_stall_parameters travel;
  crux_mounting mounting;
  float coarse_travel_m;
} crux_gripper_drive;

/// The parameters must have passed their fault functions.
void crux_gripper_drive_init(crux_gripper_drive *gripper, const crux_gripper_drive_parameters *parameters,
                             const crux_gripper_parameters *limits, const crux_mounting *mounting,
                             const crux_drive_timing *timing);

/// Finds the opening from the coarse encoder behind the screw and the motor encoder's first sample, which the drive
/// must have seen. False when the two encoders contradict each other.
bool crux_gripper_drive_home(crux_gripper_drive *gripper, uint32_t coarse_raw);

/// The position was lost and both encoders answer: homes again, and after ten times in a row the position is known.
void crux_gripper_drive_find(crux_gripper_drive *gripper, uint32_t motor_raw, uint32_t coarse_raw);

/// Opening, its speed and the squeeze of a finger; opening and speed are no numbers when they are not known.
void crux_gripper_drive_measure(const crux_gripper_drive *gripper, crux_gripper_inputs *inputs);

/// One control period of dt_s > 0 seconds. `may_release`: false in every state in which the gripper must hold on.
void crux_gripper_drive_tick(crux_gripper_drive *gripper, float dt_s, float force_N, bool may_release,
                             float temperature_degC);

#endif
