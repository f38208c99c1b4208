/* States of the dynamic program of crux_planner/certificates/bound/timeline.py, and its steps between two knots. */
#ifndef CRUX_PLANNER_TIMELINE_H
#define CRUX_PLANNER_TIMELINE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CRUX_TIMELINE_LIMBS = 4 };

/* Options of each limb, the last of `many` being the air, where `ages` knots are told apart; least_air[option] knots
 * are in the air before a landing. */
typedef struct {
  int64_t many, ages;
  const int64_t* least_air;
} crux_timeline_options;

/* For each of `count` states in which a limb stands on a contact: what that state becomes when the limb releases, and
 * the states in the air from which it may land there: `landings` of them, `step` apart, that of the shortest swing
 * first. */
typedef struct {
  int64_t count;
  int32_t *standing, *lifted, *lands_from, *step, *landings;
} crux_timeline_limb;

/* States, those of a node side by side from first[node] to first[node + 1] - 1; `younger` and `older` are the states
 * with limbs in the air for a knot less and a knot more, `change` is the cost of a lift-off or a touch-down. */
typedef struct {
  int64_t states, nodes;
  int32_t *younger, *older, *first;
  double change;
  crux_timeline_limb limbs[CRUX_TIMELINE_LIMBS];
} crux_timeline;

/* Fills in all of a timeline but its numbers, for nodes (nodes, limbs) of options in ascending order. Less one of its
 * limbs, a node is a node too. */
__attribute__((visibility("default"))) void crux_timeline_states(const crux_timeline_options* options,
                                                                 const int64_t* nodes, crux_timeline* timeline);

/* From the least costs `value` of ways to the states at a knot: with the knot's own `cost` in `spent`, and of ways to
 * the states at the next knot in `next`. All (states). */
__attribute__((visibility("default"))) void crux_timeline_forward(const crux_timeline* timeline, const double* value,
                                                                  const double* cost, double* spent, double* next);

/* From the least costs `value` of ways onwards from the next knot, which are lost: of ways onwards from this one with
 * its own `cost` in `before`, and the least cost (nodes) of ways through each node, `spent` as forward has it. */
__attribute__((visibility("default"))) void crux_timeline_backward(const crux_timeline* timeline, double* value,
                                                                   const double* cost, const double* spent,
                                                                   double* before, double* least);

#ifdef __cplusplus
}
#endif

#endif
