/// The nodes' services and what they keep without power.
#include "robot_nodes.h"

void crux_nodes_new_memory(memory *memory) {
  crux_flash_model_init(&memory->model, memory->bytes, memory->damaged, sizeof(memory->bytes));
  memory->flash = crux_flash_model_interface(&memory->model);
  memory->store = (crux_store){.flash = &memory->flash, .pages = {0U, CRUX_FLASH_PAGE}};
}

void crux_nodes_start_node(crux_nodes *nodes, int limb_index, int index) {
  limb *owner = &nodes->limbs[limb_index];
  const crux_outside_node *outside = owner->outside[index];
  crux_service *service = &owner->service[index];
  const crux_store *store = &owner->memory[index].store;
  const uint8_t number = (uint8_t)(index + 1);
  if (outside != NULL) {
    outside->restart(outside->context);
  } else if (index == GRIPPER) {
    crux_gripper_parameters parameters = nodes->gripper_parameters[limb_index];
    crux_service_init(service, number, CRUX_FIRMWARE_VERSION, nodes->parameter_hash, &parameters, store);
    crux_gripper_node_init(&owner->gripper, (uint8_t)limb_index, nodes->parameter_hash, &parameters);
    crux_service_attach(service, &owner->gripper.parameters);
  } else {
    crux_joint_parameters parameters = nodes->joint_parameters[(limb_index * JOINTS_PER_LIMB) + index];
    crux_service_init(service, number, CRUX_FIRMWARE_VERSION, nodes->parameter_hash, &parameters, store);
    crux_joint_node_init(&owner->joint[index], (uint8_t)limb_index, number, nodes->parameter_hash, &parameters);
    crux_service_attach(service, &owner->joint[index].parameters);
  }
}

static uint8_t state_of(const limb *owner, int index) {
  return (index == GRIPPER) ? owner->gripper.state : owner->joint[index].state;
}

void crux_nodes_request(limb *owner, int index, const crux_frame *frame) {
  crux_service_on_frame(&owner->service[index], frame, state_of(owner, index));
}

void crux_nodes_serve(crux_nodes *nodes, int limb_index, uint32_t dt_us) {
  limb *owner = &nodes->limbs[limb_index];
  for (int i = 0; i < NODES_PER_LIMB; i++) {
    if (owner->outside[i] == NULL) {
      crux_service_tick(&owner->service[i], dt_us, state_of(owner, i));
      if (crux_service_restarts(&owner->service[i])) {
        crux_nodes_start_node(nodes, limb_index, i);
      }
    }
  }
}
