/// A three-phase machine with surface magnets on a bridge, from one PWM period to the next.
///
/// In the stator's frame L di/dt + R i = v - j w psi exp(j th): v is the mean voltage of the period's duties, th turns
/// at constant speed w (electrical). The solution is written down, not integrated, so a step of any length is exact:
///   i(t) = (i0 - v/R - p0) exp(-t R/L) + v/R + p0 exp(j w t),   p0 = -j w psi exp(j th0) / (R + j w L),
/// and so is the mean of the torque 3/2 pole pairs psi Im(i exp(-j th)) over the step. Not modelled: PWM ripple, dead
/// time, saturation, cogging.
#ifndef CRUX_EMULATED_MOTOR_MODEL_H
#define CRUX_EMULATED_MOTOR_MODEL_H

typedef struct motor_parameters {
  double pole_pairs;
  double resistance_ohm;  ///< of a phase
  double inductance_H;    ///< of a phase
  double flux_Wb;
  double supply_V;
} motor_parameters;

/// Amplitude in the stator's frame: phase a lies along alpha, phase b a third of a turn ahead.
typedef struct motor_vector {
  double alpha;
  double beta;
} motor_vector;

typedef struct motor_model {
  motor_parameters parameters;
  motor_vector current_A;
} motor_model;

/// Mean voltage of duties 0..1 of phases a, b, c.
motor_vector motor_voltage_V(const motor_parameters *parameters, const double duty[3]);

/// `seconds` under a voltage, the magnets' axis going from one electrical angle to another [rad]. Returns the mean
/// torque of the rotor [Nm].
double motor_step(motor_model *motor, motor_vector voltage_V, double seconds, double from_rad, double to_rad);

/// Current of phase 0 (a), 1 (b) or 2 (c), into the motor.
double motor_phase_A(const motor_model *motor, int phase);

#endif
