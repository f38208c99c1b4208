#include "direction.h"

#include <math.h>

#define PULSE_TICKS 10U
#define PART_TICKS \
  16U  ///< the pulse and what follows of it late, by current loop and tracking loop; the rest lasts as long
#define TRIES 6U
#define AGAINST 2U

/// Less change of the rotor's speed than this is noise of its encoder.
#define NOTICED_RAD_S 0.5F

void crux_direction_init(crux_direction *direction, float pulse_A) {
  *direction = (crux_direction){.pulse_A = pulse_A};
}

/// A pulse of the current that makes torque must turn the rotor its way.
static void judge_quadrature(crux_direction *direction, float answer_rad_s, float least_A) {
  if ((fabsf(answer_rad_s) >= NOTICED_RAD_S) && (fabsf(direction->charge_A) >= least_A)) {
    direction->response_rad_s_A = answer_rad_s / direction->charge_A;
    direction->forwards = direction->forwards || (direction->response_rad_s_A > 0.0F);
    direction->against += (direction->response_rad_s_A < 0.0F) ? 1U : 0U;
  }
}

/// One along the magnets must not turn it by more than the loop's own current explains.
static void judge_direct(crux_direction *direction, float answer_rad_s, float least_A) {
  const float unexplained_rad_s = fabsf(answer_rad_s - (direction->response_rad_s_A * direction->charge_A));
  const bool moved = unexplained_rad_s >= fmaxf(NOTICED_RAD_S, fabsf(direction->response_rad_s_A) * least_A);
  direction->still = direction->still || !moved;
  direction->against += moved ? 1U : 0U;
}

/// At the end of a try.
static void judge(crux_direction *direction, float rest_change_rad_s) {
  const float answer_rad_s = direction->pulse_change_rad_s - rest_change_rad_s;
  const float least_A = 0.5F * (float)PULSE_TICKS * fabsf(direction->pulse_A);
  if (direction->loaded) {
    // what moves it is not the pulse
  } else if (direction->direct) {
    judge_direct(direction, answer_rad_s, least_A);
  } else {
    judge_quadrature(direction, answer_rad_s, least_A);
  }
  direction->tries++;
  direction->direct = !direction->direct;
  direction->ticks = 0U;
  if (direction->against == AGAINST) {
    direction->verdict = CRUX_DIRECTION_WRONG;
  } else if (direction->forwards && direction->still) {
    direction->verdict = CRUX_DIRECTION_RIGHT;
  } else if (direction->tries == TRIES) {
    direction->verdict = CRUX_DIRECTION_UNCHECKED;
  } else {
    // again
  }
}

float crux_direction_tick(crux_direction *direction, float rotor_speed_rad_s, float flowed_A, float wanted_A) {
  float added_A = 0.0F;
  if (direction->verdict == CRUX_DIRECTION_ASKED) {
    if (direction->ticks == 0U) {
      direction->speed_rad_s = rotor_speed_rad_s;
      direction->charge_A = 0.0F;
      direction->loaded = false;
    } else {
      direction->charge_A += (direction->ticks <= PART_TICKS) ? flowed_A : -flowed_A;
    }
    if (direction->ticks == PART_TICKS) {
      direction->pulse_change_rad_s = rotor_speed_rad_s - direction->speed_rad_s;
      direction->speed_rad_s = rotor_speed_rad_s;
    }
    direction->loaded = direction->loaded || (fabsf(wanted_A) > fabsf(direction->pulse_A));
    added_A = (direction->ticks < PULSE_TICKS) ? direction->pulse_A : 0.0F;
    direction->ticks++;
    if (direction->ticks > (2U * PART_TICKS)) {
      judge(direction, rotor_speed_rad_s - direction->speed_rad_s);
    }
  }
  return added_A;
}
