/* Whether a limb reaches gripper poses, off its joint limits and off the trunk, and where its links are: the inner map
 * of crux_planner/reach/arm.py with the same operations in the same order. SI units, body frame. */
#ifndef CRUX_PLANNER_REACH_H
#define CRUX_PLANNER_REACH_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CRUX_REACH_INPUTS = 12, CRUX_REACH_AXES = 6 };

/* A range of directions: those with x * cos_middle + y * sin_middle >= length * cos_half. */
typedef struct {
  double cos_middle, sin_middle, cos_half;
} crux_reach_sector;

/* A cuboid of the trunk; the columns of `rotation` are its axes, row by row. */
typedef struct {
  double centre_m[3], rotation[9], half_m[3];
} crux_reach_box;

/* A link's capsule in a frame: 0 to 3 links 2 to 5, 4 the gripper, 5 link 1. */
typedef struct {
  double start_m[3], end_m[3], radius_m;
  int64_t frame;
} crux_reach_capsule;

typedef struct {
  double shoulder_m[3], upper_m, lower_m, wrist_to_gripper_m;
  double least_radius_m;
  double cos_elbow[2], sin_roll[2]; /* least and most */
  crux_reach_sector azimuth, upper, pitch;
  double clear_m;
  const crux_reach_box* trunk;
  const crux_reach_capsule* links;
  int64_t boxes, capsules, all_capsules; /* of `links`, the first `capsules` may meet the trunk */
} crux_reach_arm;

/* Poses as arrays of 6 axes, by their strides in numbers (0 where an array is the same along an axis): x, y, z, cosine
 * and sine of roll, of pitch and of yaw, and the sector of joint 6. */
typedef struct {
  const double* values[CRUX_REACH_INPUTS];
  int64_t strides[CRUX_REACH_INPUTS][CRUX_REACH_AXES];
  int64_t shape[CRUX_REACH_AXES];
} crux_reach_poses;

/* Writes 1 for every pose that is reached, else 0, the last axis fastest. */
__attribute__((visibility("default"))) void crux_reach(const crux_reach_arm* arm, const crux_reach_poses* poses,
                                                       uint8_t* reached);

/* Writes the ends of all capsules, whether the pose is reached or not: pose by pose, capsule by capsule, x, y and z. */
__attribute__((visibility("default"))) void crux_reach_links(const crux_reach_arm* arm, const crux_reach_poses* poses,
                                                             double* starts, double* ends);

/* All capsules of one limb at some poses: ends as above, radii, and 1 for what belongs to the gripper. */
typedef struct {
  const double *starts, *ends, *radius_m;
  const uint8_t* hand;
  int64_t count;
} crux_reach_capsules;

/* Writes 1 for every pose at which two limbs keep off each other by a clearance, else 0; unless `hands`, one gripper
 * may be in the other. */
__attribute__((visibility("default"))) void crux_reach_apart(const crux_reach_capsules* one,
                                                             const crux_reach_capsules* two, int64_t poses,
                                                             double clear_m, int64_t hands, uint8_t* apart);

/* Writes 1 for every pose of the body, its origin (3) and its axes (9, row by row), at which a limb's capsules but
 * those of the gripper keep off all boxes by a clearance, else 0; boxes in the axes that poses are in. */
__attribute__((visibility("default"))) void crux_reach_off_boxes(const crux_reach_capsules* links, int64_t poses,
                                                                 const double* origins, const double* axes,
                                                                 const crux_reach_box* boxes, int64_t count,
                                                                 double clear_m, uint8_t* off);

/* Numbers the connected parts of the cells of a grid, the last axis fastest, from 1 on in the order of their first
 * cells; 0 outside. Cells next to each other along one axis are connected. Returns how many there are. */
__attribute__((visibility("default"))) int64_t crux_reach_parts(int64_t axes, const int64_t* shape,
                                                                const uint8_t* inside, int64_t* numbers);

#ifdef __cplusplus
}
#endif

#endif
