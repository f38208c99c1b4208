/// Flash of an STM32G4 in memory: pages of 2 KiB erased to 0xFF, double words written once, and the power may fail in
/// the middle of either. A double word whose write was cut short reads as erased, as written, or not at all (ECC).
#ifndef CRUX_FIRMWARE_FLASH_MODEL_H
#define CRUX_FIRMWARE_FLASH_MODEL_H

#include "flash.h"

/// What is left of the operation in which the power fails.
typedef enum crux_flash_cut {
  CRUX_FLASH_CUT_BEFORE,  ///< nothing has happened yet
  CRUX_FLASH_CUT_WITHIN,  ///< unreadable; of a page some is erased, some unreadable, some as before
  CRUX_FLASH_CUT_AFTER    ///< all has happened
} crux_flash_cut;

typedef struct crux_flash_model {
  uint8_t *bytes;
  bool *damaged;  ///< one a double word
  uint32_t size;
  uint32_t operations;  ///< writes and erases so far
  uint32_t cut_at;      ///< the operation (counted from 1) in which the power fails; 0: never
  crux_flash_cut cut;
  bool off;  ///< no operation happens any more
} crux_flash_model;

/// Erased memory of `size` bytes (whole pages): `bytes` and size / CRUX_FLASH_UNIT `damaged` flags belong to the
/// caller.
void crux_flash_model_init(crux_flash_model *model, uint8_t *bytes, bool *damaged, uint32_t size);

/// The power comes back; it fails again in operation `cut_at` from now on.
void crux_flash_model_power(crux_flash_model *model, uint32_t cut_at, crux_flash_cut cut);

/// The model as the services see it.
crux_flash crux_flash_model_interface(crux_flash_model *model);

#endif
