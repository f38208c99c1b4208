#include "cortex_m4.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cortex_internal.h"

#define CHIP_START 0x40000000U
#define CHIP_BYTES 0x20000000U
#define CONTROL_START 0xE000E000U
#define CONTROL_BYTES 0x1000U

#define TRANSLATION_BYTES (8U << 20U)
#define RUBBISH 0xA5

// Thumb.
#define FIRST_OF_TWO_HALVES 0xE800U
#define INSTRUCTION_ENABLE_INTERRUPTS 0xB662U

static uint16_t half_word(const cortex_m4 *core, uint32_t offset) {
  uint16_t value;
  (void)memcpy(&value, core->flash + offset, sizeof(value));
  return value;
}

void cortex_complain(cortex_m4 *core, const char *what, uint32_t address) {
  if (core->fault[0] == '\0') {
    (void)snprintf(core->fault, sizeof(core->fault), "%s 0x%08X, near instruction 0x%08X", what, address,
                   cortex_get(core, UC_ARM_REG_PC));
  }
}

void cortex_wake_at(cortex_m4 *core, uint64_t time) {
  core->chip_at = time;
  if (time < core->stop_at) {
    core->stop_at = time;
  }
}

// --- the chip ---

static uint64_t read_chip(uc_engine *engine, uint64_t offset, unsigned size, void *context) {
  cortex_m4 *core = context;
  uint32_t value = 0U;
  (void)engine;
  core->executed.most_cycles += CORTEX_PERIPHERAL_WAITS;
  if (!core->chip.read(core->chip.context, (uint32_t)offset & ~3U, &value)) {
    cortex_complain(core, "nothing to read at", CHIP_START + (uint32_t)offset);
  }
  value >>= 8U * (offset & 3U);
  return (size == 4U) ? value : (value & ((1U << (8U * size)) - 1U));
}

static void write_chip(uc_engine *engine, uint64_t offset, unsigned size, uint64_t value, void *context) {
  cortex_m4 *core = context;
  (void)engine;
  core->executed.most_cycles += CORTEX_PERIPHERAL_WAITS;
  (void)size;  // registers written in part are written whole, the rest zero: true of every one that is used so
  if (!core->chip.write(core->chip.context, (uint32_t)offset & ~3U, (uint32_t)value << (8U * (offset & 3U)))) {
    cortex_complain(core, "nothing to write at", CHIP_START + (uint32_t)offset);
  }
}

/// The flash is mapped read-only: the engine asks here what to do with a write, and the chip does it.
static bool program_flash(uc_engine *engine, uc_mem_type type, uint64_t address, int size, int64_t value,
                          void *context) {
  cortex_m4 *core = context;
  (void)engine;
  (void)type;
  return core->chip.program(core->chip.context, (uint32_t)address - FLASH_START, (uint32_t)size, (uint32_t)value);
}

static void stop_now(cortex_m4 *core) {
  core->stopped = true;
  core->stop_at = 0U;
  (void)uc_emu_stop(core->engine);
}

/// The interrupt comes at once. The engine executes the reading instruction again afterwards, and is let pass then.
static void on_flash_read(uc_engine *engine, uc_mem_type type, uint64_t address, int size, int64_t value,
                          void *context) {
  cortex_m4 *core = context;
  (void)engine;
  (void)type;
  (void)value;
  if (core->flash_excused == (uint32_t)address) {
    core->flash_excused = 0U;
  } else if (!core->chip.reads(core->chip.context, (uint32_t)address - FLASH_START, (uint32_t)size)) {
    core->flash_excused = (uint32_t)address;
    core->nmi_pending = true;
    stop_now(core);
  } else {
    // read
  }
}

void cortex_watch_flash(cortex_m4 *core, bool on) {
  const union {
    void (*function)(uc_engine *, uc_mem_type, uint64_t, int, int64_t, void *);
    void *object;
  } pointer = {.function = on_flash_read};
  if (on && !core->flash_watched) {
    (void)uc_hook_add(core->engine, &core->flash_hook, UC_HOOK_MEM_READ, pointer.object, core, FLASH_START,
                      FLASH_START + CORTEX_FLASH_BYTES - 1U);
  } else if (!on && core->flash_watched) {
    (void)uc_hook_del(core->engine, core->flash_hook);
  } else {
    // as it is
  }
  core->flash_watched = on;
}

void cortex_power_off(cortex_m4 *core) {
  core->dead = true;
  stop_now(core);
}

// --- execution ---

static uint16_t count_instructions(const cortex_m4 *core, uint32_t offset, uint32_t bytes) {
  uint16_t count = 0U;
  for (uint32_t i = 0U; i < bytes; count++) {
    i += (half_word(core, offset + i) >= FIRST_OF_TWO_HALVES) ? 4U : 2U;
  }
  return count;
}

