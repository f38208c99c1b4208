/// FDCAN1 for one node: hears the Sync and the node's command, sends what the node queues.
#ifndef CRUX_STM32G474_FDCAN_H
#define CRUX_STM32G474_FDCAN_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"

/// Sets bit rates and filters and joins the bus.
void fdcan_init(uint16_t sync_id, uint16_t command_id);

/// Pops a received frame; false when there is none.
bool fdcan_receive(crux_frame *frame);

/// True when the controller can take a frame to send.
bool fdcan_can_send(void);

/// Hands a frame to the controller, which must have room for it.
void fdcan_send(const crux_frame *frame);

/// True while the controller is off the bus; asks it to come back.
bool fdcan_recover(void);

#endif
