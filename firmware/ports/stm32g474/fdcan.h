/// FDCAN1 for one node: hears the Sync, the node's command, its requests and the broadcast, sends what the node queues.
/// FDCAN2 for a gripper's force/torque sensor, classic CAN at 1 Mbit/s: looked at once a tick, without an interrupt.
#ifndef CRUX_STM32G474_FDCAN_H
#define CRUX_STM32G474_FDCAN_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"

/// Sets bit rates and filters and joins the bus.
void fdcan_init(uint16_t sync_id, uint16_t command_id, uint16_t request_id, uint16_t broadcast_id,
                uint16_t heartbeat_id);

/// Pops a received frame; false when there is none.
bool fdcan_receive(crux_frame *frame);

/// True when the controller can take a frame to send.
bool fdcan_can_send(void);

/// True when every frame that was handed over is out.
bool fdcan_has_sent(void);

/// Hands a frame to the controller, which must have room for it.
void fdcan_send(const crux_frame *frame);

/// True while the controller is off the bus; asks it to come back.
bool fdcan_recover(void);

/// Joins the sensor's bus, to hear these two identifiers.
void fdcan_sensor_init(uint16_t first_id, uint16_t second_id);

/// Takes a frame from the sensor; false when there is none.
bool fdcan_sensor_receive(crux_frame *frame);

/// Hands a frame to the sensor's bus, if there is room for it.
void fdcan_sensor_send(const crux_frame *frame);

/// Comes back to the sensor's bus after the controller has left it.
void fdcan_sensor_recover(void);

#endif
