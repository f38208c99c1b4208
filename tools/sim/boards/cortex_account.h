/// Bounds of the cycles that a real chip takes for a stream of instructions: those of the core (cortex_cycles.h), and
/// the waits of the flash at 170 MHz behind its accelerator. The least is without any wait. For the most
/// - a 64-bit word of the flash (dual-bank mode) takes four waits when the accelerator's cache does not hold it. The
/// cache
///   has 32 lines of four such words, the one used longest ago makes room, and it is empty when a handler begins or
///   goes on after another;
/// - the prefetch reads the next word while one that came from the flash is executed, and saves no more than that
/// takes;
/// - a literal waits unless it stands in one of the eight words literals came from last (the data cache has eight
/// lines);
///   every access of a peripheral waits for its bridge;
/// - a floating-point result that the next instruction needs comes a cycle later.
/// Tables in flash are taken for RAM.
#ifndef CRUX_EMULATED_CORTEX_ACCOUNT_H
#define CRUX_EMULATED_CORTEX_ACCOUNT_H

#include <stdbool.h>
#include <stdint.h>

#define CORTEX_PERIPHERAL_WAITS 4U
#define CORTEX_CACHE_LINES 32U
#define CORTEX_LITERALS 8U

/// Instructions and, while the core measures, the bounds of their cycles.
typedef struct cortex_count {
  uint64_t instructions;
  uint64_t least_cycles;
  uint64_t most_cycles;
} cortex_count;

/// What the accelerator holds, and what was fetched last.
typedef struct cortex_fetch {
  uint32_t line[CORTEX_CACHE_LINES];  ///< number + 1, used last first; 0: empty
  uint8_t words[CORTEX_CACHE_LINES];  ///< held of it
  uint32_t word;                      ///< fetched last, number + 1; 0: nothing yet
  bool waited;                        ///< it came from the flash
  uint32_t cycles;                    ///< spent in it, at least
  uint32_t result;                    ///< of the floating-point unit, see cortex_float_result
  uint32_t literal[CORTEX_LITERALS];  ///< words, number + 1, in turn
  uint32_t literals;                  ///< loaded from flash so far
  uint32_t end;                       ///< of the block before, 0: unknown
  bool may_branch;                    ///< it ended in a branch on a condition
} cortex_fetch;

/// Empties the accelerator.
void cortex_forget(cortex_fetch *fetch);

/// Adds the cycles of a basic block of the flash to a count.
void cortex_account(cortex_fetch *fetch, cortex_count *count, const uint8_t *flash, uint32_t offset, uint32_t bytes);

#endif
