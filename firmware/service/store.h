/// A few numbers that outlive the power: snapshots appended to one of two flash pages, the newest whole one counts.
/// A save that is cut short leaves the one before. Two more pages may be read: those of a program in another bank.
#ifndef CRUX_FIRMWARE_STORE_H
#define CRUX_FIRMWARE_STORE_H

#include "flash.h"

#define CRUX_STORE_CAPACITY 31U
#define CRUX_STORE_PAGES 4U

typedef struct crux_stored {
  uint8_t id;
  uint32_t bits;
} crux_stored;

typedef struct crux_store {
  const crux_flash *flash;
  uint8_t count;                     ///< of pages
  uint32_t pages[CRUX_STORE_PAGES];  ///< addresses; the first two are written
} crux_store;

/// The newest snapshot; returns how many entries it has, 0 when there is none.
uint8_t crux_store_load(const crux_store *store, crux_stored entries[CRUX_STORE_CAPACITY]);

/// Saves a snapshot of at most CRUX_STORE_CAPACITY entries; false when the flash fails.
bool crux_store_save(const crux_store *store, const crux_stored *entries, uint8_t count);

#endif
