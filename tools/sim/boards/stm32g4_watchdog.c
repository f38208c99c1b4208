/// The independent watchdog. Its oscillator has 32 kHz here, 29.5..34 on silicon; new values of its registers act at
/// once.
#include "stm32g4_internal.h"

#define OSCILLATOR_PERIOD_CYCLES (170000000U / 32000U)
#define KEY_RELOAD 0xAAAAU
#define KEY_UNLOCK 0x5555U
#define KEY_START 0xCCCCU

enum { KR, PR, RLR, SR };

uint32_t stm32g4_read_watchdog(const stm32g4 *chip, uint32_t word) {
  return ((word == PR) || (word == RLR)) ? chip->watchdog[word] : 0U;
}

static void reload(stm32g4 *chip) {
  const uint64_t period = (uint64_t)OSCILLATOR_PERIOD_CYCLES * (4U << (chip->watchdog[PR] & 7U));
  chip->watchdog_at = chip->core.now + (period * ((chip->watchdog[RLR] & 0xFFFU) + 1U));
}

void stm32g4_write_watchdog(stm32g4 *chip, uint32_t word, uint32_t value) {
  if (word == KR) {
    if (value == KEY_START) {
      chip->watchdog[PR] = 0U;
      chip->watchdog[RLR] = 0xFFFU;
      reload(chip);
    } else if ((value == KEY_RELOAD) && (chip->watchdog_at != NEVER)) {
      reload(chip);
    } else {
      // unlocks, or nothing
    }
    chip->watchdog[KR] = value;
  } else if ((chip->watchdog[KR] == KEY_UNLOCK) && (word != SR)) {
    chip->watchdog[word] = value;
  } else {
    cortex_complain(&chip->core, "writes to the locked watchdog,", value);
  }
}
