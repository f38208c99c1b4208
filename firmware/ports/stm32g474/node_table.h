/// Parameters of all nodes of a robot, generated from its description by generate_node_table.py: one image fits every
/// joint (every gripper), the board's straps say which one it is.
#ifndef CRUX_STM32G474_NODE_TABLE_H
#define CRUX_STM32G474_NODE_TABLE_H

#include "bit_rates.h"
#include "crux_can_ids.h"
#include "drive/motor.h"
#include "parameters.h"

extern const crux_joint_parameters node_table_joints[CRUX_CAN_LIMBS * CRUX_CAN_JOINTS];  ///< limb-major
extern const crux_gripper_parameters node_table_grippers[CRUX_CAN_LIMBS];
extern const crux_joint_drive_parameters node_table_joint_drives[CRUX_CAN_LIMBS * CRUX_CAN_JOINTS];
extern const crux_gripper_drive_parameters node_table_gripper_drives[CRUX_CAN_LIMBS];
extern const uint32_t node_table_hash;

#endif
