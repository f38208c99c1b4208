#include "boot.h"

#include <string.h>

#include "sha512.h"

#define CHUNK 256U
#define KEPT_FIRST CRUX_BOOT_TRIES  ///< the marks after those of the tries; one whose writing was cut short is left
#define KEPT_COUNT 8U
#define CRC_TABLE 256U
#define CRC_POLYNOMIAL 0xEDB88320U  ///< CRC-32 of IEEE 802.3, reflected

static const uint8_t TRIED[CRUX_FLASH_UNIT] = {0x54, 0x52, 0x49, 0x45, 0x54, 0x52, 0x49, 0x45};
static const uint8_t KEPT[4] = {0x4B, 0x45, 0x50, 0x54};  ///< then the CRC of what is kept

static uint32_t mark_address(const crux_slots *slots, uint8_t slot, uint32_t mark) {
  return slots->address[slot] + slots->size - CRUX_FLASH_PAGE + (CRUX_FLASH_UNIT * mark);
}

static bool is_marked(const crux_slots *slots, uint8_t slot, uint32_t mark) {
  return !crux_flash_is_erased(slots->flash, mark_address(slots, slot, mark));
}

static bool put_mark(const crux_slots *slots, uint8_t slot, uint32_t mark, const uint8_t unit[CRUX_FLASH_UNIT]) {
  return slots->flash->write(slots->flash->context, mark_address(slots, slot, mark), unit);
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

uint32_t crux_slot_linked_for(const crux_slots *slots, uint8_t slot) {
  return (slots->origin == 0U) ? 0U : (slots->origin + slots->address[slot] + CRUX_SLOT_PAYLOAD);
}

bool crux_slot_suits(const crux_slots *slots, uint8_t slot, const crux_image *image) {
  return image->address == crux_slot_linked_for(slots, slot);
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

bool crux_slot_claims(const crux_slots *slots, uint8_t slot, crux_image *image) {
  uint8_t header[CRUX_IMAGE_HEADER];
  const bool claims = slots->flash->read(slots->flash->context, slots->address[slot], header, sizeof(header)) &&
                      crux_image_parse(header, image) && (image->kind == slots->kind) &&
                      crux_slot_suits(slots, slot, image) && (image->length <= crux_slot_capacity(slots));
  image->digest = NULL;  // it lay in the header
  return claims;
}

static void make_crc_table(uint32_t table[CRC_TABLE]) {
  for (uint32_t i = 0U; i < CRC_TABLE; i++) {
    uint32_t crc = i;
    for (uint32_t bit = 0U; bit < 8U; bit++) {
      crc = (crc >> 1U) ^ (((crc & 1U) != 0U) ? CRC_POLYNOMIAL : 0U);
    }
    table[i] = crc;
  }
}

/// Adds flash to a CRC; false where it cannot be read.
static bool add_to_crc(const crux_flash *flash, uint32_t address, uint32_t length, const uint32_t table[CRC_TABLE],
                       uint32_t *crc) {
  uint8_t bytes[CHUNK];
  bool readable = true;
  for (uint32_t done = 0U; readable && (done < length);) {
    const uint32_t left = length - done;
    const uint32_t taken = (left < CHUNK) ? left : CHUNK;
    readable = flash->read(flash->context, address + done, bytes, taken);
    for (uint32_t i = 0U; i < taken; i++) {
      *crc = (*crc >> 8U) ^ table[(*crc ^ bytes[i]) & 0xFFU];
    }
    done += taken;
  }
  return readable;
}

/// Of the slot's header and payload.
static bool crc_of(const crux_slots *slots, uint8_t slot, uint32_t length, uint32_t *crc) {
  uint32_t table[CRC_TABLE];
  make_crc_table(table);
  *crc = 0xFFFFFFFFU;
  return add_to_crc(slots->flash, slots->address[slot], CRUX_IMAGE_HEADER, table, crc) &&
         add_to_crc(slots->flash, slots->address[slot] + CRUX_SLOT_PAYLOAD, length, table, crc);
}

/// Reads the mark of an image that has confirmed itself; false when there is no whole one.
static bool kept_crc(const crux_slots *slots, uint8_t slot, uint32_t *crc) {
  bool found = false;
  for (uint32_t i = 0U; (i < KEPT_COUNT) && !found; i++) {
    uint8_t unit[CRUX_FLASH_UNIT];
    found = slots->flash->read(slots->flash->context, mark_address(slots, slot, KEPT_FIRST + i), unit, sizeof(unit)) &&
            (memcmp(unit, KEPT, sizeof(KEPT)) == 0);
    *crc = unit[4] | ((uint32_t)unit[5] << 8U) | ((uint32_t)unit[6] << 16U) | ((uint32_t)unit[7] << 24U);
  }
  return found;
}

static uint32_t tries(const crux_slots *slots, uint8_t slot) {
  uint32_t count = 0U;
  while ((count < CRUX_BOOT_TRIES) && is_marked(slots, slot, count)) {
    count++;
  }
  return count;
}

typedef struct candidate {
  crux_image image;
  bool exists;
  bool kept;  ///< has confirmed itself
  bool hope;  ///< that, or tries are left
  uint32_t crc;
  uint32_t tries;
} candidate;

static candidate look_at(const crux_slots *slots, uint8_t slot) {
  candidate found = {0};
  found.exists = (slots->key != NULL) && crux_slot_claims(slots, slot, &found.image);
  if (found.exists) {
    found.kept = kept_crc(slots, slot, &found.crc);
    found.tries = tries(slots, slot);
    found.hope = found.kept || (found.tries < CRUX_BOOT_TRIES);
  }
  return found;
}

/// A confirmed image was judged by its signature before; that it is still the same a CRC tells in a fiftieth of the
/// time, in which a joint that restarts has no current.
static bool judge(const crux_slots *slots, uint8_t slot, candidate *judged) {
  uint32_t crc = 0U;
  uint32_t version = 0U;
  judged->kept = judged->kept && crc_of(slots, slot, judged->image.length, &crc) && (crc == judged->crc);
  return judged->exists && (judged->kept || crux_slot_is_valid(slots, slot, &version));
}

bool crux_boot(const crux_slots *slots, crux_running *running) {
  candidate candidates[CRUX_SLOTS] = {look_at(slots, 0U), look_at(slots, 1U)};
  const bool newer = candidates[1].image.version > candidates[0].image.version;
  const bool second_first =
      candidates[1].exists &&
      (!candidates[0].exists || ((candidates[1].hope == candidates[0].hope) ? newer : candidates[1].hope));
  bool found = false;
  *running = (crux_running){.slot = CRUX_NO_SLOT, .confirmed = true};
  for (uint8_t i = 0U; (i < CRUX_SLOTS) && !found; i++) {
    const uint8_t slot = (second_first != (i == 1U)) ? 1U : 0U;
    candidate *chosen = &candidates[slot];
    found = judge(slots, slot, chosen);
    if (found) {
      *running = (crux_running){.slot = slot, .confirmed = chosen->kept, .version = chosen->image.version};
      if (!chosen->kept && (chosen->tries < CRUX_BOOT_TRIES)) {
        (void)put_mark(slots, slot, chosen->tries, TRIED);
      }
    }
  }
  return found;
}

bool crux_boot_confirm(const crux_slots *slots, crux_running *running) {
  uint8_t unit[CRUX_FLASH_UNIT];
  uint32_t crc = 0U;
  crux_image image = {0};
  if (!running->confirmed && crux_slot_claims(slots, running->slot, &image) &&
      crc_of(slots, running->slot, image.length, &crc)) {
    (void)memcpy(unit, KEPT, sizeof(KEPT));
    for (uint32_t i = 0U; i < 4U; i++) {
      unit[4U + i] = (uint8_t)(crc >> (8U * i));
    }
    for (uint32_t i = 0U; (i < KEPT_COUNT) && !running->confirmed; i++) {
      running->confirmed =
          !is_marked(slots, running->slot, KEPT_FIRST + i) && put_mark(slots, running->slot, KEPT_FIRST + i, unit);
    }
  }
  return running->confirmed;
}

void crux_boot_running(const crux_slots *slots, uint8_t slot, crux_running *running) {
  crux_image image = {0};
  uint32_t crc = 0U;
  const bool claims = crux_slot_claims(slots, slot, &image);
  *running =
      (crux_running){.slot = slot, .confirmed = kept_crc(slots, slot, &crc), .version = claims ? image.version : 0U};
}
