/// What a node's drive knows of itself, for the node to tell.
#ifndef CRUX_FIRMWARE_HEALTH_H
#define CRUX_FIRMWARE_HEALTH_H

#include <stdbool.h>
#include <stdint.h>

typedef struct crux_health {
  uint8_t cause;             ///< why position or currents are not known; CRUX_CAUSE_NONE: they are
  bool direction_unchecked;  ///< nothing has shown yet that the motor turns the way its current says
  uint32_t encoder_errors;   ///< samples of the motor's encoder left out so far
} crux_health;

#endif
