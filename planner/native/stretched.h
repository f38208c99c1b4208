/* Boxes of the body within stretched limbs' lengths, of crux_planner/certificates/bound/grasps.py. */
#ifndef CRUX_PLANNER_STRETCHED_H
#define CRUX_PLANNER_STRETCHED_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CRUX_STRETCHED_LIMBS = 4 };

/* Of `options` groups of contacts, least and most (options, 2) of their places; by cells of yaw the shoulder (yaws, 2)
 * off the body's origin and the square of how far from the wrist it can be (yaws). */
typedef struct {
  int64_t options;
  const double *least, *most, *shoulder, *squared_m;
} crux_stretched_limb;

/* Narrows boxes low, high (pairs, 3) along x and y, where limbs are on options (nodes, limbs) of the node of each pair,
 * in cells of yaw. Tilts move bodies by `least_m` at the least, by `most_m` at the most. */
__attribute__((visibility("default"))) void crux_stretched(const crux_stretched_limb* limbs, double least_m,
                                                           double most_m, int64_t pairs, const int64_t* node,
                                                           const int64_t* cell, const int64_t* options, double* low,
                                                           double* high);

#ifdef __cplusplus
}
#endif

#endif
