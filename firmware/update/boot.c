#include "boot.h"

#include <string.h>

#include "sha512.h"

#define CHUNK 256U
#define CONFIRMED CRUX_BOOT_TRIES  ///< the mark after those of the tries

static const uint8_t MARK[CRUX_FLASH_UNIT] = {0x4D, 0x41, 0x52, 0x4B, 0x4D, 0x41, 0x52, 0x4B};

static uint32_t mark_address(const crux_slots *slots, uint8_t slot, uint32_t mark) {
  return slots->address[slot] + slots->size - CRUX_FLASH_PAGE + (CRUX_FLASH_UNIT * mark);
}

static bool is_marked(const crux_slots *slots, uint8_t slot, uint32_t mark) {
  return !crux_flash_is_erased(slots->flash, mark_address(slots, slot, mark));
}

static bool put_mark(const crux_slots *slots, uint8_t slot, uint32_t mark) {
  return slots->flash->write(slots->flash->context, mark_address(slots, slot, mark), MARK);
}

uint32_t crux_slot_capacity(const crux_slots *slots) { return slots->size - CRUX_SLOT_PAYLOAD - CRUX_FLASH_PAGE; }

bool crux_slot_payload_is(const crux_slots *slots, uint8_t slot, const crux_image *image) {
  uint8_t bytes[CHUNK];
  uint8_t digest[CRUX_SHA512_LENGTH];
  crux_sha512 sha;
  bool readable = image->length <= crux_slot_capacity(slots);
  crux_sha512_init(&sha);
  for (uint32_t done = 0U; readable && (done < image->length);) {
    const uint32_t left = image->length - done;
    const uint32_t taken = (left < CHUNK) ? left : CHUNK;
    readable = slots->flash->read(slots->flash->context, slots->address[slot] + CRUX_SLOT_PAYLOAD + done, bytes, taken);
    crux_sha512_add(&sha, bytes, taken);
    done += taken;
  }
  crux_sha512_end(&sha, digest);
  return readable && (memcmp(digest, image->digest, sizeof(digest)) == 0);
}

bool crux_slot_suits(const crux_slots *slots, uint8_t slot, const crux_image *image) {
  const uint32_t wanted = (slots->origin == 0U) ? 0U : (slots->origin + slots->address[slot] + CRUX_SLOT_PAYLOAD);
  return image->address == wanted;
}

bool crux_slot_is_valid(const crux_slots *slots, uint8_t slot, uint32_t *version) {
  uint8_t header[CRUX_IMAGE_HEADER];
  crux_image image = {0};
  const bool valid = (slots->key != NULL) &&
                     slots->flash->read(slots->flash->context, slots->address[slot], header, sizeof(header)) &&
                     crux_image_read(header, slots->key, &image) && (image.kind == slots->kind) &&
                     crux_slot_suits(slots, slot, &image) && crux_slot_payload_is(slots, slot, &image);
  *version = valid ? image.version : 0U;
  return valid;
}

static uint32_t tries(const crux_slots *slots, uint8_t slot) {
  uint32_t count = 0U;
  while ((count < CRUX_BOOT_TRIES) && is_marked(slots, slot, count)) {
    count++;
  }
  return count;
}

/// How much is to be said for a slot: nothing (invalid), tried in vain, worth a try or confirmed.
static uint8_t worth(const crux_slots *slots, uint8_t slot, uint32_t *version) {
  uint8_t result = 0U;
  if (crux_slot_is_valid(slots, slot, version)) {
    const bool has_hope = is_marked(slots, slot, CONFIRMED) || (tries(slots, slot) < CRUX_BOOT_TRIES);
    result = has_hope ? 2U : 1U;
  }
  return result;
}

bool crux_boot(const crux_slots *slots, crux_running *running) {
  uint32_t version[CRUX_SLOTS];
  const uint8_t first = worth(slots, 0U, &version[0]);
  const uint8_t second = worth(slots, 1U, &version[1]);
  *running = (crux_running){.slot = CRUX_NO_SLOT, .confirmed = true};
  const bool found = (first > 0U) || (second > 0U);
  if (found) {
    const bool is_second = (second > first) || ((second == first) && (version[1] > version[0]));
    const uint8_t slot = is_second ? 1U : 0U;
    const uint32_t tried = tries(slots, slot);
    *running = (crux_running){.slot = slot, .confirmed = is_marked(slots, slot, CONFIRMED), .version = version[slot]};
    if (!running->confirmed && (tried < CRUX_BOOT_TRIES)) {
      (void)put_mark(slots, slot, tried);
    }
  }
  return found;
}

bool crux_boot_confirm(const crux_slots *slots, crux_running *running) {
  if (!running->confirmed) {
    running->confirmed = put_mark(slots, running->slot, CONFIRMED);
  }
  return running->confirmed;
}

void crux_boot_running(const crux_slots *slots, uint8_t slot, crux_running *running) {
  uint8_t header[CRUX_IMAGE_HEADER];
  crux_image image = {0};
  *running = (crux_running){.slot = slot, .confirmed = is_marked(slots, slot, CONFIRMED)};
  if ((slots->key != NULL) && slots->flash->read(slots->flash->context, slots->address[slot], header, sizeof(header)) &&
      crux_image_read(header, slots->key, &image)) {
    running->version = image.version;
  }
}
