#include "flash_port.h"

#include <stddef.h>
#include <string.h>

#include "flash_layout.h"
#include "registers.h"

#define BANK_PAGES 128UL
#define STORE_BYTES (2UL * CRUX_FLASH_PAGE)
_Static_assert((FLASH_STORE_0 + STORE_BYTES) <= FLASH_KEY, "the first store would lie in the key");
_Static_assert((FLASH_STORE_1 + STORE_BYTES) <= FLASH_CALIBRATION, "the second store would lie in the calibration");
_Static_assert((FLASH_SLOT_1 + FLASH_SLOT_BYTES) <= FLASH_STORE_1, "the second slot would lie in the store");
_Static_assert((FLASH_SLOT_0 + FLASH_SLOT_BYTES) <= FLASH_SLOT_1, "the slots would overlap");

/// Of the program that runs, by its linker script.
extern uint32_t program_start;

static volatile bool reading;
static volatile bool unreadable;
static void (*while_busy)(void);

bool flash_port_on_nmi(void) {
  const bool ours = reading && ((FLASH_ECCR & FLASH_ECCR_ECCD) != 0U);
  if (ours) {
    FLASH_ECCR = FLASH_ECCR_ECCD;
    unreadable = true;
  }
  return ours;
}

/// By words where they are aligned: the boot stage reads a whole image.
static bool read(void *context, uint32_t address, uint8_t *bytes, uint32_t length) {
  (void)context;
  const uint32_t whole = ((address % 4U) == 0U) ? (length - (length % 4U)) : 0U;
  const volatile uint32_t *words = (const volatile uint32_t *)(FLASH_START + address);
  const volatile uint8_t *from = (const volatile uint8_t *)(FLASH_START + address);
  unreadable = false;
  reading = true;
  for (uint32_t i = 0U; i < whole; i += 4U) {
    const uint32_t word = words[i / 4U];
    (void)memcpy(&bytes[i], &word, sizeof(word));
  }
  for (uint32_t i = whole; i < length; i++) {
    bytes[i] = from[i];
  }
  __asm volatile("dsb" ::: "memory");
  reading = false;
  return !unreadable;
}

static bool lies_in(uint32_t address, uint32_t start, uint32_t bytes) { return (address - start) < bytes; }

uint8_t flash_port_running_slot(void) {
  const uint32_t start = (uint32_t)(uintptr_t)&program_start - FLASH_START;
  uint8_t slot = CRUX_NO_SLOT;
  if (start >= FLASH_SLOT_1) {
    slot = 1U;
  } else if (start >= FLASH_SLOT_0) {
    slot = 0U;
  } else {
    // below both
  }
  return slot;
}

/// The store in the bank that the program does not run from, the marks of the slots, and of a slot's program the other
/// slot. A program that is linked for the flash's start may reach into the first slot: it changes the store alone.
/// Pages have other numbers in single-bank mode.
static bool may_change(uint32_t address) {
  const uint8_t running = flash_port_running_slot();
  const uint32_t slots[CRUX_SLOTS] = {FLASH_SLOT_0, FLASH_SLOT_1};
  bool may = lies_in(address, (running == 1U) ? FLASH_STORE_0 : FLASH_STORE_1, STORE_BYTES);
  for (uint8_t slot = 0U; slot < CRUX_SLOTS; slot++) {
    const bool is_mark = lies_in(address, slots[slot] + FLASH_SLOT_BYTES - CRUX_FLASH_PAGE, CRUX_FLASH_PAGE);
    may = may || is_mark ||
          ((running < CRUX_SLOTS) && (slot != running) && lies_in(address, slots[slot], FLASH_SLOT_BYTES));
  }
  return may && ((FLASH_OPTR & FLASH_OPTR_DBANK) != 0U);
}

void flash_port_while_busy(void (*function)(void)) { while_busy = function; }

static void wait_until_idle(void) {
  while ((FLASH_SR & FLASH_SR_BSY) != 0U) {
    if (while_busy != NULL) {
      while_busy();
    }
  }
}

