#include "motor_model.h"

#include <complex.h>
#include <math.h>

#define TWO_PI 6.283185307179586
#define SMALL 1e-6

static double complex number(motor_vector vector) { return vector.alpha + (I * vector.beta); }

static motor_vector vector(double complex value) { return (motor_vector){creal(value), cimag(value)}; }

motor_vector motor_voltage_V(const motor_parameters *parameters, const double duty[3]) {
  const double complex third = cexp(I * TWO_PI / 3.0);
  return vector(parameters->supply_V * (2.0 / 3.0) * (duty[0] + (duty[1] * third) + (duty[2] * conj(third))));
}

/// (1 - exp(-x)) / x, without the loss of digits about 0.
static double complex mean_of_decay(double complex x) {
  return (cabs(x) < SMALL) ? (1.0 - (0.5 * x)) : ((1.0 - cexp(-x)) / x);
}

double motor_step(motor_model *motor, motor_vector voltage_V, double seconds, double from_rad, double to_rad) {
  const motor_parameters *parameters = &motor->parameters;
  const double speed = (to_rad - from_rad) / seconds;
  const double decay = seconds * parameters->resistance_ohm / parameters->inductance_H;
  const double complex turn = I * (to_rad - from_rad);
  const double complex axis = cexp(I * from_rad);
  const double complex settled = number(voltage_V) / parameters->resistance_ohm;
  const double complex forced =
      (-I * speed * parameters->flux_Wb * axis) / (parameters->resistance_ohm + (I * speed * parameters->inductance_H));
  const double complex fading = number(motor->current_A) - settled - forced;
  const double complex seen_from_rotor =
      conj(axis) * ((fading * mean_of_decay(decay + turn)) + (settled * mean_of_decay(turn)) + forced);
  motor->current_A = vector((fading * exp(-decay)) + settled + (forced * cexp(turn)));
  return 1.5 * parameters->pole_pairs * parameters->flux_Wb * cimag(seen_from_rotor);
}

double motor_phase_A(const motor_model *motor, int phase) {
  return creal(number(motor->current_A) * cexp(-I * TWO_PI * (double)phase / 3.0));
}
