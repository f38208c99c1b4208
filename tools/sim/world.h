/// What is not as the plan and the robot description say: motors, friction, holds that break, pushes, sensors. Numbers
/// of tools/crux_simulation/sim/world.py; times count from the first step, units are SI. Joints limb-major,
/// as the plant's map has them.
#ifndef CRUX_SIM_WORLD_H
#define CRUX_SIM_WORLD_H

#include <stdint.h>

#include "crux_can_ids.h"

enum {
  CRUX_SIM_LIMBS = CRUX_CAN_LIMBS,
  CRUX_SIM_JOINTS = CRUX_CAN_LIMBS * CRUX_CAN_JOINTS,
  CRUX_SIM_PADS = 2 * CRUX_CAN_LIMBS,
  CRUX_SIM_WRENCHES = 6 * CRUX_CAN_LIMBS
};

typedef enum crux_sensor { CRUX_FORCE_TORQUE, CRUX_ENCODER, CRUX_FINGER_OPENING, CRUX_FINGER_FORCE } crux_sensor;

typedef enum crux_sensor_fault {
  CRUX_BIAS,
  CRUX_JUMP,
  CRUX_DRIFT,       ///< value a second
  CRUX_SATURATION,  ///< at +- value
  CRUX_SCALE,
  CRUX_CROSS_TALK,  ///< share of every other channel, each as a share of its range
  CRUX_DROPOUT,     ///< share of samples that stay the one before
  CRUX_FREEZE,
  CRUX_ZERO,
  CRUX_NOT_A_NUMBER
} crux_sensor_fault;

typedef struct crux_sensor_error {
  int32_t sensor, place, fault;  ///< crux_sensor, limb or joint, crux_sensor_fault
  double value[6];               ///< one a channel, or the one number of scale, cross-talk and dropout
  double from_s, until_s;
} crux_sensor_error;

typedef struct crux_push {
  double wrench_w[6];  ///< force and moment on the body's centre of mass
  double from_s, until_s;
} crux_push;

typedef struct crux_hold_break {
  int32_t body;
  double load_n, at_s;  ///< infinite: never
} crux_hold_break;

/// The arrays pointed at belong to the caller and outlive the plant.
typedef struct crux_world {
  double torque_factor[CRUX_SIM_JOINTS], torque_limit_nm[CRUX_SIM_JOINTS];
  double torque_share[CRUX_SIM_JOINTS];  ///< of a step in torque made good in one period, besides the motor's own lag
  double half_play_rad[CRUX_SIM_JOINTS], stiffness_nm_rad[CRUX_SIM_JOINTS];  ///< between motor and link
  double stiction_nm[CRUX_SIM_JOINTS];  ///< of a standing joint, besides the model's friction
  double heating_k_nm2[CRUX_SIM_JOINTS], heating_time_s[CRUX_SIM_JOINTS];  ///< 0 K: its thermometer is left alone
  int32_t dead_cycles[CRUX_SIM_JOINTS];
  int32_t play_qpos[CRUX_SIM_JOINTS], play_dof[CRUX_SIM_JOINTS];  ///< of elastic joints, what gives; -1: rigid
  double finger_force_factor[CRUX_SIM_LIMBS], finger_force_limit_n[CRUX_SIM_LIMBS];
  double jam_m[CRUX_SIM_LIMBS], jam_s[CRUX_SIM_LIMBS];  ///< opening (NaN: any) and time from which on fingers jam
  double ft_range[6];
  double ambient_degc;
  double gone_m;  ///< z of a hold that has broken
  int32_t sensor_errors_count, pushes_count, breaks_count;
  const crux_sensor_error *sensor_errors;
  const crux_push *pushes;
  const crux_hold_break *breaks;
} crux_world;

#endif
