#include "update.h"

#include <string.h>

#include "crux_services.h"

void crux_update_init(crux_update *update, const crux_slots *slots, const crux_running *running) {
  crux_image other = {0};
  *update = (crux_update){.slots = slots, .running = *running, .target = (running->slot == 0U) ? 1U : 0U};
  update->target_version = crux_slot_claims(slots, update->target, &other) ? other.version : 0U;
}

void crux_update_abort(crux_update *update) { update->active = false; }

uint8_t crux_update_begin(crux_update *update, const uint8_t header[CRUX_IMAGE_HEADER]) {
  const crux_slots *slots = update->slots;
  crux_image image = {0};
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  update->active = false;
  // Everything is judged before anything is erased.
  if ((slots->key == NULL) || !crux_image_read(header, slots->key, &image)) {
    refusal = (uint8_t)CRUX_REFUSAL_SIGNATURE;
  } else if ((image.kind != slots->kind) || !crux_slot_suits(slots, update->target, &image) ||
             (image.version <= update->running.version) || (image.length == 0U) ||
             (image.length > crux_slot_capacity(slots)) || !update->running.confirmed) {
    refusal = (uint8_t)CRUX_REFUSAL_NOT_ACCEPTED;
  } else {
    const uint32_t address = slots->address[update->target];
    // The header first: an image that was tried in vain must not lose its marks and come back.
    const bool erased = slots->flash->erase(slots->flash->context, address) &&
                        slots->flash->erase(slots->flash->context, address + slots->size - CRUX_FLASH_PAGE);
    refusal = erased ? (uint8_t)CRUX_REFUSAL_NONE : (uint8_t)CRUX_REFUSAL_MEMORY;
    update->active = erased;
    update->target_version = 0U;
    update->block = 0U;
    update->received = 0U;
    (void)memcpy(update->header, header, CRUX_IMAGE_HEADER);
  }
  return refusal;
}

static bool write_unit(const crux_flash *flash, uint32_t address, const uint8_t *bytes, uint32_t length) {
  uint8_t unit[CRUX_FLASH_UNIT];
  (void)memset(unit, 0xFF, sizeof(unit));
  (void)memcpy(unit, bytes, length);
  // Pages are erased as they are reached, so that no request takes long.
  const bool ready = ((address % CRUX_FLASH_PAGE) != 0U) || flash->erase(flash->context, address);
  return ready && flash->write(flash->context, address, unit);
}

static uint32_t payload_length(const crux_update *update) {
  const uint8_t *length = &update->header[16];
  return length[0] | ((uint32_t)length[1] << 8U) | ((uint32_t)length[2] << 16U) | ((uint32_t)length[3] << 24U);
}

uint8_t crux_update_block(crux_update *update, uint8_t number, const uint8_t *bytes, uint32_t length) {
  const crux_flash *flash = update->slots->flash;
  const uint32_t left = update->active ? (payload_length(update) - update->received) : 0U;
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  if (!update->active) {
    refusal = (uint8_t)CRUX_REFUSAL_SEQUENCE;
  } else if ((number == update->block) && (update->received > 0U)) {
    // the answer got lost: the block is here already
  } else if (number != (uint8_t)(update->block + 1U)) {
    refusal = (uint8_t)CRUX_REFUSAL_BLOCK_NUMBER;
  } else if ((length == 0U) || (length > left) || (((length % CRUX_FLASH_UNIT) != 0U) && (length != left))) {
    refusal = (uint8_t)CRUX_REFUSAL_LENGTH;
  } else {
    const uint32_t address = update->slots->address[update->target] + CRUX_SLOT_PAYLOAD + update->received;
    bool written = true;
    for (uint32_t done = 0U; written && (done < length); done += CRUX_FLASH_UNIT) {
      const uint32_t rest = length - done;
      written = write_unit(flash, address + done, &bytes[done], (rest < CRUX_FLASH_UNIT) ? rest : CRUX_FLASH_UNIT);
    }
    update->active = written;
    update->block = number;
    update->received += length;
    refusal = written ? (uint8_t)CRUX_REFUSAL_NONE : (uint8_t)CRUX_REFUSAL_MEMORY;
  }
  return refusal;
}

uint8_t crux_update_end(crux_update *update) {
  const crux_slots *slots = update->slots;
  crux_image image = {0};
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  if (!update->active || (update->received != payload_length(update))) {
    refusal = (uint8_t)CRUX_REFUSAL_SEQUENCE;
  } else if (!crux_image_read(update->header, slots->key, &image) ||
             !crux_slot_payload_is(slots, update->target, &image)) {
    refusal = (uint8_t)CRUX_REFUSAL_SIGNATURE;
  } else {
    bool written = true;
    for (uint32_t done = 0U; written && (done < CRUX_IMAGE_HEADER); done += CRUX_FLASH_UNIT) {
      written =
          slots->flash->write(slots->flash->context, slots->address[update->target] + done, &update->header[done]);
    }
    written = written && crux_slot_is_valid(slots, update->target, &update->target_version);
    refusal = written ? (uint8_t)CRUX_REFUSAL_NONE : (uint8_t)CRUX_REFUSAL_MEMORY;
  }
  update->active = false;
  return refusal;
}
