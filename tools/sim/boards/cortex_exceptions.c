/// Exceptions: which one is due, the way into its handler and back.
#include <string.h>

#include "cortex_internal.h"

#define EXCEPTION_CYCLES 12U
#define MAX_NESTING 8U

// Exception returns with a floating-point frame: to a handler, to the main loop.
#define RETURN_TO_HANDLER 0xFFFFFFE1U
#define RETURN_TO_THREAD 0xFFFFFFE9U

#define FRAME_WORDS 26U  // r0-r3 r12 lr pc xpsr, s0-s15 fpscr and one to align
#define PSR_ALIGNED (1U << 9U)
#define PSR_KEPT 0xFF0FFC00U  // all but the exception number
#define PSR_IN_IT_BLOCK 0x0600FC00U

static unsigned priority_of_active(const cortex_m4 *core) {
  unsigned highest = 256U;
  for (unsigned i = 0U; i < core->depth; i++) {
    const uint32_t exception = core->active[i].exception;
    const unsigned priority = (exception <= CORTEX_HARD_FAULT) ? 0U : core->priority[exception];
    highest = (priority < highest) ? priority : highest;
  }
  return highest;
}

bool cortex_is_active(const cortex_m4 *core, uint32_t exception) {
  bool found = false;
  for (unsigned i = 0U; i < core->depth; i++) {
    found = found || (core->active[i].exception == exception);
  }
  return found;
}

uint32_t cortex_requested(const cortex_m4 *core) {
  uint32_t best = 0U;
  if (core->nmi_pending && !cortex_is_active(core, CORTEX_NMI) && !cortex_is_active(core, CORTEX_HARD_FAULT)) {
    return CORTEX_NMI;
  }
  unsigned best_priority = priority_of_active(core);
  if (core->systick_pending && (core->priority[CORTEX_SYSTICK] < best_priority)) {
    best = CORTEX_SYSTICK;
    best_priority = core->priority[CORTEX_SYSTICK];
  }
  for (unsigned word = 0U; word < 4U; word++) {
    uint32_t left = (core->line[word] | core->pended[word]) & core->enabled[word];
    while (left != 0U) {
      const unsigned exception = 16U + (32U * word) + (unsigned)__builtin_ctz(left);
      if ((core->priority[exception] < best_priority) && !cortex_is_active(core, exception)) {
        best = exception;
        best_priority = core->priority[exception];
      }
      left &= left - 1U;
    }
  }
  return best;
}

void cortex_request(cortex_m4 *core, unsigned interrupt, bool on) {
  const uint32_t bit = 1U << (interrupt % 32U);
  uint32_t *line = &core->line[interrupt / 32U];
  if (on && ((*line & bit) == 0U)) {
    core->stop_at = 0U;  // a running block ends first
  }
  *line = on ? (*line | bit) : (*line & ~bit);
}

// Not const because the engine's interface is not.
static int frame_registers[8] = {UC_ARM_REG_R0,  UC_ARM_REG_R1, UC_ARM_REG_R2, UC_ARM_REG_R3,
                                 UC_ARM_REG_R12, UC_ARM_REG_LR, UC_ARM_REG_PC, UC_ARM_REG_XPSR};
static int float_registers[9] = {UC_ARM_REG_D0, UC_ARM_REG_D1, UC_ARM_REG_D2, UC_ARM_REG_D3,   UC_ARM_REG_D4,
                                 UC_ARM_REG_D5, UC_ARM_REG_D6, UC_ARM_REG_D7, UC_ARM_REG_FPSCR};

static bool in_ram(uint32_t address, uint32_t bytes) {
  return (address >= CORTEX_RAM_START) && (address - CORTEX_RAM_START <= CORTEX_RAM_BYTES - bytes);
}

uint32_t cortex_vector(const cortex_m4 *core, uint32_t exception) {
  uint32_t value;
  // After a reset the table is looked for at address 0, where the flash shows, too.
  const uint32_t table = core->control_space[SCB_VTOR / 4U] % FLASH_START;
  const uint32_t at = (table + (4U * exception)) % CORTEX_FLASH_BYTES;
  (void)memcpy(&value, core->flash + at, sizeof(value));
  return value;
}

