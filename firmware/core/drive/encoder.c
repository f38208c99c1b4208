#include "encoder.h"

#include <math.h>
#include <stdatomic.h>

#define TWO_PI 6.28318531F

/// Poles of the tracking loop: fast against a joint (a few hundred rad/s), slow against the quantisation.
#define OBSERVER_RAD_S 1000.0F

/// On top of what the greatest speed explains: the sensor's own noise.
#define NOISE_COUNTS 4.0F
#define MAX_MISSED 20U
#define HOMING_MAX_TURN 0.25F
#define FOUND_TIMES 10U

void crux_encoder_init(crux_encoder *encoder, const crux_motor_parameters *motor, float period_s, float age_s) {
  *encoder = (crux_encoder){
      .counts_per_turn = motor->encoder_counts,
      .rad_per_count = TWO_PI / (float)motor->encoder_counts,
      .period_s = period_s,
      .age_s = age_s,
  };
  encoder->reach_counts = (motor->max_speed_rad_s * period_s) / encoder->rad_per_count;
}

/// The shorter way round from `from` to `to`.
static int32_t way(const crux_encoder *encoder, uint32_t from, uint32_t to) {
  const int32_t turn = (int32_t)encoder->counts_per_turn;
  int32_t counts = (int32_t)to - (int32_t)from;
  if (counts > (turn / 2)) {
    counts -= turn;
  } else if (counts < -(turn / 2)) {
    counts += turn;
  } else {
    // short already
  }
  return counts;
}

static void miss(crux_encoder *encoder) {
  encoder->refused += encoder->lost ? 0U : 1U;
  if (encoder->missed < MAX_MISSED) {
    encoder->missed++;
  } else {
    encoder->lost = true;
  }
}

static void observe(crux_encoder *encoder, int32_t moved_counts) {
  const float gain = OBSERVER_RAD_S * encoder->period_s;
  const float periods = (float)encoder->missed + 1.0F;
  const float speed_counts = (encoder->speed_rad_s * encoder->period_s) / encoder->rad_per_count;
  encoder->behind_counts += (float)moved_counts - (periods * speed_counts);
  encoder->speed_rad_s += (gain * gain * encoder->behind_counts * encoder->rad_per_count) / encoder->period_s;
  encoder->behind_counts -= 2.0F * gain * encoder->behind_counts;
}

void crux_encoder_step(crux_encoder *encoder, uint32_t raw, bool valid) {
  if (!valid || (raw >= encoder->counts_per_turn)) {
    miss(encoder);
  } else if (!encoder->seen) {
    encoder->seen = true;
    encoder->raw = raw;
    encoder->counts = (int32_t)raw;
    encoder->missed = 0U;
  } else {
    const int32_t moved_counts = way(encoder, encoder->raw, raw);
    const float reach_counts = (((float)encoder->missed + 1.0F) * encoder->reach_counts) + NOISE_COUNTS;
    if (fabsf((float)moved_counts) > reach_counts) {
      miss(encoder);
    } else {
      observe(encoder, moved_counts);
      encoder->raw = raw;
      encoder->counts += moved_counts;
      encoder->missed = 0U;
    }
  }
}

/// What the rotor has turned since the last good sample was measured, at the speed known.
static float run_on_rad(const crux_encoder *encoder) {
  return (((float)encoder->missed * encoder->period_s) + encoder->age_s) * encoder->speed_rad_s;
}

float crux_encoder_position_rad(const crux_encoder *encoder) {
  return ((float)(encoder->counts + encoder->home_counts) * encoder->rad_per_count) + run_on_rad(encoder);
}

bool crux_encoder_home(crux_encoder *encoder, float rotor_rad, uint32_t zero_counts) {
  const int32_t zero = (int32_t)(zero_counts % encoder->counts_per_turn);
  const float turns = (rotor_rad - ((float)(encoder->counts - zero) * encoder->rad_per_count)) / TWO_PI;
  const float whole = roundf(turns);
  const bool clear = fabsf(turns - whole) <= HOMING_MAX_TURN;
  if (clear) {
    encoder->home_counts = ((int32_t)whole * (int32_t)encoder->counts_per_turn) - zero;
  }
  return clear;
}

void crux_encoder_restart(crux_encoder *encoder, uint32_t raw) {
  encoder->raw = raw;
  encoder->counts = (int32_t)raw;
  encoder->behind_counts = 0.0F;
  encoder->speed_rad_s = 0.0F;
  encoder->seen = true;
}

void crux_encoder_found(crux_encoder *encoder, bool homed) {
  encoder->found = homed ? (encoder->found + 1U) : 0U;
  if (encoder->found >= FOUND_TIMES) {
    encoder->found = 0U;
    encoder->missed = 0U;
    // The interrupt that uses the position may come at any time: all of it must be there before.
    atomic_signal_fence(memory_order_release);
    encoder->lost = false;
  }
}

float crux_encoder_coarse_rad(uint32_t raw, uint32_t zero_counts, uint32_t counts_per_turn, float middle_rad) {
  const uint32_t from_zero = (raw + counts_per_turn - (zero_counts % counts_per_turn)) % counts_per_turn;
  const float angle_rad = (float)from_zero * (TWO_PI / (float)counts_per_turn);
  return angle_rad - (TWO_PI * roundf((angle_rad - middle_rad) / TWO_PI));
}

float crux_encoder_electrical_rad(const crux_encoder *encoder, uint32_t pole_pairs, uint32_t offset_counts) {
  const uint32_t turn = encoder->counts_per_turn;
  const uint32_t from_zero = (encoder->raw + turn - (offset_counts % turn)) % turn;
  const uint32_t electrical = (from_zero * pole_pairs) % turn;
  float angle_rad = ((float)electrical * encoder->rad_per_count) + ((float)pole_pairs * run_on_rad(encoder));
  angle_rad -= TWO_PI * roundf(angle_rad / TWO_PI);
  return angle_rad;
}
