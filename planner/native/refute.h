/* A proof that no body pose at the goal lets limbs hold grips, one each, all at once. SI units. */
#ifndef CRUX_PLANNER_REFUTE_H
#define CRUX_PLANNER_REFUTE_H

#include <stdint.h>

#include "reach.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The body's x, y, z, yaw, roll and pitch in W: within bounds, place and angles within balls about a middle. `rates`,
 * row by row, makes a turn of roll, pitch and yaw. */
typedef struct {
  double low[6], high[6], middle[6], rates[9];
  double place_m, turn_rad;
} crux_refute_goal;

/* An upright grip of a limb whose joint limits are as they are and whose capsules are inside its links: the middle of
 * its last joint's range with the gripper's mount, and the cosine of half of it; the grip's centre, the direction along
 * its faces, and how far aside and how high a gripper may be there, with its fingers either way round. */
typedef struct {
  int64_t limb;
  const crux_reach_arm* arm;
  double last_middle_rad, cos_last_half;
  double centre_m[2], tangent[2], aside_m, height_m[2], yaw_rad;
} crux_refute_grip;

/* 1: no pose at the goal lets each limb that has grips hold one of them, within its joint limits, links off the trunk
 * and `clear_m` off those of the others; of two limbs only pairs of grips that `together` (count by count) allows.
 * 0: there is one. -1: not shown, `looks` at limbs and pairs of them in a box of poses were not enough, or
 * `seconds` of the process's time. */
__attribute__((visibility("default"))) int64_t crux_refute(const crux_refute_goal* goal, const crux_refute_grip* grips,
                                                           int64_t count, const uint8_t* together, double clear_m,
                                                           int64_t looks, double seconds);

#ifdef __cplusplus
}
#endif

#endif
