/// What a board has done to its flash since a moment, so that the flash can be made as if the power had failed in any
/// of these operations, without doing again what led there.
#ifndef CRUX_EMULATED_FLASH_RECORD_H
#define CRUX_EMULATED_FLASH_RECORD_H

#include "flash_model.h"

typedef struct flash_operation {
  uint32_t address;
  bool erases;  ///< a page, else a double word is written
  uint8_t unit[CRUX_FLASH_UNIT];
} flash_operation;

typedef struct flash_record {
  uint8_t *bytes;  ///< as they were when the record began; NULL: nothing is recorded
  bool *damaged;
  flash_operation *operations;
  uint32_t count;
  uint32_t room;
} flash_record;

/// Records from now on. False when there is no memory for it.
bool flash_record_begin(flash_record *record, const crux_flash_model *model);
void flash_record_close(flash_record *record);

/// An operation has been done.
void flash_record_add(flash_record *record, const flash_operation *operation);

/// Makes the flash as it would be if the power had failed in operation `last`, counted from 1, and was back now. What
/// follows is not recorded.
void flash_record_replay(const flash_record *record, crux_flash_model *model, uint32_t last, crux_flash_cut cut);

#endif
