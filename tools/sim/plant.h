/// The simulated robot on its wall as the firmware sees it: torques in, encoder and force/torque readings out. Model
/// and data are MuJoCo's and the caller's; limbs LF, RF, LR, RR, joints limb-major, SI units. One thread at a time.
#ifndef CRUX_SIM_PLANT_H
#define CRUX_SIM_PLANT_H

#include <mujoco/mujoco.h>
#include <stdint.h>

#include "world.h"

#define CRUX_SIM_API __attribute__((visibility("default")))

#ifdef __cplusplus
extern "C" {
#endif

/// Where things are in the model. The arrays pointed at belong to the caller and outlive the plant.
typedef struct crux_plant_map {
  int32_t body;
  int32_t slots;  ///< for joints of each limb, CRUX_CAN_JOINTS at most: arrays of joints have so many of each
  /// Of what the actuators turn: joints, or cranks in place of some.
  int32_t driven_qpos[CRUX_SIM_JOINTS], driven_dof[CRUX_SIM_JOINTS], joint_actuators[CRUX_SIM_JOINTS];
  /// An actuator at ratio * what it turns + coupling * joint coupled_to + offset_rad; what moves two joints pulls a
  /// tendon.
  double ratio[CRUX_SIM_JOINTS], coupling[CRUX_SIM_JOINTS], offset_rad[CRUX_SIM_JOINTS];
  int32_t coupled_to[CRUX_SIM_JOINTS], tendon[CRUX_SIM_JOINTS];  ///< any joint where coupling is 0; -1: no tendon
  int32_t finger_qpos[CRUX_SIM_PADS], finger_dof[CRUX_SIM_PADS], finger_actuators[CRUX_SIM_PADS];
  int32_t spine_actuators[CRUX_SIM_PADS];  ///< -1: a gripper without spines
  int32_t ft_sensors[CRUX_SIM_WRENCHES];   ///< into sensordata: per limb force xyz, torque xyz
  int32_t gripper_sites[CRUX_SIM_LIMBS], pad_geoms[CRUX_SIM_PADS];
  const int32_t *pad_of_geom;      ///< (ngeom,) pad or -1
  const int32_t *face_of_geom;     ///< (ngeom,) face or -1
  const double *adhesion_of_face;  ///< control of the spines of a pad on this face
} crux_plant_map;

/// What is the same all through a run.
typedef struct crux_plant_settings {
  uint64_t seed;
  double torque_share;                         ///< of a step in commanded joint torque, made good in one period
  double ft_noise[6], ft_bias[6];              ///< standard deviations; the bias is drawn once
  double encoder_step_rad, encoder_noise_rad;  ///< of a joint: a count, and the standard deviation of a reading
  double encoder_noise_rad_s;                  ///< of the speed that boards observe
  double hand_rotation[9];                     ///< W <- body that the hand holds at the start, row-major
  double screw_middle, screw_width;            ///< friction of a screw by its squeeze: its mean and its half width
  double braking_nms_rad;                      ///< of a joint whose motor's windings are in short circuit
  double idle_friction_nm;                     ///< of the gear of a joint without power
} crux_plant_settings;

/// What the last step left.
typedef struct crux_plant_state {
  double joint_position_rad[CRUX_SIM_JOINTS], joint_velocity_rad_s[CRUX_SIM_JOINTS];  ///< of the actuators
  double joint_torque_nm[CRUX_SIM_JOINTS];  ///< of the actuators, after their lag
  double finger_opening_m[CRUX_SIM_LIMBS], finger_speed_m_s[CRUX_SIM_LIMBS], finger_force_n[CRUX_SIM_LIMBS];
  double ft[CRUX_SIM_WRENCHES];  ///< raw reading, of the world on the gripper, gripper frame, with the hand's weight
  double ft_true[CRUX_SIM_WRENCHES];  ///< without bias and noise
  double pad_force_n[CRUX_SIM_PADS];  ///< normal force at the last look at the contacts
  double link_contact_force_n;        ///< greatest normal force on anything but a pad
  int64_t pad_face[CRUX_SIM_PADS];    ///< -1 without contact
  int64_t cycle;                      ///< steps so far
} crux_plant_state;

/// What really was in one cycle; nothing of it reaches the runtime. Frame W.
typedef struct crux_plant_truth {
  int64_t cycle;
  int64_t climbing;
  double body_position_m[3], body_quaternion[4];
  double gripper_position_m[CRUX_SIM_LIMBS][3], gripper_rotation[CRUX_SIM_LIMBS][9];
  double pad_position_m[CRUX_SIM_PADS][3], pad_force_n[CRUX_SIM_PADS];
  int64_t pad_face[CRUX_SIM_PADS];
  double hand_wrench_g[CRUX_SIM_LIMBS][6];
  double link_contact_force_n;
} crux_plant_truth;

typedef struct crux_plant crux_plant;

/// Steps between two looks at the contacts. In lockstep they are the runtime's cycles 1, 6, 11 …, among which are the
/// cycles whose limbs it logs.
extern CRUX_SIM_API const int32_t crux_plant_contact_period;

/// A plant in the pose that `data` has; mj_forward has been called. NULL when there is no memory. Model, data and
/// `state` belong to the caller and outlive the plant. `world` may be NULL: all is as described.
CRUX_SIM_API crux_plant *crux_plant_open(mjModel *model, mjData *data, const crux_plant_map *map,
                                         const crux_plant_settings *settings, const crux_world *world,
                                         crux_plant_state *state);
CRUX_SIM_API void crux_plant_close(crux_plant *plant);

/// From now on the torque of a joint is that of a motor, without the lag that stands for one.
CRUX_SIM_API void crux_plant_drive_joint(crux_plant *plant, int32_t joint);
/// From now on the finger force of a limb is that of a motor before its screw's friction.
CRUX_SIM_API void crux_plant_drive_gripper(crux_plant *plant, int32_t limb);

/// For joints of each limb.
CRUX_SIM_API int32_t crux_plant_slots(const crux_plant *plant);

/// Whether a joint or a limb's gripper has power in the next step: crux_supply of crux_nodes.h. Without it a joint can
/// be moved, against friction and its windings where they brake. Fingers stand where their screw locks them, until
/// their drive presses as hard as the screw does, or opens.
CRUX_SIM_API void crux_plant_power_joint(crux_plant *plant, int32_t joint, int32_t supply);
CRUX_SIM_API void crux_plant_power_gripper(crux_plant *plant, int32_t limb, int32_t supply);

/// The hand that carries the body at first begins its time anew, in the last second of which it releases it.
CRUX_SIM_API void crux_plant_carry(crux_plant *plant);

/// One control cycle: torques of the actuators, squeeze a finger, positive closes.
CRUX_SIM_API void crux_plant_step(crux_plant *plant, const double joint_torque_nm[CRUX_SIM_JOINTS],
                                  const double finger_force_n[CRUX_SIM_LIMBS]);

CRUX_SIM_API const crux_plant_state *crux_plant_state_of(const crux_plant *plant);

/// Of the joints' motors [degC], NaN where no world heats it; NULL when it heats none.
CRUX_SIM_API const double *crux_plant_temperature(const crux_plant *plant);

/// Keeps a sample of the truth when contacts were looked at in this step; `cycle` is the runtime's count, the same
/// again while it is silent, `climbing` 1 where the nodes receive that it climbs, -1 in reverse, else 0.
CRUX_SIM_API void crux_plant_record(crux_plant *plant, int64_t cycle, int32_t climbing);

/// The samples so far, valid until the next one; their number in `count`.
CRUX_SIM_API const crux_plant_truth *crux_plant_recorded(const crux_plant *plant, int64_t *count);

#ifdef __cplusplus
}
#endif
#endif
