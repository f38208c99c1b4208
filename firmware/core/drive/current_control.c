#include "current_control.h"

#include <math.h>

#define INVERSE_SQRT_3 0.577350269F
#define HALF_SQRT_3 0.866025404F

/// Between the sample and the middle of the period in which its duties act.
#define DELAY_PERIODS 1.5F

void crux_current_control_init(crux_current_control *control, const crux_motor_parameters *motor, float period_s) {
  *control = (crux_current_control){.motor = *motor, .period_s = period_s};
}

static float middle(float a, float b, float c) { return fmaxf(fminf(a, b), fminf(fmaxf(a, b), c)); }

static float to_duty(float share) { return fminf(fmaxf(share + 0.5F, 0.0F), 1.0F); }

/// Duties of the phases for a voltage vector given as a share of the supply. Half the middle phase is added to all of
/// them, which centres the outer two and makes the whole inscribed circle of the hexagon, 1/sqrt(3), reachable.
static void modulate(float alpha, float beta, float duty[3]) {
  const float a = alpha;
  const float b = (-0.5F * alpha) + (HALF_SQRT_3 * beta);
  const float c = (-0.5F * alpha) - (HALF_SQRT_3 * beta);
  const float common = 0.5F * middle(a, b, c);
  duty[0] = to_duty(a + common);
  duty[1] = to_duty(b + common);
  duty[2] = to_duty(c + common);
}

void crux_current_control_step(crux_current_control *control, const crux_current_inputs *inputs,
                               crux_current_outputs *outputs) {
  const crux_motor_parameters *motor = &control->motor;
  const float sine = sinf(inputs->angle_rad);
  const float cosine = cosf(inputs->angle_rad);

  const float alpha_A = inputs->phase_a_A;
  const float beta_A = INVERSE_SQRT_3 * (inputs->phase_a_A + (2.0F * inputs->phase_b_A));
  const float direct_A = (cosine * alpha_A) + (sine * beta_A);
  const float quadrature_A = (cosine * beta_A) - (sine * alpha_A);

  const float gain_V_A = motor->inductance_H * motor->bandwidth_rad_s;
  const float direct_error_A = -direct_A;
  const float quadrature_error_A = inputs->quadrature_wanted_A - quadrature_A;
  const float coupling_V_A = inputs->speed_rad_s * motor->inductance_H;
  const float direct_V = (gain_V_A * direct_error_A) + control->direct_integral_V - (coupling_V_A * quadrature_A);
  const float quadrature_V = (gain_V_A * quadrature_error_A) + control->quadrature_integral_V +
                             (coupling_V_A * direct_A) + (inputs->speed_rad_s * motor->flux_Wb);

  const float reach_V = INVERSE_SQRT_3 * inputs->supply_V;
  const float asked_V = sqrtf((direct_V * direct_V) + (quadrature_V * quadrature_V));
  outputs->cut = !(asked_V <= reach_V);
  const float scale = outputs->cut ? (reach_V / asked_V) : 1.0F;

  // What was cut leaves the integrators through the proportional gain: they settle where the voltage is just reached.
  const float step = motor->resistance_ohm * motor->bandwidth_rad_s * control->period_s;
  control->direct_integral_V += step * (direct_error_A + (((scale - 1.0F) * direct_V) / gain_V_A));
  control->quadrature_integral_V += step * (quadrature_error_A + (((scale - 1.0F) * quadrature_V) / gain_V_A));

  // The rotor turns on until the duties act.
  const float ahead_rad = DELAY_PERIODS * control->period_s * inputs->speed_rad_s;
  const float ahead_sine = (sine * cosf(ahead_rad)) + (cosine * sinf(ahead_rad));
  const float ahead_cosine = (cosine * cosf(ahead_rad)) - (sine * sinf(ahead_rad));
  const float share = scale / inputs->supply_V;
  modulate(share * ((ahead_cosine * direct_V) - (ahead_sine * quadrature_V)),
           share * ((ahead_sine * direct_V) + (ahead_cosine * quadrature_V)), outputs->duty);
  outputs->direct_A = direct_A;
  outputs->quadrature_A = quadrature_A;
}

void crux_current_control_stand(const crux_motor_parameters *motor, float angle_rad, float current_A, float supply_V,
                                float duty[3]) {
  const float share = fminf((motor->resistance_ohm * current_A) / supply_V, INVERSE_SQRT_3);
  modulate(share * cosf(angle_rad), share * sinf(angle_rad), duty);
}
