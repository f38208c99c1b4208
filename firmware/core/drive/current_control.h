/// Field-oriented control of the phase currents: one call a PWM period.
///
/// Currents go from the phases into the rotor's frame (Clarke, Park; amplitudes kept). There a phase is R and L in
/// series, so a PI controller with Kp = L w, Ki = R w cancels its pole and leaves an integrator: bandwidth w. The
/// voltages that couple the two axes and the magnets' voltage are fed forward. The voltage asked for is cut to the
/// circle that the supply can make, and the integrators take back what was cut (back-calculation). Out come three duty
/// cycles with the common-mode voltage in their middle (space-vector modulation).
///
/// Two consequences protect the motor from wrong current readings. The controllers' voltage, without what is fed
/// forward, is limited to what drives MARGIN times the peak current through the phase: whatever is measured, no more
/// can flow. And beside the control runs a model of the current that takes no notice of the readings, in the stator's
/// frame: L di + flux d(axis) = (v - R i) dt, with the voltage made and the magnets' axis as the encoder sees it, so
/// that no speed has to be known. Readings that differ from it are wrong, or the voltage does not act on the motor as
/// it should.
#ifndef CRUX_FIRMWARE_DRIVE_CURRENT_CONTROL_H
#define CRUX_FIRMWARE_DRIVE_CURRENT_CONTROL_H

#include <stdbool.h>

#include "motor.h"

typedef struct crux_current_inputs {
  float phase_a_A;  ///< into the motor; the three add up to zero
  float phase_b_A;
  float supply_V;
  float angle_rad;    ///< electrical, -pi..pi: of the magnets' axis from phase a's, when the currents were sampled
  float speed_rad_s;  ///< electrical
  float quadrature_wanted_A;  ///< makes the torque
  float direct_wanted_A;      ///< zero but for tests of the motor's direction
  bool follow;  ///< the voltage made so far did not act, or in another frame: model and integrators start from the
                ///< currents measured
} crux_current_inputs;

typedef struct crux_current_outputs {
  float duty[3];  ///< of phases a, b, c, 0..1
  float direct_A;
  float quadrature_A;
  float misfit_A2;    ///< square of the difference between the currents measured and modelled
  float modelled_A2;  ///< square of the latter
  bool cut;           ///< the voltage asked for could not be made, or is not allowed
} crux_current_outputs;

/// In the stator's frame: alpha lies along phase a.
typedef struct crux_stator_vector {
  float alpha;
  float beta;
} crux_stator_vector;

typedef struct crux_current_control {
  crux_motor_parameters motor;
  float period_s;
  float limit_V;      ///< of the controllers' voltage
  float model_decay;  ///< of the current without voltage, in a period
  float model_gain_A_V;
  float model_flux_A;                ///< flux over inductance
  crux_stator_vector modelled_A;     ///< when the last sample was taken
  crux_stator_vector axis;           ///< of the magnets then, of length one
  crux_stator_vector acting_V;       ///< from then on for a period
  crux_stator_vector acting_next_V;  ///< in the period after that
  float direct_integral_V;
  float quadrature_integral_V;
} crux_current_control;

/// Starts with integrators at zero. The parameters must have passed crux_motor_parameters_fault.
void crux_current_control_init(crux_current_control *control, const crux_motor_parameters *motor, float period_s);

/// Duties of a field that stands at `angle_rad` (electrical) without any feedback: the voltage that drives `current_A`
/// through the phases' resistance once the rotor stands. The magnets lock to it.
void crux_current_control_stand(const crux_motor_parameters *motor, float angle_rad, float current_A, float supply_V,
                                float duty[3]);

/// One PWM period. The duties take effect one period after the currents were sampled.
void crux_current_control_step(crux_current_control *control, const crux_current_inputs *inputs,
                               crux_current_outputs *outputs);

#endif
