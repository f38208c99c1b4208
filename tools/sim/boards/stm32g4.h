/// The STM32G474 around the core, as far as the node images use it: clocks and their gates, GPIO, TIM1 (three-phase
/// PWM, trigger of the converters), TIM2 (quadrature counter), ADC 1 and 2, SPI1, FDCAN 1 and 2, flash, the independent
/// watchdog, and what hangs on its pins.
///
/// A peripheral whose clock is off reads zero and takes no write. Conversions and SPI transfers are done at once:
/// images that poll wait shorter here than on silicon. Everything else takes its time.
#ifndef CRUX_EMULATED_STM32G4_H
#define CRUX_EMULATED_STM32G4_H

#include "cortex_m4.h"
#include "fdcan_model.h"
#include "flash_model.h"
#include "flash_record.h"

#define STM32G4_SENSOR_BIT_RATE 1000000U  ///< of the classic bus at FDCAN 2

/// What is on the board around the chip.
typedef struct stm32g4_board {
  void *context;
  uint32_t crystal_hz;
  uint32_t straps;  ///< levels of port C
  /// Reading 0..4095 of a converter's channel, now.
  uint32_t (*analogue)(void *context, unsigned converter, unsigned channel);
  /// The PWM begins; before, the bridge was open.
  void (*pwm_start)(void *context, uint64_t time);
  /// A PWM period is over, its duties 0..1 were these; before the converters sample.
  void (*pwm_period)(void *context, uint64_t time, const double duty[3]);
  /// Port A's outputs have changed.
  void (*pins)(void *context, uint32_t before, uint32_t after);
  /// One 16-bit SPI frame.
  uint16_t (*transfer)(void *context, uint16_t out);
} stm32g4_board;

typedef struct stm32g4_adc {
  uint32_t registers[64];
} stm32g4_adc;

typedef struct stm32g4 {
  cortex_m4 core;
  stm32g4_board board;
  fdcan_model can[2];
  uint32_t rcc[64];
  uint64_t crystal_at;  ///< when the crystal swings
  uint32_t pwr[64];
  uint32_t flash_control[64];
  uint64_t flash_busy_until;
  uint32_t flash_first;  ///< the first half of a double word that is being written
  uint32_t flash_unit;   ///< where
  bool flash_half_written;
  bool flash_damaged[CORTEX_FLASH_BYTES / CRUX_FLASH_UNIT];
  crux_flash_model flash;  ///< the core's flash: what is in it, and whether the power holds
  crux_flash flash_access;
  flash_record record;
  uint32_t watchdog[4];  ///< IWDG
  uint64_t watchdog_at;  ///< when it bites
  uint32_t gpio[3][64];
  uint32_t timer1[64];
  uint32_t spi1[64];
  stm32g4_adc adc[2];
  uint32_t adc_common[64];
  uint32_t compare[3];   ///< of TIM1, acting
  uint64_t update_at;    ///< of TIM1
  uint32_t repetitions;  ///< of TIM1: what its repetition counter was loaded with
  bool break_pulled;
  bool at_top;  ///< the counter of TIM1 at its last update
  uint32_t bit_rate;
  uint32_t data_bit_rate;
} stm32g4;

/// Makes the chip; false with the reason in core.fault. Rates are those of the bus at FDCAN 1.
bool stm32g4_open(stm32g4 *chip, const stm32g4_board *board, uint32_t bit_rate, uint32_t data_bit_rate);
void stm32g4_close(stm32g4 *chip);

/// Power comes on.
void stm32g4_power_on(stm32g4 *chip);

/// Power goes; what is in the flash stays.
void stm32g4_power_off(stm32g4 *chip);

/// Something came to a CAN controller: interrupt lines and the next event are looked at anew.
void stm32g4_settle(stm32g4 *chip);

/// The gate driver pulls the timer's break input, or lets it go: the outputs are off, all lower switches on, as long as
/// it pulls, and with AOE come back at the next update.
void stm32g4_break(stm32g4 *chip, bool pulled);

/// Whether the lower switch of phase 0..2 conducts where the last update of TIM1 fell.
bool stm32g4_lower_conducts(const stm32g4 *chip, unsigned phase);

/// Level that the image drives a pin of port A to.
bool stm32g4_pin(const stm32g4 *chip, unsigned pin);

#endif
