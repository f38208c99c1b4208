/// Flash memory as the services see it: pages that are erased whole to 0xFF, double words that are written once after
/// that. Power may fail in the middle of either; what it leaves behind may not be readable (ECC).
#ifndef CRUX_FIRMWARE_FLASH_H
#define CRUX_FIRMWARE_FLASH_H

#include <stdbool.h>
#include <stdint.h>

#define CRUX_FLASH_PAGE 2048U
#define CRUX_FLASH_UNIT 8U

typedef struct crux_flash {
  void *context;
  /// Reads length bytes; false where the memory cannot correct what it reads. Addresses count from the flash's start.
  bool (*read)(void *context, uint32_t address, uint8_t *bytes, uint32_t length);
  /// Writes one erased double word; false on failure.
  bool (*write)(void *context, uint32_t address, const uint8_t unit[CRUX_FLASH_UNIT]);
  /// Erases the page that begins at the address; false on failure.
  bool (*erase)(void *context, uint32_t address);
} crux_flash;

/// Whether a double word is readable and erased.
static inline bool crux_flash_is_erased(const crux_flash *flash, uint32_t address) {
  uint8_t unit[CRUX_FLASH_UNIT];
  bool erased = flash->read(flash->context, address, unit, CRUX_FLASH_UNIT);
  for (uint32_t i = 0U; erased && (i < CRUX_FLASH_UNIT); i++) {
    erased = unit[i] == 0xFFU;
  }
  return erased;
}

#endif
