/// Whether a motor turns the way its current says. Phases that were swapped or an electrical offset that is wrong by up
/// to half a turn make torque of the wrong sign, and the position loop above then drives the joint away.
///
/// A try is a pulse of current on top of what the loop asks for, a rest as long, and the change of speed in both. A
/// load that stays the same cancels in the difference, and what the loop adds is counted with the pulse:
///   (dv_pulse - dv_rest) J = Kt (integral of i over the pulse - over the rest).
/// A pulse of the quadrature current must turn the rotor its way; one along the magnets, in every second try, must not
/// turn it: swapped phases make the torque follow the cosine of twice the angle, and of the two one or the other shows
/// it at nearly every angle. One try of each kind that is answered so passes; two that are answered otherwise are a
/// motor that turns the wrong way. Where the shaft does not answer in six tries (a locked joint, a gripper that
/// squeezes) or the loop holds more than the pulse is worth (a joint under load), nothing is decided, and that is told.
/// What a pulse does to a robot on a wall: a tenth of the peak torque of a joint for 10 ms, which moves it by less than
/// 2 mrad; a gripper's only closes, and is too weak to open one that squeezes with more than 3 N, should its motor turn
/// the wrong way.
///
/// What is left is found while the motor turns: the magnets' voltage is then against the one that is fed forward (see
/// current_control.h).
#ifndef CRUX_FIRMWARE_DRIVE_DIRECTION_H
#define CRUX_FIRMWARE_DRIVE_DIRECTION_H

#include <stdbool.h>
#include <stdint.h>

typedef enum crux_direction_verdict {
  CRUX_DIRECTION_ASKED,  ///< the test runs
  CRUX_DIRECTION_RIGHT,
  CRUX_DIRECTION_WRONG,
  CRUX_DIRECTION_UNCHECKED,
} crux_direction_verdict;

typedef struct crux_direction {
  float pulse_A;  ///< 0: no test
  uint32_t ticks;
  uint32_t tries;
  float speed_rad_s;  ///< of the rotor, when the part of the test that runs now began
  float pulse_change_rad_s;
  float charge_A;          ///< sum of the currents of the pulse's ticks, minus the rest's
  bool loaded;             ///< the loop asked for more than the pulse, in this try
  bool direct;             ///< the pulse of this try is along the magnets
  bool forwards;           ///< a pulse of the quadrature current turned it the right way
  bool still;              ///< one along the magnets did not turn it
  float response_rad_s_A;  ///< change of speed by the sum of the currents
  uint32_t against;        ///< tries that were answered otherwise
  crux_direction_verdict verdict;
} crux_direction;

/// Starts the test with pulses of `pulse_A`.
void crux_direction_init(crux_direction *direction, float pulse_A);

/// One control period (1 ms) with the rotor's speed, the current that flowed in the last period and the one that the
/// loop asks for now. Returns the pulse: to be added to the latter, or where `direct` is set to the direct current.
float crux_direction_tick(crux_direction *direction, float rotor_speed_rad_s, float flowed_A, float wanted_A);

#endif
