/// Frames on their way from the buses to the nodes, and what the bench itself learns from them.
#include <errno.h>
#include <poll.h>
#include <time.h>

#include "e2e.h"
#include "robot_nodes.h"

/// The host asks this node who it is; its other heartbeats concern no node.
static bool asks(const crux_frame *frame, int index) {
  struct crux_can_host_heartbeat_t heartbeat = {0};
  return (frame->id == (uint16_t)CRUX_CAN_ID_HOST_HEARTBEAT) &&
         (crux_can_host_heartbeat_unpack(&heartbeat, frame->data, frame->length) == 0) &&
         crux_link_is_asked(heartbeat.identify, (uint8_t)(index + 1));
}

static bool concerns(const crux_frame *frame, int index) {
  return (frame->id == (uint16_t)CRUX_CAN_ID_SYNC) || (frame->id == (uint16_t)CRUX_CAN_ID_BROADCAST) ||
         (frame->id == (uint16_t)CRUX_CAN_ID_JOINT_COMMAND(index + 1)) ||
         (frame->id == (uint16_t)CRUX_CAN_ID_JOINT_REQUEST(index + 1)) || asks(frame, index);
}

void crux_nodes_deliver(limb *owner, int index, const crux_frame *frame) {
  interference *disturbed = &owner->interference[index];
  const crux_outside_node *outside = owner->outside[index];
  crux_frame heard = *frame;
  if (!crux_interference_powers(disturbed)) {
    return;
  }
  if (!concerns(frame, index)) {
    if (outside != NULL) {
      outside->hear(outside->context, frame);  // a controller of its own chooses
    }
    return;
  }
  if (disturbed->off || crux_interference_use_up(&disturbed->drop_received) || crux_interference_loses(disturbed)) {
    return;
  }
  if (crux_interference_use_up(&disturbed->corrupt_received)) {
    heard.data[heard.length / 2U] ^= 0x01U;
  }
  if (outside != NULL) {
    outside->hear(outside->context, &heard);
  } else if (heard.id == (uint16_t)CRUX_CAN_ID_JOINT_REQUEST(index + 1)) {
    crux_nodes_request(owner, index, &heard);
  } else if (index == GRIPPER) {
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
  } else if ((frame->id == CRUX_CAN_ID_BROADCAST) && is_whole(frame, CRUX_CAN_LENGTH_BROADCAST)) {
    struct crux_can_broadcast_header_t header;
    (void)crux_can_broadcast_header_unpack(&header, frame->data, frame->length);
    // It carries the low half of the cycle; the rest follows from the cycle before.
    limb *owner = &nodes->limbs[limb_index];
    owner->sync_cycle += (uint16_t)(header.cycle - (uint16_t)owner->sync_cycle);
    owner->sync_new = true;
  } else if ((frame->id == CRUX_CAN_ID_HOST_HEARTBEAT) && is_whole(frame, CRUX_CAN_LENGTH_HOST_HEARTBEAT)) {
    struct crux_can_host_heartbeat_t heartbeat;
    (void)crux_can_host_heartbeat_unpack(&heartbeat, frame->data, frame->length);
    nodes->host_state = heartbeat.host_state;
  } else {
    // only for the nodes
  }
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

static bool drain_memory(crux_nodes *nodes) {
  for (int l = 0; l < CRUX_LIMBS; l++) {
    if ((nodes->limbs[l].bus.kind == CRUX_BUS_MEMORY) && !drain(nodes, l)) {
      return false;
    }
  }
  return true;
}

int crux_nodes_wait_sync(crux_nodes *nodes, int timeout_ms, uint32_t *cycle) {
  const int64_t deadline_ms = now_ms() + timeout_ms;
  struct pollfd polled[CRUX_LIMBS];
  for (int l = 0; l < CRUX_LIMBS; l++) {
    const int descriptor = nodes->limbs[l].connected ? nodes->limbs[l].bus.receive_fd : -1;  // poll skips negatives
    polled[l] = (struct pollfd){.fd = descriptor, .events = POLLIN};
  }
  if (!drain_memory(nodes)) {
    return -1;
  }
  while (!all_synchronised(nodes, cycle)) {
    const int64_t left_ms = deadline_ms - now_ms();
    const int ready = poll(polled, CRUX_LIMBS, (left_ms > 0) ? (int)left_ms : 0);
    if ((ready == 0) || ((ready < 0) && (errno == EINTR))) {
      return 0;
    }
    if (ready < 0) {
      (void)crux_nodes_failure("poll");
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
