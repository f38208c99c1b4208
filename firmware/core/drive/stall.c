#include "stall.h"

#include <math.h>
#include <stdbool.h>

#define STALL_FORCE 0.1F   ///< of the force limit
#define STALL_SPEED 0.05F  ///< of the speed limit
#define STALL_TIME_S 0.1F
#define END_TRAVEL 0.02F  ///< of the whole travel: so near to its end it is the end stop

void crux_stall_tick(crux_stall *stall, const crux_stall_parameters *parameters, float dt_s, float force_N,
                     float opening_m, float speed_m_s) {
  const bool pressing = fabsf(force_N) >= (STALL_FORCE * parameters->force_limit_N);
  const bool standing = fabsf(speed_m_s) <= (STALL_SPEED * parameters->speed_limit_m_s);
  stall->standing_s = (pressing && standing) ? fminf(stall->standing_s + dt_s, STALL_TIME_S) : 0.0F;
  if (stall->standing_s < STALL_TIME_S) {
    stall->kind = CRUX_STALL_NONE;
  } else {
    const float end_m = END_TRAVEL * (parameters->opening_max_m - parameters->opening_min_m);
    if ((force_N > 0.0F) && (opening_m <= (parameters->opening_min_m + end_m))) {
      stall->kind = CRUX_STALL_CLOSED_END;
    } else if ((force_N < 0.0F) && (opening_m >= (parameters->opening_max_m - end_m))) {
      stall->kind = CRUX_STALL_OPEN_END;
    } else {
      stall->kind = CRUX_STALL_OBJECT;
    }
  }
}
