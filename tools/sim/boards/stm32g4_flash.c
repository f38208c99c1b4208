/// The flash's controller, in dual-bank mode: unlock, program a double word, erase a page. What the image does wrong is
/// an error in its status register, as on the chip, and a complaint. The memory itself, and a power that fails within
/// an operation, is that of flash_model.h; what was left unreadable says so when it is read.
#include <string.h>

#include "stm32g4_internal.h"

#define BANK_PAGES 128U

// Times of the data sheet, in core cycles at 170 MHz.
#define PROGRAM_CYCLES 13900U
#define ERASE_CYCLES 3740000U

enum { KEYR = 0x08 / 4, SR = 0x10 / 4, CR = 0x14 / 4, ECCR = 0x18 / 4, OPTR = 0x20 / 4 };

#define KEY_1 0x45670123U
#define KEY_2 0xCDEF89ABU
#define SR_PROGERR (1U << 3U)
#define SR_WRPERR (1U << 4U)
#define SR_PGSERR (1U << 7U)
#define SR_BSY (1U << 16U)
#define CR_PG (1U << 0U)
#define CR_PER (1U << 1U)
#define CR_BKER (1U << 11U)
#define CR_STRT (1U << 16U)
#define CR_LOCKS ((1U << 31U) | (1U << 30U))
#define CR_LOCK (1U << 31U)
#define ECCR_ECCD (1U << 31U)
#define OPTR_DBANK (1U << 22U)

void stm32g4_reset_flash(stm32g4 *chip) {
  (void)memset(chip->flash_control, 0, sizeof(chip->flash_control));
  chip->flash_control[CR] = CR_LOCKS;
  chip->flash_control[OPTR] = OPTR_DBANK;
  chip->flash_busy_until = 0U;
  chip->flash_half_written = false;
}

static void refuse(stm32g4 *chip, uint32_t error, const char *what, uint32_t address) {
  chip->flash_control[SR] |= error;
  cortex_complain(&chip->core, what, address);
}

/// Ends an operation of the memory: it takes time, or the power has failed in it.
static void finish(stm32g4 *chip, const flash_operation *operation, uint64_t cycles) {
  flash_record_add(&chip->record, operation);
  chip->flash_busy_until = chip->core.now + cycles;
  if (chip->flash.off) {
    stm32g4_power_off(chip);
  }
}

static void program(stm32g4 *chip, uint32_t second) {
  flash_operation operation = {.address = chip->flash_unit};
  (void)memcpy(operation.unit, &chip->flash_first, sizeof(second));
  (void)memcpy(&operation.unit[4], &second, sizeof(second));
  (void)chip->flash_access.write(&chip->flash, operation.address, operation.unit);
  finish(chip, &operation, PROGRAM_CYCLES);
}

bool stm32g4_reads_flash(stm32g4 *chip, uint32_t offset, uint32_t size) {
  bool readable = true;
  for (uint32_t i = offset / CRUX_FLASH_UNIT; i <= (offset + size - 1U) / CRUX_FLASH_UNIT; i++) {
    readable = readable && !chip->flash_damaged[i];
  }
  chip->flash_control[ECCR] |= readable ? 0U : ECCR_ECCD;
  return readable;
}

bool stm32g4_program_flash(stm32g4 *chip, uint32_t offset, uint32_t size, uint32_t value) {
  const bool second = (offset % CRUX_FLASH_UNIT) != 0U;
  const uint32_t unit = offset - (offset % CRUX_FLASH_UNIT);
  bool done = false;
  if (((chip->flash_control[CR] & CR_PG) == 0U) || (chip->core.now < chip->flash_busy_until)) {
    refuse(chip, SR_PGSERR, "programs flash that is locked or busy at", offset);
  } else if ((size != 4U) || (offset % 4U != 0U) || (second != chip->flash_half_written) ||
             (second && (unit != chip->flash_unit))) {
    refuse(chip, SR_PGSERR, "programs no whole double word of flash at", offset);
  } else if (!second && !crux_flash_is_erased(&chip->flash_access, unit)) {
    refuse(chip, SR_PROGERR, "programs flash that is not erased at", offset);
  } else {
    chip->flash_half_written = !second;
    chip->flash_unit = unit;
    if (second) {
      program(chip, value);
    } else {
      chip->flash_first = value;
    }
    done = true;
  }
  return done;
}

static void erase(stm32g4 *chip, uint32_t control) {
  const uint32_t page = ((control >> 3U) & (BANK_PAGES - 1U)) + (((control & CR_BKER) != 0U) ? BANK_PAGES : 0U);
  const flash_operation operation = {.address = page * CRUX_FLASH_PAGE, .erases = true};
  (void)chip->flash_access.erase(&chip->flash, operation.address);
  finish(chip, &operation, ERASE_CYCLES);
}

uint32_t stm32g4_read_flash(const stm32g4 *chip, uint32_t word) {
  const bool busy = (word == SR) && (chip->core.now < chip->flash_busy_until);
  return chip->flash_control[word] | (busy ? SR_BSY : 0U);
}

void stm32g4_write_flash(stm32g4 *chip, uint32_t word, uint32_t value) {
  uint32_t *registers = chip->flash_control;
  if (word == KEYR) {
    if ((registers[KEYR] == KEY_1) && (value == KEY_2)) {
      registers[CR] &= ~CR_LOCK;
    }
    registers[KEYR] = value;
  } else if (word == SR) {
    registers[SR] &= ~value;
  } else if (word == CR) {
    if ((registers[CR] & CR_LOCK) != 0U) {
      refuse(chip, SR_WRPERR, "writes to the locked control register of the flash,", value);
    } else {
      registers[CR] = value & ~CR_STRT;
      if ((value & (CR_STRT | CR_PER)) == (CR_STRT | CR_PER)) {
        erase(chip, value);
      }
    }
  } else if (word == ECCR) {
    registers[ECCR] &= ~(value & ECCR_ECCD);
  } else if (word != OPTR) {
    registers[word] = value;
  } else {
    // options stay
  }
}
