#include "current_control.h"

#include <math.h>

#define INVERSE_SQRT_3 0.577350269F
#define HALF_SQRT_3 0.866025404F

/// Between the sample and the middle of the period in which its duties act.
#define DELAY_PERIODS 1.5F

#define SIXTH 0.166666667F
#define TWENTY_FOURTH 0.0416666667F
#define HUNDRED_TWENTIETH 0.00833333333F

/// Current that the controllers may drive at most, in peak currents.
#define MARGIN 1.25F

void crux_current_control_init(crux_current_control *control, const crux_motor_parameters *motor, float period_s) {
  // A step to the peak current asks for L w of it at once.
  const float gain_V_A = fmaxf(MARGIN * motor->resistance_ohm, motor->inductance_H * motor->bandwidth_rad_s);
  const float decay = expf(-(motor->resistance_ohm * period_s) / motor->inductance_H);
  *control = (crux_current_control){.motor = *motor,
                                    .period_s = period_s,
                                    .limit_V = gain_V_A * motor->peak_current_A,
                                    .model_decay = decay,
                                    .model_gain_A_V = (1.0F - decay) / motor->resistance_ohm,
                                    .model_flux_A = motor->flux_Wb / motor->inductance_H};
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

typedef struct vector {
  float direct;
  float quadrature;
} vector;

/// Share of a voltage that keeps within a limit.
static float share_within(vector voltage_V, float limit_V) {
  const float length_V = sqrtf((voltage_V.direct * voltage_V.direct) + (voltage_V.quadrature * voltage_V.quadrature));
  return (length_V <= limit_V) ? 1.0F : (limit_V / length_V);
}

/// The voltage to make, from the errors of the currents; moves the integrators on.
static vector regulate(crux_current_control *control, const crux_current_inputs *inputs,
                       crux_current_outputs *outputs) {
  const crux_motor_parameters *motor = &control->motor;
  const float gain_V_A = motor->inductance_H * motor->bandwidth_rad_s;
  const vector error_A = {inputs->direct_wanted_A - outputs->direct_A,
                          inputs->quadrature_wanted_A - outputs->quadrature_A};
  const vector asked_V = {(gain_V_A * error_A.direct) + control->direct_integral_V,
                          (gain_V_A * error_A.quadrature) + control->quadrature_integral_V};
  const float allowed = share_within(asked_V, control->limit_V);

  const float coupling_V_A = inputs->speed_rad_s * motor->inductance_H;
  const vector forward_V = {-(coupling_V_A * outputs->quadrature_A),
                            (coupling_V_A * outputs->direct_A) + (inputs->speed_rad_s * motor->flux_Wb)};
  const vector whole_V = {(allowed * asked_V.direct) + forward_V.direct,
                          (allowed * asked_V.quadrature) + forward_V.quadrature};
  const float reached = share_within(whole_V, INVERSE_SQRT_3 * inputs->supply_V);
  const vector made_V = {reached * whole_V.direct, reached * whole_V.quadrature};
  outputs->cut = (allowed < 1.0F) || (reached < 1.0F);

  // What was cut leaves the integrators through the proportional gain: they settle where the voltage is just reached.
  const float step = (motor->resistance_ohm * control->period_s) / motor->inductance_H;
  control->direct_integral_V += step * (made_V.direct - forward_V.direct - control->direct_integral_V);
  control->quadrature_integral_V += step * (made_V.quadrature - forward_V.quadrature - control->quadrature_integral_V);
  return made_V;
}

/// The model goes on by a period and is compared with what was measured.
static void compare(crux_current_control *control, bool follow, crux_stator_vector axis, crux_stator_vector measured_A,
                    crux_current_outputs *outputs) {
  crux_stator_vector *modelled_A = &control->modelled_A;
  if (follow) {
    *modelled_A = measured_A;
  } else {
    modelled_A->alpha = (control->model_decay * modelled_A->alpha) +
                        (control->model_gain_A_V * control->acting_V.alpha) -
                        (control->model_flux_A * (axis.alpha - control->axis.alpha));
    modelled_A->beta = (control->model_decay * modelled_A->beta) + (control->model_gain_A_V * control->acting_V.beta) -
                       (control->model_flux_A * (axis.beta - control->axis.beta));
  }
  control->axis = axis;
  const crux_stator_vector misfit_A = {measured_A.alpha - modelled_A->alpha, measured_A.beta - modelled_A->beta};
  outputs->misfit_A2 = (misfit_A.alpha * misfit_A.alpha) + (misfit_A.beta * misfit_A.beta);
  outputs->modelled_A2 = (modelled_A->alpha * modelled_A->alpha) + (modelled_A->beta * modelled_A->beta);
}

void crux_current_control_step(crux_current_control *control, const crux_current_inputs *inputs,
                               crux_current_outputs *outputs) {
  const crux_motor_parameters *motor = &control->motor;
  const float sine = sinf(inputs->angle_rad);
  const float cosine = cosf(inputs->angle_rad);
  const float alpha_A = inputs->phase_a_A;
  const float beta_A = INVERSE_SQRT_3 * (inputs->phase_a_A + (2.0F * inputs->phase_b_A));
  outputs->direct_A = (cosine * alpha_A) + (sine * beta_A);
  outputs->quadrature_A = (cosine * beta_A) - (sine * alpha_A);
  const crux_stator_vector axis = {cosine, sine};
  const crux_stator_vector measured_A = {alpha_A, beta_A};
  if (inputs->follow) {
    control->direct_integral_V = motor->resistance_ohm * outputs->direct_A;
    control->quadrature_integral_V = motor->resistance_ohm * outputs->quadrature_A;
  }
  compare(control, inputs->follow, axis, measured_A, outputs);
  const vector made_V = regulate(control, inputs, outputs);

  // The rotor turns on until the duties act: by less than half a radian, for which these series are exact to 1e-5.
  const float ahead_rad = DELAY_PERIODS * control->period_s * inputs->speed_rad_s;
  const float square = ahead_rad * ahead_rad;
  const float turn_sine = ahead_rad * (1.0F - (square * (SIXTH - (square * HUNDRED_TWENTIETH))));
  const float turn_cosine = 1.0F - (square * (0.5F - (square * TWENTY_FOURTH)));
  const float ahead_sine = (sine * turn_cosine) + (cosine * turn_sine);
  const float ahead_cosine = (cosine * turn_cosine) - (sine * turn_sine);
  const float share = 1.0F / inputs->supply_V;
  const crux_stator_vector stator_V = {(ahead_cosine * made_V.direct) - (ahead_sine * made_V.quadrature),
                                       (ahead_sine * made_V.direct) + (ahead_cosine * made_V.quadrature)};
  control->acting_V = control->acting_next_V;
  control->acting_next_V = stator_V;
  modulate(share * stator_V.alpha, share * stator_V.beta, outputs->duty);
}

void crux_current_control_stand(const crux_motor_parameters *motor, float angle_rad, float current_A, float supply_V,
                                float duty[3]) {
  const float share = fminf((motor->resistance_ohm * current_A) / supply_V, INVERSE_SQRT_3);
  modulate(share * cosf(angle_rad), share * sinf(angle_rad), duty);
}
