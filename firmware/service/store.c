#include "store.h"

#include <string.h>

#include "e2e.h"

// A snapshot: CRC (2 bytes), mark, number of entries, sequence number (4); then an entry in eight bytes each.
#define MARK 0x53U
#define CRC_IDENTITY 0x5043U
#define LONGEST ((CRUX_STORE_CAPACITY + 1U) * CRUX_FLASH_UNIT)

static uint32_t word(const uint8_t *bytes) {
  return bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[3] << 24U);
}

static void put_word(uint8_t *bytes, uint32_t value) {
  for (uint32_t i = 0U; i < 4U; i++) {
    bytes[i] = (uint8_t)(value >> (8U * i));
  }
}

static uint32_t length_of(uint8_t count) { return ((uint32_t)count + 1U) * CRUX_FLASH_UNIT; }

/// The snapshot at an address; false when there is no whole one.
static bool read_snapshot(const crux_flash *flash, uint32_t address, uint32_t room, uint8_t snapshot[LONGEST]) {
  bool whole = (room >= CRUX_FLASH_UNIT) && flash->read(flash->context, address, snapshot, CRUX_FLASH_UNIT);
  if (whole && (snapshot[2] == MARK) && (snapshot[3] <= CRUX_STORE_CAPACITY)) {
    const uint32_t length = length_of(snapshot[3]);
    struct crux_e2e_receiver receiver = {0};
    whole = (length <= room) && flash->read(flash->context, address, snapshot, length) &&
            crux_e2e_is_usable(crux_e2e_check(CRC_IDENTITY, snapshot, length, &receiver));
  } else {
    whole = false;
  }
  return whole;
}

typedef struct newest {
  bool found;
  uint8_t page;
  uint32_t sequence;
  uint32_t address;
  uint32_t end;  ///< where the next one of its page would begin
} newest;

static newest find_newest(const crux_store *store) {
  newest result = {0};
  uint8_t snapshot[LONGEST];
  for (uint8_t page = 0U; page < store->count; page++) {
    uint32_t offset = 0U;
    while (read_snapshot(store->flash, store->pages[page] + offset, CRUX_FLASH_PAGE - offset, snapshot)) {
      const uint32_t sequence = word(&snapshot[4]);
      const uint32_t address = store->pages[page] + offset;
      offset += length_of(snapshot[3]);
      if (!result.found || (sequence > result.sequence)) {
        result = (newest){true, page, sequence, address, store->pages[page] + offset};
      }
    }
  }
  return result;
}

uint8_t crux_store_load(const crux_store *store, crux_stored entries[CRUX_STORE_CAPACITY]) {
  const newest found = find_newest(store);
  uint8_t snapshot[LONGEST];
  uint8_t count = 0U;
  if (found.found && read_snapshot(store->flash, found.address, LONGEST, snapshot)) {
    for (; count < snapshot[3]; count++) {
      const uint8_t *entry = &snapshot[length_of(count)];
      entries[count] = (crux_stored){.id = entry[0], .bits = word(&entry[4])};
    }
  }
  return count;
}

/// Whether so many bytes can be written there: in the page, and erased.
static bool is_free(const crux_flash *flash, uint32_t address, uint32_t length, uint32_t page_end) {
  bool clean = (address + length) <= page_end;
  for (uint32_t at = address; clean && (at < page_end); at += CRUX_FLASH_UNIT) {
    clean = crux_flash_is_erased(flash, at);
  }
  return clean;
}

bool crux_store_save(const crux_store *store, const crux_stored *entries, uint8_t count) {
  const newest before = find_newest(store);
  const uint32_t length = length_of(count);
  uint32_t address = before.end;
  uint8_t snapshot[LONGEST] = {0};
  bool good = count <= CRUX_STORE_CAPACITY;
  const bool is_own = before.found && (before.page < 2U);
  if (good && (!is_own || !is_free(store->flash, before.end, length, store->pages[before.page] + CRUX_FLASH_PAGE))) {
    address = store->pages[is_own ? (1U - before.page) : 0U];
    good = store->flash->erase(store->flash->context, address);
  }
  if (good) {
    snapshot[3] = count;
    put_word(&snapshot[4], before.found ? (before.sequence + 1U) : 1U);
    for (uint8_t i = 0U; i < count; i++) {
      snapshot[length_of(i)] = entries[i].id;
      put_word(&snapshot[length_of(i) + 4U], entries[i].bits);
    }
    crux_e2e_protect(CRC_IDENTITY, MARK, snapshot, length);
  }
  for (uint32_t offset = 0U; good && (offset < length); offset += CRUX_FLASH_UNIT) {
    good = store->flash->write(store->flash->context, address + offset, &snapshot[offset]);
  }
  return good;
}
