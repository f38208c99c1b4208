/// What a board makes of what it reads once a tick. Pure: no register is read here.
#ifndef CRUX_FIRMWARE_BOARD_WATCH_H
#define CRUX_FIRMWARE_BOARD_WATCH_H

#include <stdbool.h>
#include <stdint.h>

/// Winding temperature [degC] of a thermistor of 10 kOhm at 25 degC to ground below 10 kOhm to the reference; `share`:
/// of the reference's voltage, 0..1. Not a number: it is open or shorted, for no winding is that cold or hot.
float crux_thermistor_degC(float share);

/// Whether the current loop runs; starts as zeros.
typedef struct crux_loop_watch {
  uint32_t periods;      ///< at the last tick
  uint32_t still_ticks;  ///< without a period since the tick before
  bool was_behind;       ///< at the last tick
} crux_loop_watch;

/// Once a tick; `periods` of the loop so far, `behind`: the next tick has come already. False when the loop has not run
/// for two ticks that did not come at once.
bool crux_loop_runs(crux_loop_watch *watch, uint32_t periods, bool behind);

/// Once a tick: for how many more a fault is told, so that a short one shows. `left`: the same at the tick before.
uint32_t crux_fault_ticks(uint32_t left, bool fault, uint32_t least);

#endif
