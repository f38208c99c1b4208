/// A node whose firmware runs somewhere else than in this library, on an emulated microcontroller for instance, but on
/// the same bus and in the same bench. All calls come from one thread.
#ifndef CRUX_OUTSIDE_NODE_H
#define CRUX_OUTSIDE_NODE_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"

/// What the plant gives a node: of a joint [rad, rad/s] or of a gripper's fingers [m, m/s].
typedef struct crux_measured {
  double position;
  double velocity;
  double wrench[6];  ///< grippers: fx fy fz [N] mx my mz [Nm] of the world on the gripper, gripper frame
} crux_measured;

typedef struct crux_outside_node {
  void *context;
  /// A frame has come on the bus, whoever it is for.
  void (*hear)(void *context, const crux_frame *frame);
  /// One control period of dt seconds; joint torque [Nm] or finger force [N], positive closes.
  double (*control)(void *context, double dt, const crux_measured *measured);
  /// Pops a frame the node has sent; false when there is none.
  bool (*fetch)(void *context, crux_frame *frame);
  /// Power off and on.
  void (*restart)(void *context);
  void (*set_temperature)(void *context, double temperature_degC);
  /// While on, no frame passes between the node's controller and the bus; it counts errors and goes off.
  void (*disturb)(void *context, bool on);
  /// Its state and fault bits now; BOOT before its firmware has begun.
  void (*state)(void *context, uint8_t *state, uint8_t *faults);
} crux_outside_node;

#endif
