/// Opening, a cycle and closing of a robot's nodes.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "robot_nodes.h"

#define ROOM_TEMPERATURE_DEG_C 25.0F
#define NO_HOST_STATE 0xFFU

static bool parameters_are_good(const crux_nodes *nodes) {
  for (int i = 0; i < CRUX_JOINTS; i++) {
    const char *fault = crux_joint_parameters_fault(&nodes->joint_parameters[i]);
    if (fault != NULL) {
      (void)snprintf(crux_nodes_last_error, sizeof(crux_nodes_last_error), "joint %d of limb %d: %s makes no sense",
                     (i % JOINTS_PER_LIMB) + 1, i / JOINTS_PER_LIMB, fault);
      return false;
    }
  }
  for (int i = 0; i < CRUX_LIMBS; i++) {
    const char *fault = crux_gripper_parameters_fault(&nodes->gripper_parameters[i]);
    if (fault != NULL) {
      (void)snprintf(crux_nodes_last_error, sizeof(crux_nodes_last_error), "gripper of limb %d: %s makes no sense", i,
                     fault);
      return false;
    }
  }
  return true;
}

crux_nodes *crux_nodes_open(const char *const bus_urls[CRUX_LIMBS], const crux_joint_parameters joint[CRUX_JOINTS],
                            const crux_gripper_parameters gripper[CRUX_LIMBS], uint32_t parameter_hash) {
  crux_nodes *nodes = calloc(1, sizeof(*nodes));
  if (nodes == NULL) {
    (void)snprintf(crux_nodes_last_error, sizeof(crux_nodes_last_error), "out of memory");
    return NULL;
  }
  (void)memcpy(nodes->joint_parameters, joint, sizeof(nodes->joint_parameters));
  (void)memcpy(nodes->gripper_parameters, gripper, sizeof(nodes->gripper_parameters));
  nodes->parameter_hash = parameter_hash;
  nodes->host_state = NO_HOST_STATE;
  for (int l = 0; l < CRUX_LIMBS; l++) {
    nodes->limbs[l].bus.receive_fd = -1;
    nodes->limbs[l].bus.send_fd = -1;
  }
  bool good = parameters_are_good(nodes);
  for (int l = 0; good && (l < CRUX_LIMBS); l++) {
    limb *owner = &nodes->limbs[l];
    good = crux_bus_open(&owner->bus, bus_urls[l], crux_nodes_last_error, sizeof(crux_nodes_last_error));
    owner->connected = true;
    owner->gripper_inputs.temperature_degC = ROOM_TEMPERATURE_DEG_C;
    for (int i = 0; i < NODES_PER_LIMB; i++) {
      owner->joint_inputs[i].temperature_degC = ROOM_TEMPERATURE_DEG_C;
      crux_nodes_new_memory(&owner->memory[i], (i == GRIPPER) ? CRUX_KIND_GRIPPER : CRUX_KIND_JOINT);
      crux_nodes_start_node(nodes, l, i);
    }
  }
  if (!good) {
    crux_nodes_close(nodes);
    nodes = NULL;
  }
  return nodes;
}

void crux_nodes_close(crux_nodes *nodes) {
  if (nodes != NULL) {
    for (int l = 0; l < CRUX_LIMBS; l++) {
      crux_bus_close(&nodes->limbs[l].bus);
    }
    free(nodes);
  }
}

static double control_joint(limb *owner, int index, double dt, double position, double velocity) {
  const crux_outside_node *outside = owner->outside[index];
  if (!crux_interference_powers(&owner->interference[index])) {
    return 0.0;
  }
  if (outside != NULL) {
    const crux_measured measured = {.position = position, .velocity = velocity};
    return outside->control(outside->context, dt, &measured);
  }
  crux_joint_inputs *inputs = &owner->joint_inputs[index];
  crux_joint_outputs outputs;
  inputs->position_rad = (float)position;
  inputs->velocity_rad_s = (float)velocity;
  crux_joint_node_tick(&owner->joint[index], (float)dt, inputs, &outputs);
  return (double)outputs.torque_Nm;
}

static double control_gripper(limb *owner, double dt, double opening, double speed, double force) {
  const crux_outside_node *outside = owner->outside[GRIPPER];
  crux_gripper_inputs *inputs = &owner->gripper_inputs;
  if (!crux_interference_powers(&owner->interference[GRIPPER])) {
    return 0.0;
  }
  if (outside != NULL) {
    crux_measured measured = {.position = opening, .velocity = speed};
    for (int i = 0; i < 6; i++) {
      measured.wrench[i] = (double)inputs->wrench[i];  // as last published
    }
    return outside->control(outside->context, dt, &measured);
  }
  crux_gripper_outputs outputs;
  inputs->opening_m = (float)opening;
  inputs->speed_m_s = (float)speed;
  inputs->force_N = (float)force;
  crux_gripper_node_tick(&owner->gripper, (float)dt, inputs, &outputs);
  return (double)outputs.force_N;
}

void crux_nodes_control(crux_nodes *nodes, double dt, const double joint_position[CRUX_JOINTS],
                        const double joint_velocity[CRUX_JOINTS], const double finger_opening[CRUX_LIMBS],
                        const double finger_speed[CRUX_LIMBS], const double finger_force[CRUX_LIMBS],
                        double joint_torque_out[CRUX_JOINTS], double finger_force_out[CRUX_LIMBS]) {
  for (int l = 0; l < CRUX_LIMBS; l++) {
    limb *owner = &nodes->limbs[l];
    for (int i = 0; i < NODES_PER_LIMB; i++) {
      owner->interference[i].restarts = false;
    }
    for (int i = 0; i < JOINTS_PER_LIMB; i++) {
      const int j = (l * JOINTS_PER_LIMB) + i;
      joint_torque_out[j] = control_joint(owner, node_of(i), dt, joint_position[j], joint_velocity[j]);
    }
    finger_force_out[l] = control_gripper(owner, dt, finger_opening[l], finger_speed[l], finger_force[l]);
    crux_nodes_serve(nodes, l, crux_microseconds((float)dt));
  }
}