/// Before every basic block. A stop asked for here takes effect after the block.
static void on_block(uc_engine *engine, uint64_t address, uint32_t bytes, void *context) {
  cortex_m4 *core = context;
  const uint32_t offset = (uint32_t)address - FLASH_START;
  if (offset >= CORTEX_FLASH_BYTES) {
    return;  // a return address: ends the run
  }
  cortex_block *block = &core->blocks[offset / 2U];
  if (block->bytes != bytes) {
    block->bytes = (uint16_t)bytes;
    block->instructions = count_instructions(core, offset, bytes);
  }
  core->executed.instructions += block->instructions;
  if (core->measures) {
    cortex_account(&core->fetch, &core->executed, core->flash, offset, bytes);
  }
  core->now += block->instructions;
  if ((core->now >= core->stop_at) || (core->masked_request && ((cortex_get(core, UC_ARM_REG_PRIMASK) & 1U) == 0U))) {
    core->stopped = true;
    (void)uc_emu_stop(engine);
  }
}

/// Takes the interrupt that is due and not masked. A core that was woken with interrupts masked and whose next
/// instruction enables them executes that one here, which spares a start of the engine.
static void take_interrupt(cortex_m4 *core) {
  const uint32_t exception = cortex_requested(core);
  core->masked_request = false;
  if (exception == 0U) {
    return;
  }
  core->asleep = false;
  if (exception == CORTEX_NMI) {
    cortex_enter(core, exception);
    return;
  }
  if ((cortex_get(core, UC_ARM_REG_PRIMASK) & 1U) != 0U) {
    const uint32_t pc = cortex_get(core, UC_ARM_REG_PC);
    const uint32_t offset = pc - FLASH_START;
    if ((offset >= CORTEX_FLASH_BYTES) || (half_word(core, offset) != INSTRUCTION_ENABLE_INTERRUPTS)) {
      core->masked_request = true;
      return;
    }
    cortex_set(core, UC_ARM_REG_PRIMASK, 0U);
    cortex_set(core, UC_ARM_REG_PC, (pc + 2U) | 1U);
    core->executed.instructions++;
    core->now++;
  }
  const uint32_t base_priority = cortex_get(core, UC_ARM_REG_BASEPRI) & 0xF0U;
  if ((base_priority == 0U) || (core->priority[exception] < base_priority)) {
    cortex_enter(core, exception);
  }
}

static void execute(cortex_m4 *core) {
  core->stopped = false;
  const uc_err error = uc_emu_start(core->engine, cortex_get(core, UC_ARM_REG_PC) | 1U, 0U, 0U, 0U);
  const uint32_t pc = cortex_get(core, UC_ARM_REG_PC);
  if ((core->depth > 0U) && ((pc & CORTEX_RETURN_MASK) == CORTEX_RETURN_MASK)) {
    cortex_leave(core);
  } else if (error != UC_ERR_OK) {
    cortex_complain(core, uc_strerror(error), pc);
    if (cortex_is_active(core, CORTEX_HARD_FAULT)) {
      core->dead = true;
    } else {
      cortex_enter(core, CORTEX_HARD_FAULT);
    }
  } else if (!core->stopped) {
    core->asleep = true;
    cortex_charge(&core->cost[0],
                  cortex_count_minus(cortex_count_minus(core->executed, core->awake_since), core->handled));
  } else {
    // something is due
  }
}

static void keep_time(cortex_m4 *core) {
  if (core->now >= core->systick_at) {
    core->systick_pending = core->systick_pending || ((core->control_space[SYST_CSR / 4U] & 2U) != 0U);
    core->systick_at += core->control_space[SYST_RVR / 4U] + 1U;
  }
  if (core->now >= core->chip_at) {
    core->chip_at = CORTEX_NEVER;
    core->chip.on_time(core->chip.context);
  }
}

void cortex_run_until(cortex_m4 *core, uint64_t time) {
  while (core->now < time) {
    keep_time(core);
    if (core->wants_reset) {
      core->chip.restart(core->chip.context);
    }
    const bool slept = core->asleep;
    take_interrupt(core);
    uint64_t next = (core->systick_at < core->chip_at) ? core->systick_at : core->chip_at;
    next = (next < time) ? next : time;
    if (core->asleep || core->dead) {
      core->now = (next > core->now) ? next : core->now;
      continue;
    }
    if (slept) {
      core->awake_since = core->executed;
      core->handled = (cortex_count){0};
    }
    core->stop_at = next;
    execute(core);
  }
}

// --- life ---