static void begin(uint32_t operation) {
  wait_until_idle();
  FLASH_KEYR = FLASH_KEY_1;
  FLASH_KEYR = FLASH_KEY_2;
  FLASH_SR = FLASH_SR_ERRORS;  // cleared by ones
  FLASH_CR = operation;
}

/// Waits for the end and locks the flash; true when it went well.
static bool end(void) {
  wait_until_idle();
  const bool good = (FLASH_SR & FLASH_SR_ERRORS) == 0U;
  FLASH_CR = FLASH_CR_LOCK;
  FLASH_ACR &= ~FLASH_ACR_DCACHE;  // it may hold what was there before
  FLASH_ACR |= FLASH_ACR_DCRST;
  FLASH_ACR &= ~FLASH_ACR_DCRST;
  FLASH_ACR |= FLASH_ACR_DCACHE;
  return good;
}

static bool write(void *context, uint32_t address, const uint8_t unit[CRUX_FLASH_UNIT]) {
  bool good = may_change(address) && ((address % CRUX_FLASH_UNIT) == 0U);
  if (good) {
    uint32_t words[2];
    uint8_t written[CRUX_FLASH_UNIT];
    volatile uint32_t *to = (volatile uint32_t *)(FLASH_START + address);
    (void)memcpy(words, unit, sizeof(words));
    begin(FLASH_CR_PG);
    to[0] = words[0];
    to[1] = words[1];
    __asm volatile("dsb" ::: "memory");
    good = end() && read(context, address, written, CRUX_FLASH_UNIT) && (memcmp(written, unit, CRUX_FLASH_UNIT) == 0);
  }
  return good;
}

static bool erase(void *context, uint32_t address) {
  (void)context;
  bool good = may_change(address) && ((address % CRUX_FLASH_PAGE) == 0U);
  if (good) {
    const uint32_t page = address / CRUX_FLASH_PAGE;
    const uint32_t bank = (page < BANK_PAGES) ? 0UL : FLASH_CR_BKER;
    begin(FLASH_CR_PER | bank | FLASH_CR_PNB(page % BANK_PAGES));
    FLASH_CR |= FLASH_CR_STRT;
    good = end();
  }
  return good;
}

static const crux_flash flash = {.context = NULL, .read = read, .write = write, .erase = erase};
static const crux_store store_of_slot_0 = {
    .flash = &flash,
    .count = 4U,
    .pages = {FLASH_STORE_1, FLASH_STORE_1 + CRUX_FLASH_PAGE, FLASH_STORE_0, FLASH_STORE_0 + CRUX_FLASH_PAGE}};
static const crux_store store_of_slot_1 = {
    .flash = &flash,
    .count = 4U,
    .pages = {FLASH_STORE_0, FLASH_STORE_0 + CRUX_FLASH_PAGE, FLASH_STORE_1, FLASH_STORE_1 + CRUX_FLASH_PAGE}};
/// Of a program that lies where the other one would be.
static const crux_store store_alone = {
    .flash = &flash, .count = 2U, .pages = {FLASH_STORE_1, FLASH_STORE_1 + CRUX_FLASH_PAGE}};

const crux_store *flash_port_store(void) {
  const uint8_t slot = flash_port_running_slot();
  const crux_store *store = &store_alone;
  if (slot == 0U) {
    store = &store_of_slot_0;
  } else if (slot == 1U) {
    store = &store_of_slot_1;
  } else {
    // without a boot stage
  }
  return store;
}

void flash_port_slots(crux_slots *slots, uint32_t kind) {
  const uint8_t *key = (const uint8_t *)(FLASH_START + FLASH_KEY);
  *slots = (crux_slots){.flash = &flash,
                        .address = {FLASH_SLOT_0, FLASH_SLOT_1},
                        .size = FLASH_SLOT_BYTES,
                        .origin = FLASH_START,
                        .kind = kind,
                        .key = crux_flash_is_erased(&flash, FLASH_KEY) ? NULL : key};
}
