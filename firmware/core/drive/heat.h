/// Heat of a winding, counted from its current (I squared t): the winding's temperature over its surroundings follows
/// the square of the current by a first-order lag, and at the continuous current it settles at the most it can bear.
/// As that is approached the current allowed folds back from the peak to the continuous current and no further: a joint
/// that hangs on its motor gets weaker, never limp. A winding measured hot folds back the same way, whatever its count.
#ifndef CRUX_FIRMWARE_DRIVE_HEAT_H
#define CRUX_FIRMWARE_DRIVE_HEAT_H

#include <stdbool.h>

#include "motor.h"

typedef struct crux_heat {
  float load;       ///< temperature rise as a share of what the winding can bear, 0..1
  float allowed_A;  ///< current amplitude allowed now
  bool seen;        ///< the winding's temperature has been measured
} crux_heat;

/// Starts `load` full: after a restart nobody knows how hot the winding is, so the worst is taken until its temperature
/// is measured, which sets `load` once.
void crux_heat_init(crux_heat *heat, const crux_motor_parameters *motor);

/// Takes in the current of the last dt_s > 0 seconds and the winding's temperature; not a number: it is not known.
void crux_heat_tick(crux_heat *heat, const crux_motor_parameters *motor, float dt_s, float current_A,
                    float temperature_degC);

#endif