void cortex_enter(cortex_m4 *core, uint32_t exception) {
  uint32_t frame[8];
  void *frame_values[8];
  cortex_active *active = &core->active[core->depth];
  void *float_values[9];
  const uint32_t stack = cortex_get(core, UC_ARM_REG_SP);
  const uint32_t aligned = stack & ~7U;
  const uint32_t top = aligned - (4U * FRAME_WORDS);
  for (int i = 0; i < 8; i++) {
    frame_values[i] = &frame[i];
  }
  for (int i = 0; i < 9; i++) {
    active->float_registers[i] = 0U;
    float_values[i] = &active->float_registers[i];
  }
  (void)uc_reg_read_batch(core->engine, frame_registers, frame_values, 8);
  (void)uc_reg_read_batch(core->engine, float_registers, float_values, 9);
  if (!in_ram(top, 4U * FRAME_WORDS) || (core->depth >= MAX_NESTING)) {
    cortex_complain(core, "stack pointer out of the RAM:", stack);
    core->dead = true;
    return;
  }
  frame[7] = (frame[7] & PSR_KEPT) | ((aligned != stack) ? PSR_ALIGNED : 0U);
  (void)memcpy(core->ram + (top - CORTEX_RAM_START), frame, sizeof(frame));
  (void)memcpy(core->ram + (top - CORTEX_RAM_START) + sizeof(frame), active->float_registers, 68U);
  if (core->depth > 0U) {
    cortex_active *below = &core->active[core->depth - 1U];
    below->spent = cortex_count_plus(below->spent, cortex_count_minus(core->executed, below->since));
  }
  if ((frame[7] & PSR_IN_IT_BLOCK) != 0U) {
    cortex_set(core, UC_ARM_REG_XPSR, (frame[7] & PSR_KEPT & ~(PSR_IN_IT_BLOCK | PSR_ALIGNED)) | CORTEX_PSR_THUMB);
  }
  cortex_set(core, UC_ARM_REG_SP, top);
  cortex_set(core, UC_ARM_REG_LR, (core->depth > 0U) ? RETURN_TO_HANDLER : RETURN_TO_THREAD);
  cortex_set(core, UC_ARM_REG_PC, cortex_vector(core, exception) | 1U);
  active->exception = exception;
  cortex_forget(&core->fetch);
  active->spent = (cortex_count){0};
  active->since = core->executed;
  core->depth++;
  core->now += EXCEPTION_CYCLES;
  if (exception == CORTEX_NMI) {
    core->nmi_pending = false;
  } else if (exception == CORTEX_SYSTICK) {
    core->systick_pending = false;
  } else if (exception >= 16U) {
    core->pended[(exception - 16U) / 32U] &= ~(1U << ((exception - 16U) % 32U));
  } else {
    // a fault pends nothing
  }
}

void cortex_leave(cortex_m4 *core) {
  uint32_t frame[8];
  void *frame_values[8];
  void *float_values[9];
  core->depth--;
  cortex_active *active = &core->active[core->depth];
  const uint32_t top = cortex_get(core, UC_ARM_REG_SP);
  if (!in_ram(top, 4U * FRAME_WORDS)) {
    cortex_complain(core, "stack pointer out of the RAM:", top);
    core->dead = true;
    return;
  }
  (void)memcpy(frame, core->ram + (top - CORTEX_RAM_START), sizeof(frame));
  (void)memcpy(active->float_registers, core->ram + (top - CORTEX_RAM_START) + sizeof(frame), 68U);
  const uint32_t stack = top + (4U * FRAME_WORDS) + (((frame[7] & PSR_ALIGNED) != 0U) ? 4U : 0U);
  for (int i = 0; i < 8; i++) {
    frame_values[i] = &frame[i];
  }
  for (int i = 0; i < 9; i++) {
    float_values[i] = &active->float_registers[i];
  }
  frame[6] |= 1U;
  frame[7] &= PSR_KEPT;
  (void)uc_reg_write_batch(core->engine, float_registers, float_values, 9);
  (void)uc_reg_write_batch(core->engine, frame_registers, frame_values, 8);
  cortex_set(core, UC_ARM_REG_SP, stack);
  core->now += EXCEPTION_CYCLES;
  cortex_forget(&core->fetch);

  const cortex_count spent = cortex_count_plus(active->spent, cortex_count_minus(core->executed, active->since));
  cortex_charge(&core->cost[active->exception], spent);
  core->handled = cortex_count_plus(core->handled, spent);
  if (core->depth > 0U) {
    core->active[core->depth - 1U].since = core->executed;
  }
}
