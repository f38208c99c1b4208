#include "heat.h"

#include <math.h>

/// Share of the bearable heat at which the current allowed begins to fold back.
#define FOLD_BACK_FROM 0.8F

static float allowed(const crux_motor_parameters *motor, float load) {
  const float peak_A2 = motor->peak_current_A * motor->peak_current_A;
  const float continuous_A2 = motor->continuous_current_A * motor->continuous_current_A;
  const float folded = fminf(fmaxf((load - FOLD_BACK_FROM) / (1.0F - FOLD_BACK_FROM), 0.0F), 1.0F);
  return sqrtf(peak_A2 - (folded * (peak_A2 - continuous_A2)));
}

void crux_heat_init(crux_heat *heat, const crux_motor_parameters *motor) {
  heat->load = 1.0F;
  heat->allowed_A = motor->continuous_current_A;
}

void crux_heat_tick(crux_heat *heat, const crux_motor_parameters *motor, float dt_s, float current_A) {
  const float relative = current_A / motor->continuous_current_A;
  const float share = 1.0F - expf(-dt_s / motor->heating_time_s);
  heat->load += share * ((relative * relative) - heat->load);
  heat->allowed_A = allowed(motor, heat->load);
}
