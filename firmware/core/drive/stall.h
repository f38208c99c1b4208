/// Why the fingers stand still under force: an object between them, or an end of their travel.
#ifndef CRUX_FIRMWARE_DRIVE_STALL_H
#define CRUX_FIRMWARE_DRIVE_STALL_H

enum crux_stall_kind { CRUX_STALL_NONE, CRUX_STALL_OBJECT, CRUX_STALL_CLOSED_END, CRUX_STALL_OPEN_END };

typedef struct crux_stall {
  float standing_s;
  enum crux_stall_kind kind;
} crux_stall;

typedef struct crux_stall_parameters {
  float opening_min_m;
  float opening_max_m;
  float speed_limit_m_s;
  float force_limit_N;
} crux_stall_parameters;

/// One control period: `force_N` is what the motor presses with (positive closes). The fingers have stalled when they
/// stand still for a while under a noticeable force; near an end of their travel that is the end stop, elsewhere an
/// object.
void crux_stall_tick(crux_stall *stall, const crux_stall_parameters *parameters, float dt_s, float force_N,
                     float opening_m, float speed_m_s);

#endif
