/* Inverse kinematics of crux_planner/checker/inverse_kinematics.py: an arm whose joints turn about z of their own
 * frames, for many poses of its end. SI units. */
#ifndef CRUX_PLANNER_INVERSE_KINEMATICS_H
#define CRUX_PLANNER_INVERSE_KINEMATICS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CRUX_ARM_MOST = 7 };

/* Up to 7 joints. Rotations row by row. */
typedef struct {
  int64_t joints, spares;
  const double* turns;      /* (joints - 1, 9) from each joint's frame to the next one's */
  const double* offsets_m;  /* (joints, 3) from each joint to the next, and to the end, in the frame of the former */
  const double* middle_rad; /* (joints) of the joints' ranges */
  const double* spare;      /* (spares, joints): what of angles off the middle is to be 0, at most one row */
} crux_arm;

/* Where angles (n, joints) place the end: positions (n, 3), rotations (n, 9), and Jacobians (n, 6, joints) of rows v,
 * omega. */
__attribute__((visibility("default"))) void crux_arm_place(const crux_arm* arm, int64_t n, const double* angles_rad,
                                                           double* positions_m, double* rotations, double* jacobians);

/* From angles (n, joints) to those of poses (n, 3), (n, 9); what is left (n, 2) of position and orientation. */
__attribute__((visibility("default"))) void crux_arm_reach(const crux_arm* arm, int64_t n, const double* positions_m,
                                                           const double* rotations, double* angles_rad, double* left);

#ifdef __cplusplus
}
#endif

#endif
