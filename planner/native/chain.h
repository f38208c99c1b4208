/* Inverse kinematics of a chain of revolute joints for many gripper poses: the numeric one of
 * crux_planner/model/chain.py with the same steps. SI units, body frame. */
#ifndef CRUX_PLANNER_CHAIN_H
#define CRUX_PLANNER_CHAIN_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CRUX_CHAIN_POSE = 6, CRUX_CHAIN_MOST = 7 };

/* A chain of `slots` joints with all of them at zero, 6 or 7, and what Newton's method goes by. */
typedef struct {
  const double *axes, *points_m;      /* slots x 3 */
  double gripper_m[3], rotation[9];   /* of the gripper, row by row */
  const double *rule, *middle_rad;    /* (slots - 6) x slots: of angles off the middle what is to be 0; slots */
  double sign;                        /* of the Jacobian's determinant on the branch */
  double close, damping, largest_rad; /* error of a pose that is reached; of an error of 1; a step */
  int64_t slots, iterations;
} crux_chain;

/* From angles (n, slots) to those of poses: places (n, 3), rotations (n, 9) row by row. Writes 1 for every pose that is
 * reached on the branch, else 0. */
__attribute__((visibility("default"))) void crux_chain_inverse(const crux_chain* chain, int64_t poses,
                                                               const double* places_m, const double* rotations,
                                                               double* angles_rad, uint8_t* reached);

#ifdef __cplusplus
}
#endif

#endif
