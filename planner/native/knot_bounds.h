/* What the body's part of a knot costs at least, of crux_planner/certificates/bound/multipliers.py. */
#ifndef CRUX_PLANNER_KNOT_BOUNDS_H
#define CRUX_PLANNER_KNOT_BOUNDS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Least and most (2, 3) of where the centre of mass is off the body's origin, the largest mass times acceleration along
 * an axis, and the largest moment of what turns. */
typedef struct {
  double offset_m[6], push_N, spin_Nm;
} crux_knot_accelerations;

/* Costs of headings by cells of yaw, least costs (tilts) and shifts (tilts) of the body by tilts; the body's weight and
 * goal along the axes, and the weight of its distance from there. */
typedef struct {
  crux_knot_accelerations accelerations;
  int64_t tilts;
  const double *yaw_cost, *tilt_cost, *shift_m;
  double weight_N[3], goal_m[3], distance;
} crux_knot;

/* Bodies in boxes low, high (pairs, 3) and in `box` (2, 3) too, unless that is null, in cells of yaw; the centre of
 * mass moves by `follow` (pairs, 3) of the body's way, and rests at (pairs, tilts, 2, 3) off it, one for all where
 * `one_rest`. Multipliers of force and moment (pairs, 6), one for all where `one_multiplier`. */
typedef struct {
  int64_t pairs, one_multiplier, one_rest;
  const double *low, *high, *box, *follow, *rest, *multipliers;
  const int64_t* cell;
} crux_knot_pairs;

/* What accelerations add at most (n), for bodies in boxes low, high (n, 3) and multipliers (n, 6). */
__attribute__((visibility("default"))) void crux_knot_most(const crux_knot_accelerations* accelerations, int64_t n,
                                                           const double* multipliers, const double* low,
                                                           const double* high, double* most);

/* Least costs (pairs), inf where a body is nowhere. */
__attribute__((visibility("default"))) void crux_knot_least(const crux_knot* knot, const crux_knot_pairs* pairs,
                                                            double* least);

#ifdef __cplusplus
}
#endif

#endif
