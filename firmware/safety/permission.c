#include "permission.h"

#include <string.h>

#include "codec.h"
#include "crux_services.h"

bool crux_is_at_rest(uint8_t state) {
  return (state == (uint8_t)CRUX_STATE_BOOT) || (state == (uint8_t)CRUX_STATE_HOLD) ||
         (state == (uint8_t)CRUX_STATE_FAULT);
}

/// Value of a parameter: the bits of a float, or an integer.
static float number(const crux_parameter *parameter, uint32_t bits) {
  float value = 0.0F;
  (void)memcpy(&value, &bits, sizeof(value));
  return parameter->is_integer ? (float)bits : value;
}

bool crux_parameter_accepts(const crux_parameter *parameter, uint32_t described, uint32_t bits) {
  const float standard = number(parameter, described);
  const float value = number(parameter, bits);
  // A value that is not a number is on neither side of a limit.
  return parameter->writable && (value >= (parameter->least_share * standard)) &&
         (value <= (parameter->greatest_share * standard));
}

bool crux_may_restart(uint8_t state, bool commanded, uint32_t acknowledgement) {
  return crux_is_at_rest(state) && !commanded && (acknowledgement == (uint32_t)CRUX_ACKNOWLEDGEMENT_OFF_THE_WALL);
}
