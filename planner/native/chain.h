/* Inverse kinematics of a chain of revolute joints for many gripper poses, and what it reaches off joint limits and
 * trunk: the numeric ones of crux_planner/model/chain.py and crux_planner/reach/chain_reach.py with the same steps. SI
 * units, body frame. */
#ifndef CRUX_PLANNER_CHAIN_H
#define CRUX_PLANNER_CHAIN_H

#include <stdint.h>

#include "reach.h"

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

/* Postures of upright grippers to start from, at nodes about a place: 2 half + 1 along x, y and z, and `turns` yaws. */
typedef struct {
  const double* angles_rad; /* x, y, z, yaw, slot; NaN where the branch has none near by */
  double middle_m[3], step_m;
  int64_t half, turns;
} crux_chain_lattice;

/* A limb with what it keeps off. Frames of capsules: the link behind that joint, from 0; the gripper's is -1. */
typedef struct {
  crux_chain chain;
  crux_chain_lattice lattice;
  const double *lower_rad, *upper_rad, *margin_rad, *rotations; /* slots; of the links at zero (slots x 9) */
  double clear_m;
  const crux_reach_box* trunk;
  const crux_reach_capsule* links;
  int64_t boxes, capsules, all_capsules; /* of `links`, the first `capsules` may meet the trunk */
} crux_chain_limb;

/* From angles (n, slots) to those of poses: places (n, 3), rotations (n, 9) row by row. Writes 1 for every pose that is
 * reached on the branch, else 0. */
__attribute__((visibility("default"))) void crux_chain_inverse(const crux_chain* chain, int64_t poses,
                                                               const double* places_m, const double* rotations,
                                                               double* angles_rad, uint8_t* reached);

/* The same from the lattice; where that has nothing to start from, the angles are those of the middle. */
__attribute__((visibility("default"))) void crux_chain_found(const crux_chain* chain, const crux_chain_lattice* lattice,
                                                             int64_t poses, const double* places_m,
                                                             const double* rotations, double* angles_rad,
                                                             uint8_t* reached);

/* Inverse Jacobians (n, slots, 6) at angles (n, slots), damped by so much (n). */
__attribute__((visibility("default"))) void crux_chain_back(const crux_chain* chain, int64_t postures,
                                                            const double* angles_rad, const double* damping,
                                                            double* back);

/* Writes 1 for every pose that the limb reaches off its limits by the margin and off the trunk by the clearance, else
 * 0, the last axis fastest. The poses have no sector of joint 6. */
__attribute__((visibility("default"))) void crux_chain_reaches(const crux_chain_limb* limb,
                                                               const crux_reach_poses* poses, uint8_t* reached);

/* Writes the ends of all capsules, whether the pose is reached or not: pose by pose, capsule by capsule, x, y and z. */
__attribute__((visibility("default"))) void crux_chain_links(const crux_chain_limb* limb, const crux_reach_poses* poses,
                                                             double* starts, double* ends);

#ifdef __cplusplus
}
#endif

#endif
