#include "crux_nodes.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "e2e.h"
#include "robot_nodes.h"

#define ROOM_TEMPERATURE_DEG_C 25.0F
#define NO_HOST_STATE 0xFFU

static _Thread_local char last_error[256];

const char *crux_nodes_error(void) { return last_error; }

void crux_nodes_start_node(crux_nodes *nodes, int limb_index, int index) {
  limb *owner = &nodes->limbs[limb_index];
  if (index == GRIPPER) {
    crux_gripper_node_init(&owner->gripper, (uint8_t)limb_index, nodes->parameter_hash,
                           &nodes->gripper_parameters[limb_index]);
  } else {
    crux_joint_node_init(&owner->joint[index], (uint8_t)limb_index, (uint8_t)(index + 1), nodes->parameter_hash,
                         &nodes->joint_parameters[(limb_index * JOINTS_PER_LIMB) + index]);
  }
}

static bool parameters_are_good(const crux_nodes *nodes) {
  for (int i = 0; i < CRUX_JOINTS; i++) {
    const char *fault = crux_joint_parameters_fault(&nodes->joint_parameters[i]);
    if (fault != NULL) {
      (void)snprintf(last_error, sizeof(last_error), "joint %d of limb %d: %s makes no sense",
                     (i % JOINTS_PER_LIMB) + 1, i / JOINTS_PER_LIMB, fault);
      return false;
    }
  }
  for (int i = 0; i < CRUX_LIMBS; i++) {
    const char *fault = crux_gripper_parameters_fault(&nodes->gripper_parameters[i]);
    if (fault != NULL) {
      (void)snprintf(last_error, sizeof(last_error), "gripper of limb %d: %s makes no sense", i, fault);
      return false;
    }
  }
  return true;
}

