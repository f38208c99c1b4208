/// Joint node: a position servo on the bus. Pure: frames and measurements in, torque and frames out, time from dt.
///
/// States (DBC enumeration of JointStatus.State):
///   BOOT        no command taken over yet: holds the first measured position with the parameters' gains
///   HOLD        setpoint at rest, gains and feed-forward torque as they were
///   TRACK       follows the commands
///   DECELERATE  setpoint comes to rest with bounded deceleration, then HOLD
///   FAULT       position lost: keeps the torque that held the joint last
/// In every state torque = kp (setpoint - q) + kd (setpoint velocity - dq) + feed-forward, limited: a joint never goes
/// limp. A stop by the watchdog and a fault latch: only REARM leads back to TRACK.
#ifndef CRUX_FIRMWARE_JOINT_NODE_H
#define CRUX_FIRMWARE_JOINT_NODE_H

#include <stdbool.h>
#include <stdint.h>

#include "link.h"
#include "parameters.h"
#include "safety.h"

typedef struct crux_joint_inputs {
  float position_rad;      ///< not finite: the encoder is lost
  float velocity_rad_s;    ///< as above
  float torque_Nm;         ///< of the motor, for the status
  float temperature_degC;  ///< of the winding; not finite: the thermometer is lost
  bool bus_off;            ///< the CAN controller has left the bus
  bool driver_fault;       ///< the gate driver stopped the bridge, or has just now
  crux_health health;
} crux_joint_inputs;

typedef struct crux_joint_outputs {
  float torque_Nm;
} crux_joint_outputs;

/// What a joint follows: its setpoint and how stiffly.
typedef struct crux_joint_law {
  float setpoint_rad;
  float setpoint_rate_rad_s;
  float velocity_setpoint_rad_s;
  float feedforward_Nm;
  float position_gain_Nm_rad;
  float velocity_gain_Nms_rad;
} crux_joint_law;

typedef struct crux_joint_node {
  crux_link link;
  crux_joint_parameters parameters;
  crux_guard guard;
  crux_joint_command pending;  ///< waits for Sync
  crux_joint_command taken;    ///< by the last Sync
  float setpoint_rad;
  float setpoint_rate_rad_s;      ///< how fast setpoint_rad really moves
  float velocity_setpoint_rad_s;  ///< of the damping term
  float feedforward_Nm;
  float position_gain_Nm_rad;
  float velocity_gain_Nms_rad;
  crux_joint_law before;    ///< the last TRACK command was obeyed
  float last_position_rad;  ///< last finite measurement
  uint8_t state;
  bool latched;   ///< stopped by itself: waits for REARM
  bool has_seen;  ///< a finite measurement
} crux_joint_node;

/// Starts the node: `limb` 0..3, `node` 1..6. The parameters must have passed crux_joint_parameters_fault.
void crux_joint_node_init(crux_joint_node *node, uint8_t limb, uint8_t number, uint32_t parameter_hash,
                          const crux_joint_parameters *parameters);

/// Takes a frame from the bus; frames for others are ignored.
void crux_joint_node_on_frame(crux_joint_node *node, const crux_frame *frame);

/// One control period of dt_s > 0 seconds.
void crux_joint_node_tick(crux_joint_node *node, float dt_s, const crux_joint_inputs *inputs,
                          crux_joint_outputs *outputs);

/// Answers the last Sync with a status, if it has not been answered yet.
void crux_joint_node_publish(crux_joint_node *node, const crux_joint_inputs *inputs);

#endif
