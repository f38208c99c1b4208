/// Takes a new image into the slot that the node does not run from. Every answer is a refusal of services.yaml, NONE
/// when all is well. The slot's header page goes first, and its header comes back last: in between it is no image.
#ifndef CRUX_FIRMWARE_UPDATE_H
#define CRUX_FIRMWARE_UPDATE_H

#include "boot.h"

typedef struct crux_update {
  const crux_slots *slots;
  crux_running running;
  bool active;
  uint8_t target;           ///< the slot that does not run
  uint32_t target_version;  ///< what the image there says, 0: none
  uint8_t block;            ///< number of the last one
  uint32_t received;        ///< bytes of the payload
  uint8_t header[CRUX_IMAGE_HEADER];
} crux_update;

/// Judges nothing: a signature takes a microcontroller a tenth of a second, in which a joint that restarts has no
/// current.
void crux_update_init(crux_update *update, const crux_slots *slots, const crux_running *running);

/// A signed header; the image must be for this node, newer than what runs, and what runs must be confirmed.
uint8_t crux_update_begin(crux_update *update, const uint8_t header[CRUX_IMAGE_HEADER]);

/// The next block: numbers count from 1 and wrap; whole double words but for the last block. The last one repeated is
/// accepted and not written again.
uint8_t crux_update_block(crux_update *update, uint8_t number, const uint8_t *bytes, uint32_t length);

/// The payload is complete: when it is what was signed, the image starts with the node's next start.
uint8_t crux_update_end(crux_update *update);

/// Forgets an update that is under way.
void crux_update_abort(crux_update *update);

#endif
