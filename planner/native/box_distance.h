/* Distances to boxes, crux_planner/checker/geometry.py. SI units. */
#ifndef CRUX_PLANNER_BOX_DISTANCE_H
#define CRUX_PLANNER_BOX_DISTANCE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Least signed distance (n) of segments from starts (n, 3) to ends (n, 3) to boxes of half extents (n, 3), each in its
 * box's centred frame. */
__attribute__((visibility("default"))) void crux_segment_to_box(int64_t n, const double* starts_m, const double* ends_m,
                                                                const double* halves_m, double* distances_m);

#ifdef __cplusplus
}
#endif

#endif
