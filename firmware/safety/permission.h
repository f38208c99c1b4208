/// What a service over ISO-TP may do to a node: nothing while it moves, and never so that a joint could go limp or a
/// gripper open.
#ifndef CRUX_FIRMWARE_PERMISSION_H
#define CRUX_FIRMWARE_PERMISSION_H

#include <stdbool.h>
#include <stdint.h>

#include "crux_parameters.h"

/// Whether a node in this state stands still by itself and will until a command: BOOT, HOLD or FAULT. Only then are
/// parameters written or saved, images taken and nodes restarted. Nothing written changes the torque of a node in
/// FAULT, as in HOLD: else a board that has never been calibrated could not be repaired but with a programmer.
bool crux_is_at_rest(uint8_t state);

/// Whether `bits` (a float's, or an integer) may stand for the description's value `described`: writable, a number, and
/// within the table's range.
bool crux_parameter_accepts(const crux_parameter *parameter, uint32_t described, uint32_t bits);

/// Whether the node may be restarted, or take an image that will: at rest, with no host that commands it, for a robot
/// on a wall has one, and, as a joint without current falls, acknowledged by an operator who has the robot off the wall
/// (CRUX_ACKNOWLEDGEMENT_OFF_THE_WALL).
bool crux_may_restart(uint8_t state, bool commanded, uint32_t acknowledgement);

#endif
