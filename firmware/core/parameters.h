/// Numbers of a node, all of them from the robot description; the core has none of its own. Their structs are made
/// from msgs/can/parameters.yaml.
#ifndef CRUX_FIRMWARE_PARAMETERS_H
#define CRUX_FIRMWARE_PARAMETERS_H

#include "crux_parameters.h"

/// Name of the first parameter that makes no sense (not finite, wrong sign, empty range), NULL when all do.
const char *crux_joint_parameters_fault(const crux_joint_parameters *parameters);
const char *crux_gripper_parameters_fault(const crux_gripper_parameters *parameters);

#endif
