/// How long the Cortex-M4F takes for an instruction, by the tables of its technical reference manual: at least
/// (pipelined, short divisions) and at most (nothing pipelined, each result of the floating-point unit used at once).
/// Branches refill the pipeline in one to three cycles; those on a condition are counted as not taken. Waits of memory
/// come on top.
#ifndef CRUX_EMULATED_CORTEX_CYCLES_H
#define CRUX_EMULATED_CORTEX_CYCLES_H

#include <stdbool.h>
#include <stdint.h>

#define CORTEX_REFILL_LEAST 1U  ///< of the pipeline, when a branch is taken
#define CORTEX_REFILL_MOST 3U

#define CORTEX_FLOAT_FLAGS 33U  ///< instead of a register

typedef struct cortex_cycles {
  uint32_t least;
  uint32_t most;
} cortex_cycles;

/// Of an instruction; `second` is the other half of one with two.
cortex_cycles cortex_cycles_of(uint16_t first, uint16_t second);

/// How many instructions after this one it makes conditional: those of an IT, else 0.
uint32_t cortex_conditional(uint16_t first);

/// Place of the constant that an instruction at `at` loads from beside the code, 0: it loads none.
uint32_t cortex_literal(uint16_t first, uint16_t second, uint32_t at);

/// What the floating-point unit has ready a cycle after the instruction: a register s0.. + 1, the flags, 0: nothing.
uint32_t cortex_float_result(uint16_t first, uint16_t second);

/// Whether it needs such a result, or may.
bool cortex_uses_float(uint16_t first, uint16_t second, uint32_t result);

/// Whether it is a branch that may be taken or not.
bool cortex_may_branch(uint16_t first, uint16_t second);

#endif
