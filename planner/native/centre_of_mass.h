/* Where the centre of mass can be about body and grippers, of crux_planner/certificates/bound/centre_of_mass.py. */
#ifndef CRUX_PLANNER_CENTRE_OF_MASS_H
#define CRUX_PLANNER_CENTRE_OF_MASS_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CRUX_MASS_LIMBS = 4, CRUX_MASS_ENDS = 5 };

/* What a limb adds, by cells of `cell_m` of how far out its wrist is: `ends` (tilts, cells, cells, CRUX_MASS_ENDS) from
 * the first to the last cell: least and most outwards, least and most up [kg m], and how far outwards is turned by a
 * tilt. `height` (tilts) is how far the wrist is at most from the shoulder along z [m]. */
typedef struct {
  int64_t cells;
  const double *ends, *height;
} crux_mass_table;

/* `tables` on a contact and in the air; the shoulder (yaws, 2) off the body's origin by cells of yaw, how far off that
 * it can be (yaws), and least and most (options, 3) of the gripper's place by options, of which the last is the air. */
typedef struct {
  crux_mass_table tables[2];
  int64_t options;
  const double *shoulder, *wide, *least, *most;
} crux_mass_limb;

/* `own` (tilts, 2, 3) of the body [kg m]; cosine and sine of the tilts, and what a tilt turns aside [kg m], (tilts);
 * `shift_m` is how far a tilt moves the body. */
typedef struct {
  crux_mass_limb limbs[CRUX_MASS_LIMBS];
  int64_t tilts;
  const double *own, *cosine, *sine, *aside;
  double cell_m, shift_m, mass_kg;
} crux_masses;

/* Bounds (pairs, tilts, 2, 3) [m] for bodies in boxes low, high (pairs, 3), limbs on options (nodes, limbs) of the node
 * of each pair, and cells of yaw; least above most where no limb reaches so. */
__attribute__((visibility("default"))) void crux_mass_bounds(const crux_masses* masses, int64_t pairs,
                                                             const double* low, const double* high, const int64_t* node,
                                                             const int64_t* cell, const int64_t* options,
                                                             double* bounds);

#ifdef __cplusplus
}
#endif

#endif
