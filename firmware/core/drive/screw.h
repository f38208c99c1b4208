/// Force of a finger by the motor's torque, through a screw that locks itself.
///
/// Dry friction makes the squeeze F a hysteresis of the rotor's torque T. It grows only while T > c F, with
/// c = 2 lead / (2 pi efficiency) for two fingers, and shrinks only while T < -release_torque c F. In between it stays
/// what it was, at no current at all: the screw is the brake. Therefore
/// - squeezing harder is force control by current, T = c F where F is squeezed already. In the air there is no squeeze
///   and no friction: T = efficiency c F makes F, and more would make the loop above stiffer than its parameters say.
///   Between them friction is compensated as far as the squeeze is known; fingers that stand make it known;
/// - a squeeze that is reached needs no current: the motor rests and the screw holds;
/// - one that is greater than wanted stays: only a force that opens is given the torque to release.
///
/// How hard the fingers squeeze is told by what the load takes from the rotor, T less acceleration and drag, seen by a
/// momentum observer (first order, OBSERVER_RAD_S): c F while the fingers close, -release_torque c F while they open.
#ifndef CRUX_FIRMWARE_DRIVE_SCREW_H
#define CRUX_FIRMWARE_DRIVE_SCREW_H

#include <stdbool.h>

#include "motor.h"

typedef struct crux_screw {
  crux_screw_parameters parameters;
  float momentum_Nms;  ///< integral of torque less load
  float load_Nm;       ///< what the load takes from the rotor, positive against closing
  float force_N;       ///< estimate of the squeeze, a finger
  bool braked;         ///< the screw holds alone
} crux_screw;

/// Starts at rest. The parameters must have passed crux_screw_parameters_fault.
void crux_screw_init(crux_screw *screw, const crux_screw_parameters *parameters);

/// Takes in the last control period of dt_s seconds: torque and speed of the rotor, positive closes.
void crux_screw_observe(crux_screw *screw, float dt_s, float rotor_torque_Nm, float rotor_speed_rad_s);

/// Rotor torque for the finger force wanted (positive squeezes, negative opens). `may_release`: false in every state in
/// which the gripper must hold on; then no torque opens.
float crux_screw_rotor_torque_Nm(crux_screw *screw, float force_N, bool may_release);

#endif
