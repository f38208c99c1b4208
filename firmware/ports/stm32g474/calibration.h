/// What was measured when the board was mounted, in the last page of the flash.
#ifndef CRUX_STM32G474_CALIBRATION_H
#define CRUX_STM32G474_CALIBRATION_H

#include <stdbool.h>
#include <stdint.h>

#include "drive/motor.h"

#define CALIBRATION_ADDRESS 0x0807F800UL
#define CALIBRATION_MAGIC 0x43525543UL

typedef struct calibration {
  crux_mounting mounting;
  float phase_a_zero_counts;  ///< of the ADC at no current
  float phase_b_zero_counts;
} calibration;

/// Reads it. False when the page holds none: the magnets' place is then unknown, and the motor cannot be driven.
bool calibration_read(calibration *read);

#endif
