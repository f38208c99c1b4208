/// The nodes' services and what they keep without power.
#include <stddef.h>
#include <string.h>

#include "robot_nodes.h"

void crux_nodes_new_memory(memory *memory, uint32_t kind) {
  crux_flash_model_init(&memory->model, memory->bytes, memory->damaged, sizeof(memory->bytes));
  memory->flash = crux_flash_model_interface(&memory->model);
  memory->store = (crux_store){.flash = &memory->flash, .count = 2U, .pages = {0U, CRUX_FLASH_PAGE}};
  memory->slots = (crux_slots){
      .flash = &memory->flash, .address = {STORE_BYTES, STORE_BYTES + SLOT_BYTES}, .size = SLOT_BYTES, .kind = kind};
}

/// What the boot stage does: chooses a slot. Nodes that have never been updated run what is built into this library.
static uint32_t boot(crux_nodes *nodes, int limb_index, int index) {
  limb *owner = &nodes->limbs[limb_index];
  crux_running running;
  if (!crux_boot(&owner->memory[index].slots, &running)) {
    running.version = CRUX_FIRMWARE_VERSION;
  }
  crux_update_init(&owner->update[index], &owner->memory[index].slots, &running);
  return running.version;
}

void crux_nodes_trust(crux_nodes *nodes, const uint8_t key[CRUX_IMAGE_KEY]) {
  (void)memcpy(nodes->key, key, sizeof(nodes->key));
  for (int l = 0; l < CRUX_LIMBS; l++) {
    for (int i = 0; i < NODES_PER_LIMB; i++) {
      nodes->limbs[l].memory[i].slots.key = nodes->key;
    }
  }
}

int crux_nodes_cut_power(crux_nodes *nodes, int limb_index, int node, uint32_t operation) {
  if (!crux_nodes_exists(limb_index, node)) {
    return -1;
  }
  crux_flash_model_power(&nodes->limbs[limb_index].memory[node - 1].model, operation, CRUX_FLASH_CUT_WITHIN);
  return 0;
}

void crux_nodes_start_node(crux_nodes *nodes, int limb_index, int index) {
  limb *owner = &nodes->limbs[limb_index];
  const crux_outside_node *outside = owner->outside[index];
  crux_service *service = &owner->service[index];
  const crux_store *store = &owner->memory[index].store;
  const uint8_t number = (uint8_t)(index + 1);
  const uint32_t version = (outside == NULL) ? boot(nodes, limb_index, index) : 0U;
  if (outside != NULL) {
    outside->restart(outside->context);
  } else if (index == GRIPPER) {
    crux_gripper_parameters parameters = nodes->gripper_parameters[limb_index];
    crux_service_init(service, number, version, nodes->parameter_hash, &parameters, store);
    crux_service_offer_update(service, &owner->update[index]);
    crux_gripper_node_init(&owner->gripper, (uint8_t)limb_index, nodes->parameter_hash, &parameters);
    crux_service_attach(service, &owner->gripper.parameters);
  } else {
    crux_joint_parameters parameters = nodes->joint_parameters[(limb_index * JOINTS_PER_LIMB) + joint_of(index)];
    crux_service_init(service, number, version, nodes->parameter_hash, &parameters, store);
    crux_service_offer_update(service, &owner->update[index]);
    crux_joint_node_init(&owner->joint[index], (uint8_t)limb_index, number, nodes->parameter_hash, &parameters);
    crux_service_attach(service, &owner->joint[index].parameters);
  }
}

static uint8_t state_of(const limb *owner, int index) {
  return (index == GRIPPER) ? owner->gripper.state : owner->joint[index].state;
}

static bool is_commanded(const limb *owner, int index) {
  return crux_guard_is_commanded((index == GRIPPER) ? &owner->gripper.guard : &owner->joint[index].guard);
}

void crux_nodes_request(limb *owner, int index, const crux_frame *frame) {
  crux_service_on_frame(&owner->service[index], frame, state_of(owner, index));
}

void crux_nodes_serve(crux_nodes *nodes, int limb_index, uint32_t dt_us) {
  limb *owner = &nodes->limbs[limb_index];
  for (int i = 0; i < NODES_PER_LIMB; i++) {
    if ((owner->outside[i] == NULL) && crux_interference_powers(&owner->interference[i])) {
      crux_service_tick(&owner->service[i], dt_us, state_of(owner, i), is_commanded(owner, i));
      if (crux_service_restarts(&owner->service[i])) {
        crux_nodes_start_node(nodes, limb_index, i);
        owner->interference[i].restarts = true;
      }
    }
  }
}
