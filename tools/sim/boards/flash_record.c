#include "flash_record.h"

#include <stdlib.h>
#include <string.h>

#define ROOM 16384U

bool flash_record_begin(flash_record *record, const crux_flash_model *model) {
  const size_t units = model->size / CRUX_FLASH_UNIT;
  flash_record_close(record);
  record->bytes = malloc(model->size);
  record->damaged = malloc(units * sizeof(*record->damaged));
  record->operations = calloc(ROOM, sizeof(*record->operations));
  if ((record->bytes == NULL) || (record->damaged == NULL) || (record->operations == NULL)) {
    flash_record_close(record);
    return false;
  }
  record->room = ROOM;
  (void)memcpy(record->bytes, model->bytes, model->size);
  (void)memcpy(record->damaged, model->damaged, units * sizeof(*record->damaged));
  return true;
}

void flash_record_close(flash_record *record) {
  free(record->bytes);
  free(record->damaged);
  free(record->operations);
  *record = (flash_record){0};
}

void flash_record_add(flash_record *record, const flash_operation *operation) {
  if (record->count < record->room) {
    record->operations[record->count] = *operation;
    record->count++;
  }
}

void flash_record_replay(const flash_record *record, crux_flash_model *model, uint32_t last, crux_flash_cut cut) {
  const crux_flash flash = crux_flash_model_interface(model);
  const uint32_t count = (last < record->count) ? last : record->count;
  (void)memcpy(model->bytes, record->bytes, model->size);
  (void)memcpy(model->damaged, record->damaged, (model->size / CRUX_FLASH_UNIT) * sizeof(*record->damaged));
  crux_flash_model_power(model, last, cut);
  for (uint32_t i = 0U; i < count; i++) {
    const flash_operation *operation = &record->operations[i];
    if (operation->erases) {
      (void)flash.erase(flash.context, operation->address);
    } else {
      (void)flash.write(flash.context, operation->address, operation->unit);
    }
  }
  crux_flash_model_power(model, 0U, CRUX_FLASH_CUT_AFTER);
}
