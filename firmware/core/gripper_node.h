/// Gripper node: position loop of the linear actuator that drives both fingers, and the F/T sensor's way to the bus.
/// Pure: frames and measurements in, finger force and frames out, time from dt.
///
/// Finger force = stiffness (opening - setpoint) + damping * speed, limited by the command's force limit; positive
/// closes. The setpoint moves towards the commanded opening no faster than the speed limit, and never runs further
/// away from the fingers than the force limit is worth, so that a release does not wait for it to come back.
///
/// States as for joints, without DECELERATE: the actuator's speed limit is so small that its setpoint just stops. HOLD
/// keeps setpoint and force limit, thus the squeeze, and never pushes the fingers open; FAULT (opening lost) keeps the
/// squeeze it had. A stop by the watchdog and a fault latch until REARM.
#ifndef CRUX_FIRMWARE_GRIPPER_NODE_H
#define CRUX_FIRMWARE_GRIPPER_NODE_H

#include <stdbool.h>
#include <stdint.h>

#include "link.h"
#include "parameters.h"
#include "safety.h"

typedef struct crux_gripper_inputs {
  float opening_m;         ///< pad face to gripper centre; not finite: the sensor is lost
  float speed_m_s;         ///< of the opening; as above
  float force_N;           ///< squeeze a finger, for the status
  float temperature_degC;  ///< of the winding; not finite: the thermometer is lost
  float wrench[6];    ///< fx fy fz [N] mx my mz [Nm], of the world on the gripper about its centre, gripper frame, raw
  bool wrench_valid;  ///< the F/T sensor has a sample
  bool wrench_overloaded;  ///< by its own word
  bool bus_off;
  bool driver_fault;  ///< the gate driver stopped the bridge, or has just now
  crux_health health;
} crux_gripper_inputs;

typedef struct crux_gripper_outputs {
  float force_N;  ///< a finger, positive closes
} crux_gripper_outputs;

typedef struct crux_gripper_node {
  crux_link link;
  crux_gripper_parameters parameters;
  crux_guard guard;
  crux_gripper_command pending;
  crux_gripper_command taken;
  float setpoint_m;
  float force_limit_N;
  float setpoint_before_m;     ///< the last TRACK command was obeyed
  float force_limit_before_N;  ///< as above
  float last_opening_m;
  uint8_t state;
  bool latched;
  bool has_seen;
} crux_gripper_node;

/// Starts the node of `limb` 0..3. The parameters must have passed crux_gripper_parameters_fault.
void crux_gripper_node_init(crux_gripper_node *node, uint8_t limb, uint32_t parameter_hash,
                            const crux_gripper_parameters *parameters);

/// Takes a frame from the bus; frames for others are ignored.
void crux_gripper_node_on_frame(crux_gripper_node *node, const crux_frame *frame);

/// One control period of dt_s > 0 seconds.
void crux_gripper_node_tick(crux_gripper_node *node, float dt_s, const crux_gripper_inputs *inputs,
                            crux_gripper_outputs *outputs);

/// Answers the last Sync with a status and a F/T sample, if it has not been answered yet.
void crux_gripper_node_publish(crux_gripper_node *node, const crux_gripper_inputs *inputs);

#endif
