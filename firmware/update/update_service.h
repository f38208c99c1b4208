/// The services of an update over ISO-TP (msgs/can/README.md): download, transfer, exit.
#ifndef CRUX_FIRMWARE_UPDATE_SERVICE_H
#define CRUX_FIRMWARE_UPDATE_SERVICE_H

#include "reply.h"
#include "update.h"

/// Bytes of a block: what a message holds beside service and number, in whole double words.
#define CRUX_UPDATE_BLOCK (CRUX_ISOTP_RECEIVED_CAPACITY - CRUX_FLASH_UNIT)

/// Time that a new image must run, its sensors well and a tool heard, until it is kept.
#define CRUX_UPDATE_PROBATION_US 1000000U

/// Answers a request whose service is DOWNLOAD, TRANSFER or TRANSFER_EXIT; returns the refusal. Only a node at rest
/// that no host commands takes an image, and only from an operator who has the robot off the wall: the restart that
/// ends it drops the joint.
uint8_t crux_update_serve(crux_update *update, const uint8_t *request, uint16_t length, uint8_t state, bool commanded,
                          crux_reply *reply);

/// Tells of the slots: running slot, whether it is confirmed, its version, the other slot's, the longest payload and
/// the address that the next image must be linked for.
void crux_update_tell(const crux_update *update, crux_reply *reply);

#endif