static bool take_frame(limb *owner, int index, crux_frame *frame) {
  const crux_outside_node *outside = owner->outside[index];
  crux_link *link = (index == GRIPPER) ? &owner->gripper.link : &owner->joint[index].link;
  return (outside != NULL)
             ? outside->fetch(outside->context, frame)
             : (crux_link_take_frame(link, frame) || crux_service_take_frame(&owner->service[index], frame));
}

/// Moves what the node wants to say to the end of `frames`, a queue's worth at the most; returns their new number.
static int collect(limb *owner, int index, crux_frame *frames, int count) {
  interference *disturbed = &owner->interference[index];
  int taken = 0;
  const bool speaks = !disturbed->off && crux_interference_powers(disturbed);
  while (speaks && (taken < (int)CRUX_QUEUE_LENGTH) && take_frame(owner, index, &frames[count])) {
    const bool lost = crux_interference_use_up(&disturbed->drop_sent) || crux_interference_loses(disturbed);
    count += lost ? 0 : 1;
    taken++;
  }
  return count;
}

int crux_nodes_publish(crux_nodes *nodes, const double joint_position[CRUX_JOINTS],
                       const double joint_velocity[CRUX_JOINTS], const double joint_torque[CRUX_JOINTS],
                       const double finger_opening[CRUX_LIMBS], const double finger_speed[CRUX_LIMBS],
                       const double finger_force[CRUX_LIMBS], const double ft_wrench[CRUX_LIMBS * 6]) {
  // Every queue may be full, and taking a frame may touch the entry after the last one.
  crux_frame frames[(CRUX_CAN_NODES * CRUX_QUEUE_LENGTH) + 1U];
  int result = 0;
  for (int l = 0; l < CRUX_LIMBS; l++) {
    limb *owner = &nodes->limbs[l];
    int count = 0;
    for (int i = 0; i < JOINTS_PER_LIMB; i++) {
      const int j = (l * JOINTS_PER_LIMB) + i;
      const int index = node_of(i);
      crux_joint_inputs *inputs = &owner->joint_inputs[index];
      inputs->position_rad = (float)joint_position[j];
      inputs->velocity_rad_s = (float)joint_velocity[j];
      inputs->torque_Nm = (float)joint_torque[j];
      if (owner->outside[index] == NULL) {
        crux_joint_node_publish(&owner->joint[index], inputs);
      }
      count = collect(owner, index, frames, count);
    }
    crux_gripper_inputs *inputs = &owner->gripper_inputs;
    inputs->opening_m = (float)finger_opening[l];
    inputs->speed_m_s = (float)finger_speed[l];
    inputs->force_N = (float)finger_force[l];
    inputs->wrench_valid = true;
    for (int i = 0; i < 6; i++) {
      inputs->wrench[i] = (float)ft_wrench[(l * 6) + i];
    }
    if (owner->outside[GRIPPER] == NULL) {
      crux_gripper_node_publish(&owner->gripper, inputs);
    }
    count = collect(owner, GRIPPER, frames, count);
    if (owner->connected && !crux_bus_send(&owner->bus, frames, count)) {
      (void)crux_nodes_bus_failure(l, "cannot send");
      result = -1;
    }
  }
  return result;
}

int crux_nodes_put(crux_nodes *nodes, int limb_index, const crux_frame *frame) {
  return crux_bus_put(&nodes->limbs[limb_index].bus, frame) ? 1 : 0;
}

int crux_nodes_get(crux_nodes *nodes, int limb_index, crux_frame *frame) {
  return crux_bus_get(&nodes->limbs[limb_index].bus, frame) ? 1 : 0;
}

uint8_t crux_nodes_host_state(const crux_nodes *nodes) { return nodes->host_state; }

static void look_at_state(const limb *owner, int index, uint8_t *state, uint8_t *faults) {
  const crux_outside_node *outside = owner->outside[index];
  if (outside != NULL) {
    outside->state(outside->context, state, faults);
  } else {
    *state = (index == GRIPPER) ? owner->gripper.state : owner->joint[index].state;
    *faults = (index == GRIPPER) ? owner->gripper.link.faults : owner->joint[index].link.faults;
  }
}

void crux_nodes_states(const crux_nodes *nodes, uint8_t joint_state[CRUX_JOINTS], uint8_t joint_faults[CRUX_JOINTS],
                       uint8_t gripper_state[CRUX_LIMBS], uint8_t gripper_faults[CRUX_LIMBS]) {
  for (int l = 0; l < CRUX_LIMBS; l++) {
    for (int i = 0; i < JOINTS_PER_LIMB; i++) {
      const int j = (l * JOINTS_PER_LIMB) + i;
      look_at_state(&nodes->limbs[l], node_of(i), &joint_state[j], &joint_faults[j]);
    }
    look_at_state(&nodes->limbs[l], GRIPPER, &gripper_state[l], &gripper_faults[l]);
  }
}

int crux_nodes_replace(crux_nodes *nodes, int limb_index, int node, const crux_outside_node *by) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  nodes->limbs[limb_index].outside[node - 1] = by;
  return 0;
}

int crux_nodes_counters(const crux_nodes *nodes, int limb_index, int node, crux_node_counters *counters) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  const limb *owner = &nodes->limbs[limb_index];
  *counters = (node - 1 == GRIPPER) ? owner->gripper.link.counters : owner->joint[node - 1].link.counters;
  return 0;
}
