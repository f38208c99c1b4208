/* Functions as lists of instructions, at many places at once, crux_planner/solvers/tape.py. */
#ifndef CRUX_PLANNER_TAPE_H
#define CRUX_PLANNER_TAPE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* work[to] = operation(work[first], work[second]); an input is element `second` of argument `first`, an output goes to
 * element `to` of result `second`. In the order of tape.py. */
enum {
  CRUX_TAPE_INPUT,
  CRUX_TAPE_OUTPUT,
  CRUX_TAPE_CONSTANT,
  CRUX_TAPE_COPY,
  CRUX_TAPE_ADD,
  CRUX_TAPE_SUBTRACT,
  CRUX_TAPE_MULTIPLY,
  CRUX_TAPE_DIVIDE,
  CRUX_TAPE_NEGATE,
  CRUX_TAPE_SQUARE,
  CRUX_TAPE_TWICE,
  CRUX_TAPE_INVERT,
  CRUX_TAPE_SQRT,
  CRUX_TAPE_SIN,
  CRUX_TAPE_COS,
  CRUX_TAPE_ATAN2,
  CRUX_TAPE_ABS,
  CRUX_TAPE_SIGN,
};

typedef struct {
  int64_t instructions, work; /* how many numbers work has */
  const int32_t *operation, *to, *first, *second;
  const double* constant; /* of each instruction */
} crux_tape;

/* Arguments and results (places, size), with their sizes. Returns 1, or 0 where an operation is not one of these. */
__attribute__((visibility("default"))) int crux_tape_run(const crux_tape* tape, int64_t places,
                                                         const double* const* arguments, const int64_t* sizes,
                                                         double* const* results, const int64_t* result_sizes);

#ifdef __cplusplus
}
#endif

#endif
