/* The Newton system of crux_planner/trajectory/interior_point.py: a chain of knots, at each of which columns, one a
 * limb, meet the rest only through the state there. */
#ifndef CRUX_PLANNER_STAGE_SYSTEM_H
#define CRUX_PLANNER_STAGE_SYSTEM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* States of the body, numbers of a column, and how many of these act on the body: the first. */
enum { CRUX_STAGE_LIMBS = 4, CRUX_STAGE_STATES = 12, CRUX_STAGE_COLUMN = 8, CRUX_STAGE_ACTING = 5 };

/* Second derivatives by states (knots + 1, 12, 12), columns (knots, 4, 8, 8) and both (knots, 4, 12, 8), and what
 * states (knots, 12, 12) and columns (knots, 4, 12, 8) do to the next states. */
typedef struct {
  int64_t knots;
  const double *state_hessian, *column_hessian, *cross, *state_map, *into_state;
} crux_stages;

/* How many numbers the factors of a knot have. */
__attribute__((visibility("default"))) int64_t crux_stage_factors(void);

/* Writes the factors of all knots. Returns 1, or 0 where a column's Hessian is singular. */
__attribute__((visibility("default"))) int crux_stage_factor(const crux_stages* stages, double* factors);

/* Steps of states (knots + 1, 12), the first 0, and columns (knots, 4, 8), and multipliers (knots, 12) of the dynamics,
 * for slopes by both and defects (knots, 12) of the dynamics. */
__attribute__((visibility("default"))) void crux_stage_solve(const crux_stages* stages, const double* factors,
                                                             const double* state_slope, const double* column_slope,
                                                             const double* defects, double* states, double* columns,
                                                             double* multipliers);

#ifdef __cplusplus
}
#endif

#endif
