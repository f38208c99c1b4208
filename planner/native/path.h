/* Body paths of least cost on static balance, crux_planner/solvers/path.py: a convex quadratic program over the body's
 * places at nodes in time and the wrenches of the grippers that carry it there. SI units, wall frame. */
#ifndef CRUX_PLANNER_PATH_H
#define CRUX_PLANNER_PATH_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CRUX_PATH_GRIP = 6 };

/* What a gripper bears, as numbers q (6): limits @ q <= right, low <= q <= high; map @ q (6, its forces and moments) is
 * its part of the balance, effort . q^2 what it costs. Matrices row by row. */
typedef struct {
  int64_t rows;
  const double *limits, *right, *low, *high, *map, *effort;
} crux_path_grip;

/* Over the places p[k] (3) of K nodes and the numbers q of the grips on[first[k]] to on[first[k + 1] - 1] of each:
 * the least sum of pull[k] |p[k] - target|^2, speed[k] |p[k + 1] - p[k]|^2 and carried[k] times the grips' efforts,
 * where low[k] <= directions @ p[k] <= high[k], (K, m), of which the first three directions are the axes,
 * |p[k + 1] - p[k]| <= step[k] along each axis, and body[k] @ p[k], (6, 3), and the grips' parts sum to weight[k] (6).
 */
typedef struct {
  int64_t nodes, directions;
  const double *direction, *low, *high, *target, *pull, *speed, *step, *carried, *body, *weight;
  const int64_t *first, *on;
} crux_path_problem;

/* Writes the places (K, 3) and the numbers of all grips in order. Returns 1, or 0 where it does not converge: mostly
 * because nothing is within the limits. */
__attribute__((visibility("default"))) int crux_path_solve(const crux_path_grip* grips,
                                                           const crux_path_problem* problem, double* places,
                                                           double* wrenches);

#ifdef __cplusplus
}
#endif

#endif
