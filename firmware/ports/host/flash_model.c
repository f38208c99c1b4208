#include "flash_model.h"

#include <string.h>

static bool model_read(void *context, uint32_t address, uint8_t *bytes, uint32_t length) {
  const crux_flash_model *model = context;
  bool good = (address <= model->size) && (length <= (model->size - address));
  for (uint32_t at = address - (address % CRUX_FLASH_UNIT); good && (at < (address + length)); at += CRUX_FLASH_UNIT) {
    good = !model->damaged[at / CRUX_FLASH_UNIT];
  }
  if (good) {
    (void)memcpy(bytes, &model->bytes[address], length);
  }
  return good;
}

/// Counts an operation; what of it happens.
static crux_flash_cut happens(crux_flash_model *model) {
  crux_flash_cut result = model->off ? CRUX_FLASH_CUT_BEFORE : CRUX_FLASH_CUT_AFTER;
  model->operations++;
  if (!model->off && (model->operations == model->cut_at)) {
    model->off = true;
    result = model->cut;
  }
  return result;
}

static bool model_write(void *context, uint32_t address, const uint8_t unit[CRUX_FLASH_UNIT]) {
  crux_flash_model *model = context;
  const crux_flash view = crux_flash_model_interface(model);
  // The controller refuses to write what is not erased.
  if ((address % CRUX_FLASH_UNIT != 0U) || (address >= model->size) || !crux_flash_is_erased(&view, address)) {
    return false;
  }
  const crux_flash_cut done = happens(model);
  if (done != CRUX_FLASH_CUT_BEFORE) {
    (void)memcpy(&model->bytes[address], unit, CRUX_FLASH_UNIT);
    model->damaged[address / CRUX_FLASH_UNIT] = done == CRUX_FLASH_CUT_WITHIN;
  }
  return !model->off;
}

static bool model_erase(void *context, uint32_t address) {
  crux_flash_model *model = context;
  if ((address % CRUX_FLASH_PAGE != 0U) || (address >= model->size)) {
    return false;
  }
  const crux_flash_cut done = happens(model);
  const uint32_t first = address / CRUX_FLASH_UNIT;
  for (uint32_t i = first; (done != CRUX_FLASH_CUT_BEFORE) && (i < first + (CRUX_FLASH_PAGE / CRUX_FLASH_UNIT)); i++) {
    const bool cut_short = done == CRUX_FLASH_CUT_WITHIN;
    if (!cut_short || (i % 3U == 0U)) {
      (void)memset(&model->bytes[i * CRUX_FLASH_UNIT], 0xFF, CRUX_FLASH_UNIT);
      model->damaged[i] = false;
    } else {
      model->damaged[i] = i % 3U == 1U;  // the third still reads as before
    }
  }
  return !model->off;
}

void crux_flash_model_init(crux_flash_model *model, uint8_t *bytes, bool *damaged, uint32_t size) {
  *model = (crux_flash_model){.bytes = bytes, .damaged = damaged, .size = size};
  (void)memset(bytes, 0xFF, size);
  (void)memset(damaged, 0, size / CRUX_FLASH_UNIT);
}

void crux_flash_model_power(crux_flash_model *model, uint32_t cut_at, crux_flash_cut cut) {
  model->off = false;
  model->operations = 0U;
  model->cut_at = cut_at;
  model->cut = cut;
}

crux_flash crux_flash_model_interface(crux_flash_model *model) {
  return (crux_flash){.context = model, .read = model_read, .write = model_write, .erase = model_erase};
}