bool cortex_open(cortex_m4 *core, const cortex_chip *chip) {
  uc_hook hook;
  // C knows no conversion from a function's pointer to the one the engine takes.
  const union {
    void (*function)(uc_engine *, uint64_t, uint32_t, void *);
    void *object;
  } on_block_pointer = {.function = on_block};
  const union {
    bool (*function)(uc_engine *, uc_mem_type, uint64_t, int, int64_t, void *);
    void *object;
  } program_flash_pointer = {.function = program_flash};
  *core = (cortex_m4){.chip = *chip, .chip_at = CORTEX_NEVER, .systick_at = CORTEX_NEVER, .dead = true};
  core->flash = aligned_alloc(4096U, CORTEX_FLASH_BYTES);
  core->ram = aligned_alloc(4096U, CORTEX_RAM_BYTES);
  core->blocks = calloc(CORTEX_FLASH_BYTES / 2U, sizeof(*core->blocks));
  if ((core->flash == NULL) || (core->ram == NULL) || (core->blocks == NULL)) {
    (void)snprintf(core->fault, sizeof(core->fault), "out of memory");
    cortex_close(core);
    return false;
  }
  (void)memset(core->flash, 0xFF, CORTEX_FLASH_BYTES);
  uc_err error = uc_open(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS, &core->engine);
  // Without a bound each engine takes a gigabyte.
  error = (error != UC_ERR_OK) ? error : uc_ctl_set_tcg_buffer_size(core->engine, TRANSLATION_BYTES);
  error = (error != UC_ERR_OK) ? error : uc_ctl_set_cpu_model(core->engine, UC_CPU_ARM_CORTEX_M4);
  error = (error != UC_ERR_OK)
              ? error
              : uc_mem_map_ptr(core->engine, FLASH_START, CORTEX_FLASH_BYTES, UC_PROT_READ | UC_PROT_EXEC, core->flash);
  error = (error != UC_ERR_OK) ? error
                               : uc_mem_map_ptr(core->engine, CORTEX_RAM_START, CORTEX_RAM_BYTES,
                                                UC_PROT_READ | UC_PROT_WRITE, core->ram);
  error = (error != UC_ERR_OK) ? error
                               : uc_mmio_map(core->engine, CHIP_START, CHIP_BYTES, read_chip, core, write_chip, core);
  error = (error != UC_ERR_OK) ? error
                               : uc_mmio_map(core->engine, CONTROL_START, CONTROL_BYTES, cortex_read_control, core,
                                             cortex_write_control, core);
  error = (error != UC_ERR_OK) ? error
                               : uc_hook_add(core->engine, &hook, UC_HOOK_BLOCK, on_block_pointer.object, core, 1, 0);
  error = (error != UC_ERR_OK) ? error
                               : uc_hook_add(core->engine, &hook, UC_HOOK_MEM_WRITE_PROT, program_flash_pointer.object,
                                             core, FLASH_START, FLASH_START + CORTEX_FLASH_BYTES - 1U);
  if (error != UC_ERR_OK) {
    (void)snprintf(core->fault, sizeof(core->fault), "unicorn: %s", uc_strerror(error));
    cortex_close(core);
    return false;
  }
  return true;
}

void cortex_close(cortex_m4 *core) {
  if (core->engine != NULL) {
    (void)uc_close(core->engine);
  }
  free(core->flash);
  free(core->ram);
  free(core->blocks);
  core->engine = NULL;
  core->flash = NULL;
  core->ram = NULL;
  core->blocks = NULL;
}

void cortex_power_on(cortex_m4 *core) {
  static const int cleared[] = {UC_ARM_REG_R0,      UC_ARM_REG_R1,     UC_ARM_REG_R2,  UC_ARM_REG_R3, UC_ARM_REG_R4,
                                UC_ARM_REG_R5,      UC_ARM_REG_R6,     UC_ARM_REG_R7,  UC_ARM_REG_R8, UC_ARM_REG_R9,
                                UC_ARM_REG_R10,     UC_ARM_REG_R11,    UC_ARM_REG_R12, UC_ARM_REG_LR, UC_ARM_REG_FPSCR,
                                UC_ARM_REG_PRIMASK, UC_ARM_REG_BASEPRI};
  for (size_t i = 0U; i < sizeof(cleared) / sizeof(cleared[0]); i++) {
    cortex_set(core, cleared[i], 0U);
  }
  (void)memset(core->ram, RUBBISH, CORTEX_RAM_BYTES);
  (void)memset(core->control_space, 0, sizeof(core->control_space));
  // The program may be another one now.
  (void)uc_ctl_flush_tb(core->engine);
  (void)memset(core->blocks, 0, (CORTEX_FLASH_BYTES / 2U) * sizeof(*core->blocks));
  (void)memset(core->line, 0, sizeof(core->line));
  (void)memset(core->enabled, 0, sizeof(core->enabled));
  (void)memset(core->pended, 0, sizeof(core->pended));
  (void)memset(core->priority, 0, sizeof(core->priority));
  core->systick_at = CORTEX_NEVER;
  core->depth = 0U;
  core->nmi_pending = false;
  core->flash_excused = 0U;
  core->systick_pending = false;
  core->masked_request = false;
  core->asleep = false;
  core->wants_reset = false;
  core->dead = false;
  core->awake_since = core->executed;
  core->handled = (cortex_count){0};
  cortex_set(core, UC_ARM_REG_XPSR, CORTEX_PSR_THUMB);
  cortex_set(core, UC_ARM_REG_SP, cortex_vector(core, 0U));
  cortex_set(core, UC_ARM_REG_PC, cortex_vector(core, 1U) | 1U);
}
