/// What the files of the core share; its users include cortex_m4.h.
#ifndef CRUX_EMULATED_CORTEX_INTERNAL_H
#define CRUX_EMULATED_CORTEX_INTERNAL_H

#include "cortex_m4.h"

#define FLASH_START 0x08000000U
#define SCB_VTOR 0xD08U
#define CORTEX_RAM_START 0x20000000U
#define CORTEX_NMI 2U
#define CORTEX_HARD_FAULT 3U
#define CORTEX_RETURN_MASK 0xFFFFFFE0U  ///< of an exception return in the program counter

#define CORTEX_PSR_THUMB (1U << 24U)

// Offsets in the system control space.
#define SYST_CSR 0x010U
#define SYST_RVR 0x014U

static inline uint32_t cortex_get(const cortex_m4 *core, int name) {
  uint32_t value = 0U;
  (void)uc_reg_read(core->engine, name, &value);
  return value;
}

static inline void cortex_set(const cortex_m4 *core, int name, uint32_t value) {
  (void)uc_reg_write(core->engine, name, &value);
}

static inline cortex_count cortex_count_plus(cortex_count a, cortex_count b) {
  return (cortex_count){.instructions = a.instructions + b.instructions,
                        .least_cycles = a.least_cycles + b.least_cycles,
                        .most_cycles = a.most_cycles + b.most_cycles};
}

static inline cortex_count cortex_count_minus(cortex_count a, cortex_count b) {
  return (cortex_count){.instructions = a.instructions - b.instructions,
                        .least_cycles = a.least_cycles - b.least_cycles,
                        .most_cycles = a.most_cycles - b.most_cycles};
}

/// Enters a call that has ended.
static inline void cortex_charge(cortex_cost *cost, cortex_count spent) {
  cortex_count *worst = &cost->worst;
  cost->calls++;
  cost->sum = cortex_count_plus(cost->sum, spent);
  worst->instructions = (spent.instructions > worst->instructions) ? spent.instructions : worst->instructions;
  worst->least_cycles = (spent.least_cycles > worst->least_cycles) ? spent.least_cycles : worst->least_cycles;
  worst->most_cycles = (spent.most_cycles > worst->most_cycles) ? spent.most_cycles : worst->most_cycles;
}

/// Word of the vector table.
uint32_t cortex_vector(const cortex_m4 *core, uint32_t exception);

/// The most urgent exception that may interrupt what runs, 0 for none; masks are not looked at.
uint32_t cortex_requested(const cortex_m4 *core);

bool cortex_is_active(const cortex_m4 *core, uint32_t exception);

/// Stacks the registers and goes to the handler.
void cortex_enter(cortex_m4 *core, uint32_t exception);

/// The handler has returned: back to what it interrupted.
void cortex_leave(cortex_m4 *core);

/// NVIC, SysTick and system control block, for Unicorn.
uint64_t cortex_read_control(uc_engine *engine, uint64_t offset, unsigned size, void *context);
void cortex_write_control(uc_engine *engine, uint64_t offset, unsigned size, uint64_t value, void *context);

#endif
