/// Absolute encoder of a rotor: whole turns counted, speed observed, senseless samples refused.
///
/// Speed comes from a tracking loop of second order with both poles at `OBSERVER_RAD_S`: an estimate of the position
/// runs along, its error corrects position and speed. No lag at constant speed, and a count more or less is no jump.
/// A sample further away than the rotor can have turned, or one that the sensor marks as bad, is left out; the position
/// then runs on at the speed known. After MAX_MISSED such samples in a row the encoder is lost, until it is found
/// again: that is homing as after a start, for nobody knows how far the rotor has turned meanwhile.
#ifndef CRUX_FIRMWARE_DRIVE_ENCODER_H
#define CRUX_FIRMWARE_DRIVE_ENCODER_H

#include <stdbool.h>
#include <stdint.h>

#include "motor.h"

typedef struct crux_encoder {
  uint32_t counts_per_turn;
  float rad_per_count;
  float period_s;
  float age_s;          ///< of a sample when it is taken in: the position is that of now, at the speed known
  float reach_counts;   ///< the rotor turns no further than this in a period
  int32_t counts;       ///< turned since the first sample, whole turns included
  int32_t home_counts;  ///< added to `counts`: where the first sample lies on the axis behind the gear
  uint32_t raw;         ///< last sample that made sense
  float behind_counts;  ///< position minus the estimate of it
  float speed_rad_s;
  uint32_t missed;   ///< samples left out since then
  uint32_t refused;  ///< left out since the start; those of a lost encoder count no more
  uint32_t found;    ///< times in a row that a lost encoder was homed
  bool seen;
  bool lost;
} crux_encoder;

void crux_encoder_init(crux_encoder *encoder, const crux_motor_parameters *motor, float period_s, float age_s);

/// Takes a sample 0..counts_per_turn - 1, one a period.
void crux_encoder_step(crux_encoder *encoder, uint32_t raw, bool valid);

/// Rotor's position on the axis that homing set [rad].
float crux_encoder_position_rad(const crux_encoder *encoder);

/// Homing without motion: a coarse absolute sensor behind the gear says where the rotor is to within a part of a turn,
/// the encoder says the rest. `rotor_rad` is the coarse sensor's position times the gear ratio, `zero_counts` the
/// encoder's sample at the axis' zero. False, and nothing changes, when the two differ by more than a quarter turn from
/// any whole number of turns, since the next count of the coarse sensor could then choose another turn.
bool crux_encoder_home(crux_encoder *encoder, float rotor_rad, uint32_t zero_counts);

/// A lost encoder answers again, with this sample. Homing and crux_encoder_found follow.
void crux_encoder_restart(crux_encoder *encoder, uint32_t raw);

/// Whether the restarted encoder was homed. After FOUND_TIMES in a row it counts as found.
void crux_encoder_found(crux_encoder *encoder, bool homed);

/// Angle of a coarse encoder whose turn holds the whole travel: the one within half a turn of `middle_rad`.
float crux_encoder_coarse_rad(uint32_t raw, uint32_t zero_counts, uint32_t counts_per_turn, float middle_rad);

/// Electrical angle -pi..pi of the magnets' axis, `offset_counts` being the sample at which it is zero.
float crux_encoder_electrical_rad(const crux_encoder *encoder, uint32_t pole_pairs, uint32_t offset_counts);

#endif
