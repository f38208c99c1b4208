/// The nodes of a robot as the sources of this library know them; users of the library include crux_nodes.h.
#ifndef CRUX_FIRMWARE_ROBOT_NODES_H
#define CRUX_FIRMWARE_ROBOT_NODES_H

#include "bus.h"
#include "crux_nodes.h"
#include "flash_model.h"
#include "gripper_node.h"
#include "joint_node.h"
#include "service.h"

#define JOINTS_PER_LIMB ((int)CRUX_CAN_JOINTS)
#define NODES_PER_LIMB ((int)CRUX_CAN_NODES)
#define GRIPPER ((int)CRUX_CAN_NODE_GRIPPER - 1)  ///< index of the gripper among a limb's nodes

/// Index of a joint among its limb's nodes, and back.
static inline int node_of(int joint) { return (int)CRUX_CAN_NODE_OF_JOINT((uint32_t)joint) - 1; }
static inline int joint_of(int index) { return (int)CRUX_CAN_JOINT_OF_NODE((uint32_t)index + 1U); }

/// What the bench does to a node's frames.
typedef struct interference {
  uint32_t drop_received;
  uint32_t corrupt_received;
  uint32_t drop_sent;
  bool off;               ///< the node's controller has left the bus
  uint32_t lost_of_2_32;  ///< share of frames that get lost, both ways; UINT32_MAX: all of them
  uint32_t random;        ///< state of the generator that chooses them, never 0
  uint8_t supply;         ///< crux_supply
  bool restarts;          ///< has, since the last control period
} interference;

#define SLOT_BYTES (32U * CRUX_FLASH_PAGE)
#define STORE_BYTES (2U * CRUX_FLASH_PAGE)
#define MEMORY_BYTES (STORE_BYTES + (CRUX_SLOTS * SLOT_BYTES))

/// What a node keeps without power: saved parameters, two slots for images.
typedef struct memory {
  uint8_t bytes[MEMORY_BYTES];
  bool damaged[MEMORY_BYTES / CRUX_FLASH_UNIT];
  crux_flash_model model;
  crux_flash flash;
  crux_store store;
  crux_slots slots;
} memory;

typedef struct limb {
  crux_bus bus;
  crux_joint_node joint[CRUX_CAN_NODES];  ///< not that of the gripper
  crux_gripper_node gripper;
  crux_joint_inputs joint_inputs[CRUX_CAN_NODES];
  crux_gripper_inputs gripper_inputs;
  interference interference[CRUX_CAN_NODES];
  memory memory[CRUX_CAN_NODES];
  crux_service service[CRUX_CAN_NODES];
  crux_update update[CRUX_CAN_NODES];
  const crux_outside_node *outside[CRUX_CAN_NODES];  ///< in place of ours, NULL: none
  uint32_t sync_cycle;
  bool sync_new;
  bool connected;
} limb;

struct crux_nodes {
  limb limbs[CRUX_LIMBS];
  crux_joint_parameters joint_parameters[CRUX_JOINTS];
  crux_gripper_parameters gripper_parameters[CRUX_LIMBS];
  uint32_t parameter_hash;
  uint8_t key[CRUX_IMAGE_KEY];  ///< that images must be signed with
  uint8_t host_state;
};

/// Flash as it comes from the factory, for a node of this kind.
void crux_nodes_new_memory(memory *memory, uint32_t kind);

/// Hands a request to a node's services.
void crux_nodes_request(limb *owner, int index, const crux_frame *frame);

/// Time passes for the services of a limb's nodes.
void crux_nodes_serve(crux_nodes *nodes, int limb_index, uint32_t dt_us);

/// Starts a node anew, by its index.
void crux_nodes_start_node(crux_nodes *nodes, int limb_index, int index);

/// Hands a frame of the bus to one of the limb's nodes, if it concerns it and does not get lost.
void crux_nodes_deliver(limb *owner, int index, const crux_frame *frame);

/// False, with the reason in crux_nodes_error(), when there is no such node: limb 0..3, node 1..8.
bool crux_nodes_exists(int limb_index, int node);

/// What crux_nodes_error() says.
#define CRUX_NODES_ERROR_BYTES 256
extern _Thread_local char crux_nodes_last_error[CRUX_NODES_ERROR_BYTES];

/// Keep errno's words for crux_nodes_error(), of a bus or of all; always false.
bool crux_nodes_bus_failure(int limb_index, const char *what);
bool crux_nodes_failure(const char *what);

/// Counts one down; false when it was 0 already.
bool crux_interference_use_up(uint32_t *count);

/// Whether chance loses the frame.
bool crux_interference_loses(interference *disturbed);

/// Whether the node has power.
bool crux_interference_powers(const interference *disturbed);

#endif
