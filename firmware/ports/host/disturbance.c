/// What the simulation does to the nodes and their buses: lost and damaged frames, cut buses, rogue hosts, restarts,
/// heat.
#include <math.h>
#include <string.h>

#include "robot_nodes.h"

int crux_nodes_drop_received(crux_nodes *nodes, int limb_index, int node, uint32_t count) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  nodes->limbs[limb_index].interference[node - 1].drop_received = count;
  return 0;
}

int crux_nodes_corrupt_received(crux_nodes *nodes, int limb_index, int node, uint32_t count) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  nodes->limbs[limb_index].interference[node - 1].corrupt_received = count;
  return 0;
}

int crux_nodes_drop_sent(crux_nodes *nodes, int limb_index, int node, uint32_t count) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  nodes->limbs[limb_index].interference[node - 1].drop_sent = count;
  return 0;
}

int crux_nodes_disturb(crux_nodes *nodes, int limb_index, int node, int on) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  limb *owner = &nodes->limbs[limb_index];
  const crux_outside_node *outside = owner->outside[node - 1];
  if (outside != NULL) {
    outside->disturb(outside->context, on != 0);
  } else if (node - 1 == GRIPPER) {
    owner->gripper_inputs.bus_off = on != 0;
  } else {
    owner->joint_inputs[node - 1].bus_off = on != 0;
  }
  owner->interference[node - 1].off = (outside == NULL) && (on != 0);
  return 0;
}

int crux_nodes_lose(crux_nodes *nodes, int limb_index, double share, uint32_t seed) {
  if (!crux_nodes_exists(limb_index, 1)) {
    return -1;
  }
  for (int i = 0; i < NODES_PER_LIMB; i++) {
    interference *disturbed = &nodes->limbs[limb_index].interference[i];
    disturbed->lost_of_2_32 = (uint32_t)lround(fmin(fmax(share, 0.0), 1.0) * (double)UINT32_MAX);
    disturbed->random = (seed * 2654435761U) ^ ((uint32_t)i + 1U);
    disturbed->random |= 1U;
  }
  return 0;
}

int crux_nodes_connect(crux_nodes *nodes, int limb_index, int connected) {
  if (!crux_nodes_exists(limb_index, 1)) {
    return -1;
  }
  limb *owner = &nodes->limbs[limb_index];
  crux_frame frames[CRUX_BUS_BATCH];
  int count = 0;
  // What waits in the socket is of the time before, and so is the report that the interface went down.
  while (!owner->connected && (connected != 0) && (crux_bus_receive(&owner->bus, frames, &count) != 0)) {
  }
  owner->sync_new = false;
  owner->connected = connected != 0;
  return 0;
}

int crux_nodes_intrude(crux_nodes *nodes, int limb_index, uint16_t id, const uint8_t *data, int length) {
  if (!crux_nodes_exists(limb_index, 1) || (length < 0) || (length > (int)CRUX_FRAME_CAPACITY)) {
    return -1;
  }
  limb *owner = &nodes->limbs[limb_index];
  crux_frame frame = {.id = id, .length = (uint8_t)length};
  (void)memcpy(frame.data, data, (size_t)length);
  for (int i = 0; i < NODES_PER_LIMB; i++) {
    crux_nodes_deliver(owner, i, &frame);
  }
  if (owner->connected && !crux_bus_send(&owner->bus, &frame, 1)) {
    (void)crux_nodes_bus_failure(limb_index, "cannot send");
    return -1;
  }
  return 0;
}

int crux_nodes_reset(crux_nodes *nodes, int limb_index, int node) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  crux_nodes_start_node(nodes, limb_index, node - 1);
  nodes->limbs[limb_index].interference[node - 1].restarts = true;
  return 0;
}

int crux_nodes_power(crux_nodes *nodes, int limb_index, int node, crux_supply supply) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  interference *disturbed = &nodes->limbs[limb_index].interference[node - 1];
  const bool returns = (disturbed->supply != (uint8_t)CRUX_POWERED) && (supply == CRUX_POWERED);
  disturbed->supply = (uint8_t)supply;
  return returns ? crux_nodes_reset(nodes, limb_index, node) : 0;
}

crux_supply crux_nodes_supply(const crux_nodes *nodes, int limb_index, int node) {
  const interference *disturbed = &nodes->limbs[limb_index].interference[node - 1];
  const bool restarts = (disturbed->supply == (uint8_t)CRUX_POWERED) && disturbed->restarts;
  return restarts ? CRUX_BRAKED : (crux_supply)disturbed->supply;
}

int crux_nodes_set_temperature(crux_nodes *nodes, int limb_index, int node, double temperature_degC) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  limb *owner = &nodes->limbs[limb_index];
  const crux_outside_node *outside = owner->outside[node - 1];
  if (outside != NULL) {
    outside->set_temperature(outside->context, temperature_degC);
  } else if (node - 1 == GRIPPER) {
    owner->gripper_inputs.temperature_degC = (float)temperature_degC;
  } else {
    owner->joint_inputs[node - 1].temperature_degC = (float)temperature_degC;
  }
  return 0;
}
