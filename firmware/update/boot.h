/// Which of the two slots a node starts from. An image is tried up to three times; one that does not confirm itself in
/// one of them is left for the other slot's. Whatever the power does, a valid image is started when there is one.
///
/// A slot: header (CRUX_IMAGE_HEADER bytes), payload from CRUX_SLOT_PAYLOAD on, and a last page of marks, each a double
/// word that is written once. A try counts when its mark is not clean: also one whose writing was cut short. The mark
/// of a confirmed image must be whole: it holds the CRC by which the image is known at every start from then on.
#ifndef CRUX_FIRMWARE_BOOT_H
#define CRUX_FIRMWARE_BOOT_H

#include <stdbool.h>
#include <stdint.h>

#include "flash.h"
#include "image.h"

#define CRUX_SLOTS 2U
#define CRUX_NO_SLOT 0xFFU      ///< the program runs from outside of the slots
#define CRUX_SLOT_PAYLOAD 512U  ///< alignment of a vector table
#define CRUX_BOOT_TRIES 3U

typedef struct crux_slots {
  const crux_flash *flash;
  uint32_t address[CRUX_SLOTS];
  uint32_t size;       ///< whole pages
  uint32_t origin;     ///< where the processor sees the flash; 0: it does not run from it
  uint32_t kind;       ///< of node
  const uint8_t *key;  ///< that images must be signed with; NULL: none is trusted
} crux_slots;

typedef struct crux_running {
  uint8_t slot;
  bool confirmed;
  uint32_t version;
} crux_running;

/// Whether the slot holds a whole image for this node, and its version.
bool crux_slot_is_valid(const crux_slots *slots, uint8_t slot, uint32_t *version);

/// Whether the slot has a header of an image for this node and place; nobody has judged signature and payload. The
/// image's digest is not told.
bool crux_slot_claims(const crux_slots *slots, uint8_t slot, crux_image *image);

/// Whether the flash from the slot's payload on has this digest.
bool crux_slot_payload_is(const crux_slots *slots, uint8_t slot, const crux_image *image);

/// Where the processor sees a slot's payload: the address that its image must be linked for. 0: none.
uint32_t crux_slot_linked_for(const crux_slots *slots, uint8_t slot);

/// Whether an image runs from the slot: it is linked for it, or for no place.
bool crux_slot_suits(const crux_slots *slots, uint8_t slot, const crux_image *image);

/// For the image that runs from a slot: who it is. Takes no time: the boot stage has judged it.
void crux_boot_running(const crux_slots *slots, uint8_t slot, crux_running *running);

/// Longest payload of a slot.
uint32_t crux_slot_capacity(const crux_slots *slots);

/// Chooses the slot to start and marks the try. False, with CRUX_NO_SLOT, when no slot holds a valid image.
bool crux_boot(const crux_slots *slots, crux_running *running);

/// The running image is healthy: keeps it. False when the flash fails.
bool crux_boot_confirm(const crux_slots *slots, crux_running *running);

#endif
