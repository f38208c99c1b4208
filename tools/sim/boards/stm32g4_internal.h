/// What the files of the chip share; its users include stm32g4.h.
#ifndef CRUX_EMULATED_STM32G4_INTERNAL_H
#define CRUX_EMULATED_STM32G4_INTERNAL_H

#include "stm32g4.h"

#define NEVER UINT64_MAX

/// TIM1's update: a PWM period begins, the converters sample.
void stm32g4_update_timer(stm32g4 *chip);

void stm32g4_write_timer1(stm32g4 *chip, uint32_t word, uint32_t value);
uint32_t stm32g4_read_adc(stm32g4 *chip, uint32_t word);
void stm32g4_write_adc(stm32g4 *chip, uint32_t word, uint32_t value);

/// The flash's controller as after a reset; what is in the flash stays.
void stm32g4_reset_flash(stm32g4 *chip);

/// Whether every double word in `size` bytes of the flash can be read; if not its controller says so.
bool stm32g4_reads_flash(stm32g4 *chip, uint32_t offset, uint32_t size);

/// A write of `size` bytes into the flash, `offset` from its start. False when it is refused.
bool stm32g4_program_flash(stm32g4 *chip, uint32_t offset, uint32_t size, uint32_t value);
uint32_t stm32g4_read_flash(const stm32g4 *chip, uint32_t word);
void stm32g4_write_flash(stm32g4 *chip, uint32_t word, uint32_t value);

/// The independent watchdog. Once started nothing but a reset stops it.
uint32_t stm32g4_read_watchdog(const stm32g4 *chip, uint32_t word);
void stm32g4_write_watchdog(stm32g4 *chip, uint32_t word, uint32_t value);

/// Level of the converters' interrupt.
bool stm32g4_converted(const stm32g4 *chip);

#endif