crux_nodes *crux_nodes_open(const char *const bus_urls[CRUX_LIMBS], const crux_joint_parameters joint[CRUX_JOINTS],
                            const crux_gripper_parameters gripper[CRUX_LIMBS], uint32_t parameter_hash) {
  crux_nodes *nodes = calloc(1, sizeof(*nodes));
  if (nodes == NULL) {
    (void)snprintf(last_error, sizeof(last_error), "out of memory");
    return NULL;
  }
  (void)memcpy(nodes->joint_parameters, joint, sizeof(nodes->joint_parameters));
  (void)memcpy(nodes->gripper_parameters, gripper, sizeof(nodes->gripper_parameters));
  nodes->parameter_hash = parameter_hash;
  nodes->host_state = NO_HOST_STATE;
  for (int l = 0; l < CRUX_LIMBS; l++) {
    nodes->limbs[l].bus = (crux_bus){.receive_fd = -1, .send_fd = -1};
  }
  bool good = parameters_are_good(nodes);
  for (int l = 0; good && (l < CRUX_LIMBS); l++) {
    limb *owner = &nodes->limbs[l];
    good = crux_bus_open(&owner->bus, bus_urls[l], last_error, sizeof(last_error));
    owner->connected = true;
    owner->gripper_inputs.temperature_degC = ROOM_TEMPERATURE_DEG_C;
    for (int i = 0; i < JOINTS_PER_LIMB; i++) {
      owner->joint_inputs[i].temperature_degC = ROOM_TEMPERATURE_DEG_C;
    }
    for (int i = 0; i < NODES_PER_LIMB; i++) {
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

static bool concerns(const crux_frame *frame, int index) {
  return (frame->id == (uint16_t)CRUX_CAN_ID_SYNC) || (frame->id == (uint16_t)CRUX_CAN_ID_JOINT_COMMAND(index + 1));
}

void crux_nodes_deliver(limb *owner, int index, const crux_frame *frame) {
  interference *disturbed = &owner->interference[index];
  crux_frame heard = *frame;
  if (!concerns(frame, index) || crux_interference_use_up(&disturbed->drop_received) ||
      crux_interference_loses(disturbed)) {
    return;
  }
  if (crux_interference_use_up(&disturbed->corrupt_received)) {
    heard.data[heard.length / 2U] ^= 0x01U;
  }
  if (index == GRIPPER) {
    crux_gripper_node_on_frame(&owner->gripper, &heard);
  } else {
    crux_joint_node_on_frame(&owner->joint[index], &heard);
  }
}

static bool is_whole(const crux_frame *frame, uint32_t length) {
  struct crux_e2e_receiver receiver = {0};
  return (frame->length == length) &&
         crux_e2e_is_usable(crux_e2e_check(frame->id, frame->data, frame->length, &receiver));
}

/// What the bench itself needs to know from the bus: which cycle it is and what the host is doing.
static void listen(crux_nodes *nodes, int limb_index, const crux_frame *frame) {
  if ((frame->id == CRUX_CAN_ID_SYNC) && is_whole(frame, CRUX_CAN_LENGTH_SYNC)) {
    struct crux_can_sync_t sync;
    (void)crux_can_sync_unpack(&sync, frame->data, frame->length);
    nodes->limbs[limb_index].sync_cycle = sync.cycle;
    nodes->limbs[limb_index].sync_new = true;
  } else if ((frame->id == CRUX_CAN_ID_HOST_HEARTBEAT) && is_whole(frame, CRUX_CAN_LENGTH_HOST_HEARTBEAT)) {
    struct crux_can_host_heartbeat_t heartbeat;
    (void)crux_can_host_heartbeat_unpack(&heartbeat, frame->data, frame->length);
    nodes->host_state = heartbeat.host_state;
  } else {
    // only for the nodes
  }
}

bool crux_nodes_bus_failure(int limb_index, const char *what) {
  (void)snprintf(last_error, sizeof(last_error), "bus of limb %d: %s: %s", limb_index, what, strerror(errno));
  return false;
}

static bool drain(crux_nodes *nodes, int limb_index) {
  crux_frame frames[CRUX_BUS_BATCH];
  int received = CRUX_BUS_BATCH;
  while (received == CRUX_BUS_BATCH) {
    int count = 0;
    received = crux_bus_receive(&nodes->limbs[limb_index].bus, frames, &count);
    if (received < 0) {
      return crux_nodes_bus_failure(limb_index, "cannot receive");
    }
    for (int f = 0; f < count; f++) {
      listen(nodes, limb_index, &frames[f]);
      for (int i = 0; i < NODES_PER_LIMB; i++) {
        crux_nodes_deliver(&nodes->limbs[limb_index], i, &frames[f]);
      }
    }
  }
  return true;
}

/// All connected buses have brought a new Sync of the same cycle, which `cycle` then is.
static bool all_synchronised(const crux_nodes *nodes, uint32_t *cycle) {
  bool any = false;
  bool all = true;
  for (int l = 0; l < CRUX_LIMBS; l++) {
    const limb *owner = &nodes->limbs[l];
    if (owner->connected) {
      all = all && owner->sync_new && (!any || (owner->sync_cycle == *cycle));
      any = true;
      *cycle = owner->sync_cycle;
    }
  }
  return any && all;
}

static int64_t now_ms(void) {
  struct timespec now;
  (void)clock_gettime(CLOCK_MONOTONIC, &now);
  return ((int64_t)now.tv_sec * 1000) + (now.tv_nsec / 1000000);
}

int crux_nodes_wait_sync(crux_nodes *nodes, int timeout_ms, uint32_t *cycle) {
  const int64_t deadline_ms = now_ms() + timeout_ms;
  struct pollfd polled[CRUX_LIMBS];
  for (int l = 0; l < CRUX_LIMBS; l++) {
    const int descriptor = nodes->limbs[l].connected ? nodes->limbs[l].bus.receive_fd : -1;  // poll skips negatives
    polled[l] = (struct pollfd){.fd = descriptor, .events = POLLIN};
  }
  while (!all_synchronised(nodes, cycle)) {
    const int64_t left_ms = deadline_ms - now_ms();
    const int ready = poll(polled, CRUX_LIMBS, (left_ms > 0) ? (int)left_ms : 0);
    if ((ready == 0) || ((ready < 0) && (errno == EINTR))) {
      return 0;
    }
    if (ready < 0) {
      (void)snprintf(last_error, sizeof(last_error), "poll: %s", strerror(errno));
      return -1;
    }
    for (int l = 0; l < CRUX_LIMBS; l++) {
      if ((polled[l].revents != 0) && !drain(nodes, l)) {
        return -1;
      }
    }
  }
  for (int l = 0; l < CRUX_LIMBS; l++) {
    nodes->limbs[l].sync_new = false;
  }
  return 1;
}

void crux_nodes_control(crux_nodes *nodes, double dt, const double joint_position[CRUX_JOINTS],
                        const double joint_velocity[CRUX_JOINTS], const double finger_opening[CRUX_LIMBS],
                        const double finger_speed[CRUX_LIMBS], const double finger_force[CRUX_LIMBS],
                        double joint_torque_out[CRUX_JOINTS], double finger_force_out[CRUX_LIMBS]) {
  for (int l = 0; l < CRUX_LIMBS; l++) {
    limb *owner = &nodes->limbs[l];
    for (int i = 0; i < JOINTS_PER_LIMB; i++) {
      const int j = (l * JOINTS_PER_LIMB) + i;
      crux_joint_outputs outputs;
      owner->joint_inputs[i].position_rad = (float)joint_position[j];
      owner->joint_inputs[i].velocity_rad_s = (float)joint_velocity[j];
      crux_joint_node_tick(&owner->joint[i], (float)dt, &owner->joint_inputs[i], &outputs);
      joint_torque_out[j] = (double)outputs.torque_Nm;
    }
    crux_gripper_outputs outputs;
    owner->gripper_inputs.opening_m = (float)finger_opening[l];
    owner->gripper_inputs.speed_m_s = (float)finger_speed[l];
    owner->gripper_inputs.force_N = (float)finger_force[l];
    crux_gripper_node_tick(&owner->gripper, (float)dt, &owner->gripper_inputs, &outputs);
    finger_force_out[l] = (double)outputs.force_N;
  }
}

/// Moves what the node wants to say to the end of `frames`; returns their new number.
static int collect(crux_link *link, interference *disturbed, crux_frame *frames, int count) {
  while (crux_link_take_frame(link, &frames[count])) {
    const bool lost = crux_interference_use_up(&disturbed->drop_sent) || crux_interference_loses(disturbed);
    count += lost ? 0 : 1;
  }
  return count;
}

int crux_nodes_publish(crux_nodes *nodes, const double joint_position[CRUX_JOINTS],
                       const double joint_velocity[CRUX_JOINTS], const double joint_torque[CRUX_JOINTS],
                       const double finger_opening[CRUX_LIMBS], const double finger_speed[CRUX_LIMBS],
                       const double finger_force[CRUX_LIMBS], const double ft_wrench[CRUX_LIMBS * 6]) {
  // A link's queue may be full, and take_frame touches the entry after the last one.
  crux_frame frames[(CRUX_CAN_NODES * CRUX_QUEUE_LENGTH) + 1U];
  int result = 0;
  for (int l = 0; l < CRUX_LIMBS; l++) {
    limb *owner = &nodes->limbs[l];
    int count = 0;
    for (int i = 0; i < JOINTS_PER_LIMB; i++) {
      const int j = (l * JOINTS_PER_LIMB) + i;
      crux_joint_inputs *inputs = &owner->joint_inputs[i];
      inputs->position_rad = (float)joint_position[j];
      inputs->velocity_rad_s = (float)joint_velocity[j];
      inputs->torque_Nm = (float)joint_torque[j];
      crux_joint_node_publish(&owner->joint[i], inputs);
      count = collect(&owner->joint[i].link, &owner->interference[i], frames, count);
    }
    crux_gripper_inputs *inputs = &owner->gripper_inputs;
    inputs->opening_m = (float)finger_opening[l];
    inputs->speed_m_s = (float)finger_speed[l];
    inputs->force_N = (float)finger_force[l];
    inputs->wrench_valid = true;
    for (int i = 0; i < 6; i++) {
      inputs->wrench[i] = (float)ft_wrench[(l * 6) + i];
    }
    crux_gripper_node_publish(&owner->gripper, inputs);
    count = collect(&owner->gripper.link, &owner->interference[GRIPPER], frames, count);
    if (owner->connected && !crux_bus_send(&owner->bus, frames, count)) {
      (void)crux_nodes_bus_failure(l, "cannot send");
      result = -1;
    }
  }
  return result;
}

uint8_t crux_nodes_host_state(const crux_nodes *nodes) { return nodes->host_state; }

void crux_nodes_states(const crux_nodes *nodes, uint8_t joint_state[CRUX_JOINTS], uint8_t joint_faults[CRUX_JOINTS],
                       uint8_t gripper_state[CRUX_LIMBS], uint8_t gripper_faults[CRUX_LIMBS]) {
  for (int l = 0; l < CRUX_LIMBS; l++) {
    for (int i = 0; i < JOINTS_PER_LIMB; i++) {
      joint_state[(l * JOINTS_PER_LIMB) + i] = nodes->limbs[l].joint[i].state;
      joint_faults[(l * JOINTS_PER_LIMB) + i] = nodes->limbs[l].joint[i].link.faults;
    }
    gripper_state[l] = nodes->limbs[l].gripper.state;
    gripper_faults[l] = nodes->limbs[l].gripper.link.faults;
  }
}

bool crux_nodes_exists(int limb_index, int node) {
  const bool found = (limb_index >= 0) && (limb_index < CRUX_LIMBS) && (node >= 1) && (node <= NODES_PER_LIMB);
  if (!found) {
    (void)snprintf(last_error, sizeof(last_error), "no node %d on limb %d: nodes are 1..%d, limbs 0..%d", node,
                   limb_index, NODES_PER_LIMB, CRUX_LIMBS - 1);
  }
  return found;
}

int crux_nodes_counters(const crux_nodes *nodes, int limb_index, int node, crux_node_counters *counters) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  const limb *owner = &nodes->limbs[limb_index];
  *counters = (node - 1 == GRIPPER) ? owner->gripper.link.counters : owner->joint[node - 1].link.counters;
  return 0;
}
