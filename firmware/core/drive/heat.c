#include "heat.h"

#include <math.h>

/// Share of the bearable heat at which the current allowed begins to fold back.
#define FOLD_BACK_FROM 0.8F

/// Coldest surroundings in which a warm winding is told from a loaded one: colder ones make the load look smaller.
#define SURROUNDINGS_DEG_C 20.0F

/// From the temperature limit on the current folds back over so many kelvin.
#define FOLD_BACK_K 10.0F

static float share_above(float value, float from, float to) {
  return fminf(fmaxf((value - from) / (to - from), 0.0F), 1.0F);  // 0 for what is not a number
}

static float allowed(const crux_motor_parameters *motor, float folded) {
  const float peak_A2 = motor->peak_current_A * motor->peak_current_A;
  const float continuous_A2 = motor->continuous_current_A * motor->continuous_current_A;
  return sqrtf(peak_A2 - (folded * (peak_A2 - continuous_A2)));
}

void crux_heat_init(crux_heat *heat, const crux_motor_parameters *motor) {
  heat->load = 1.0F;
  heat->allowed_A = motor->continuous_current_A;
  heat->seen = false;
}

void crux_heat_tick(crux_heat *heat, const crux_motor_parameters *motor, float dt_s, float current_A,
                    float temperature_degC) {
  const float limit_degC = motor->temperature_limit_degC;
  if (!heat->seen && (isfinite(temperature_degC) != 0)) {
    heat->load = share_above(temperature_degC, SURROUNDINGS_DEG_C, limit_degC);
    heat->seen = true;
  }
  const float relative = current_A / motor->continuous_current_A;
  const float share = 1.0F - expf(-dt_s / motor->heating_time_s);
  heat->load += share * ((relative * relative) - heat->load);
  heat->allowed_A = allowed(motor, fmaxf(share_above(heat->load, FOLD_BACK_FROM, 1.0F),
                                         share_above(temperature_degC, limit_degC, limit_degC + FOLD_BACK_K)));
}
