#include "flash_port.h"

#include <stddef.h>
#include <string.h>

#include "calibration.h"
#include "registers.h"

#define FLASH_START 0x08000000UL
#define BANK_PAGES 128UL
#define CALIBRATION (CALIBRATION_ADDRESS - FLASH_START)
#define STORE (CALIBRATION - (2UL * CRUX_FLASH_PAGE))
_Static_assert((CALIBRATION % CRUX_FLASH_PAGE) == 0U, "the calibration begins a page");

static volatile bool reading;
static volatile bool unreadable;

bool flash_port_on_nmi(void) {
  const bool ours = reading && ((FLASH_ECCR & FLASH_ECCR_ECCD) != 0U);
  if (ours) {
    FLASH_ECCR = FLASH_ECCR_ECCD;
    unreadable = true;
  }
  return ours;
}

static bool read(void *context, uint32_t address, uint8_t *bytes, uint32_t length) {
  (void)context;
  const volatile uint8_t *from = (const volatile uint8_t *)(FLASH_START + address);
  unreadable = false;
  reading = true;
  for (uint32_t i = 0U; i < length; i++) {
    bytes[i] = from[i];
  }
  __asm volatile("dsb" ::: "memory");
  reading = false;
  return !unreadable;
}

/// Nothing but the store's pages may change; and pages have other numbers in single-bank mode.
static bool may_change(uint32_t address) {
  return (address >= STORE) && (address < CALIBRATION) && ((FLASH_OPTR & FLASH_OPTR_DBANK) != 0U);
}

static void begin(uint32_t operation) {
  while ((FLASH_SR & FLASH_SR_BSY) != 0U) {
  }
  FLASH_KEYR = FLASH_KEY_1;
  FLASH_KEYR = FLASH_KEY_2;
  FLASH_SR = FLASH_SR_ERRORS;  // cleared by ones
  FLASH_CR = operation;
}

/// Waits for the end and locks the flash; true when it went well.
static bool end(void) {
  while ((FLASH_SR & FLASH_SR_BSY) != 0U) {
  }
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
const crux_store flash_port_store = {.flash = &flash, .pages = {STORE, STORE + CRUX_FLASH_PAGE}};
