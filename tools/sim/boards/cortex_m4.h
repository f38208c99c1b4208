/// A Cortex-M4F that executes an image: Unicorn runs the instructions, this file adds what Unicorn leaves out:
/// exceptions with priorities and nesting, the NVIC, SysTick, sleep, and time.
///
/// Time is counted in core cycles, one an executed instruction and EXCEPTION_CYCLES an entry or return. It is exact to
/// one basic block, and the same in every run. A block that has begun is finished before an interrupt is taken.
#ifndef CRUX_EMULATED_CORTEX_M4_H
#define CRUX_EMULATED_CORTEX_M4_H

#include <stdbool.h>
#include <stdint.h>
#include <unicorn/unicorn.h>

#include "cortex_account.h"

#define CORTEX_FLASH_BYTES (512U << 10U)
#define CORTEX_RAM_BYTES (128U << 10U)
#define CORTEX_INTERRUPTS 102U
#define CORTEX_EXCEPTIONS (16U + CORTEX_INTERRUPTS)
#define CORTEX_SYSTICK 15U
#define CORTEX_NEVER UINT64_MAX

/// What the core asks of the chip around it. Offsets count from 0x40000000, accesses are of whole words.
typedef struct cortex_chip {
  void *context;
  /// False: nothing answers there, a bus fault.
  bool (*read)(void *context, uint32_t offset, uint32_t *value);
  bool (*write)(void *context, uint32_t offset, uint32_t value);
  /// The image writes `size` bytes into the flash, `offset` from its start. False: refused, a fault.
  bool (*program)(void *context, uint32_t offset, uint32_t size, uint32_t value);
  /// Asked of what the image reads of its flash, while cortex_watch_flash is on. False: the flash cannot correct it, a
  /// non-maskable interrupt.
  bool (*reads)(void *context, uint32_t offset, uint32_t size);
  /// The time of cortex_wake_at has come.
  void (*on_time)(void *context);
  /// The image asks for a reset; calls cortex_power_on.
  void (*restart)(void *context);
} cortex_chip;

/// How long an interrupt's handler took, what interrupted it and the way in and out not counted.
typedef struct cortex_cost {
  uint64_t calls;
  cortex_count sum;
  cortex_count worst;  ///< each by itself the greatest of a call
} cortex_cost;

typedef struct cortex_active {
  uint32_t exception;
  cortex_count spent;  ///< by the handler so far
  cortex_count since;  ///< count at its entry or last resumption
  uint64_t float_registers[9];
} cortex_active;

typedef struct cortex_block {
  uint16_t bytes;
  uint16_t instructions;
} cortex_block;

typedef struct cortex_m4 {
  uc_engine *engine;
  cortex_chip chip;
  uint8_t *flash;
  uint8_t *ram;
  cortex_block *blocks;   ///< by address in flash / 2
  uint64_t now;           ///< core cycles since power-on
  cortex_count executed;  ///< since the board was made
  bool measures;          ///< counts cycles, which takes its time
  cortex_fetch fetch;     ///< what the flash's accelerator holds then
  uint64_t stop_at;       ///< when the engine shall come back
  uint64_t chip_at;       ///< when the chip wants to be called
  uint64_t systick_at;    ///< of the next underflow
  uint32_t control_space[1024];
  uint32_t line[4];  ///< requests of the chip, by interrupt
  uint32_t enabled[4];
  uint32_t pended[4];  ///< by software
  uint8_t priority[CORTEX_EXCEPTIONS];
  cortex_active active[8];
  unsigned depth;
  uc_hook flash_hook;
  bool flash_watched;
  uint32_t flash_excused;  ///< address whose read has led to the interrupt
  bool nmi_pending;
  bool systick_pending;
  bool masked_request;  ///< come back as soon as PRIMASK is cleared
  bool stopped;         ///< by us, not by sleep
  bool asleep;
  bool wants_reset;
  bool dead;                            ///< by a fault in a fault handler, or locked up
  char fault[160];                      ///< what the image did wrong first, empty: nothing
  cortex_cost cost[CORTEX_EXCEPTIONS];  ///< entry 0: the main loop, from one sleep to the next
  cortex_count awake_since;             ///< count when the core woke
  cortex_count handled;                 ///< by interrupts since
} cortex_m4;

/// Makes the core; false (reason in `fault`) when the engine refuses. The chip's context must outlive it.
bool cortex_open(cortex_m4 *core, const cortex_chip *chip);
void cortex_close(cortex_m4 *core);

/// Power-on: RAM full of rubbish, registers and NVIC as after reset. Time goes on.
void cortex_power_on(cortex_m4 *core);

/// Executes and sleeps until `time`.
void cortex_run_until(cortex_m4 *core, uint64_t time);

/// The chip wants to be called at `time`, CORTEX_NEVER: not at all.
void cortex_wake_at(cortex_m4 *core, uint64_t time);

/// The chip wants to be asked about every read of the flash, which takes time. Between two starts of the core.
void cortex_watch_flash(cortex_m4 *core, bool on);

/// Ends the execution: the power has gone. cortex_power_on brings the core back.
void cortex_power_off(cortex_m4 *core);

/// Raises or lowers the request of an interrupt.
void cortex_request(cortex_m4 *core, unsigned interrupt, bool on);

/// Notes what the image did wrong, if it is the first thing.
void cortex_complain(cortex_m4 *core, const char *what, uint32_t address);

#endif
