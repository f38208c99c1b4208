#include "drive/board_watch.h"

#include <math.h>

#include "safety.h"

#define THERMISTOR_B_K 3435.0F
#define THERMISTOR_NOMINAL_K 298.15F
#define CELSIUS_K 273.15F
// An open thermistor reads -100 degC, a shorted one less still.
#define COLDEST_DEG_C (-55.0F)
#define HOTTEST_DEG_C 250.0F

/// So many ticks without a period: the current loop does not run.
#define STILL_TICKS 2U

float crux_thermistor_degC(float share) {
  const float inverse_K = (1.0F / THERMISTOR_NOMINAL_K) + (logf(share / (1.0F - share)) / THERMISTOR_B_K);
  const float degC = (1.0F / inverse_K) - CELSIUS_K;
  return crux_makes_sense(degC, COLDEST_DEG_C, HOTTEST_DEG_C) ? degC : NAN;
}

bool crux_loop_runs(crux_loop_watch *watch, uint32_t periods, bool behind) {
  // Between ticks that come at once, after flash was erased for instance, there is no time for a period; nor, perhaps,
  // between the last of them and the next one.
  if (periods != watch->periods) {
    watch->still_ticks = 0U;
  } else if (!watch->was_behind && (watch->still_ticks < STILL_TICKS)) {
    watch->still_ticks++;
  } else {
    // no verdict, or the same
  }
  watch->periods = periods;
  watch->was_behind = behind;
  return watch->still_ticks < STILL_TICKS;
}

uint32_t crux_fault_ticks(uint32_t left, bool fault, uint32_t least) {
  const uint32_t fewer = (left > 0U) ? (left - 1U) : 0U;
  return fault ? least : fewer;
}
