/// A node board with its microcontroller: chip, image, straps, sensors, motor driver. Joint (node 1..6) or gripper (7).
///
/// Time. Each control period of the bench is a window of as many core cycles. In it the frames heard since the last
/// window arrive one after another, each taking its time on the bus. The shaft goes from where the bench last saw it to
/// where it sees it now, at constant speed: this is how a semi-implicit integrator has moved it in that period, so the
/// sensors never jump; they are one period behind at the window's start and up to date at its end.
#ifndef CRUX_EMULATED_NODE_H
#define CRUX_EMULATED_NODE_H

#include "outside_node.h"
#include "parameters.h"
#include "stm32g4.h"

#define EMULATED_GRIPPER 7
#define EMULATED_INBOX 64U

/// Numbers of the robot that the world around the chip has.
typedef struct emulated_world {
  double bit_rate;
  double data_bit_rate;
  double torque_limit_Nm;  ///< joints: of the driver at full duty
  double force_limit_N;    ///< grippers: as above, a finger
  double opening_min_m;    ///< grippers: ends of the potentiometer's travel
  double opening_max_m;
} emulated_world;

typedef struct emulated_node {
  stm32g4 chip;
  crux_outside_node port;  ///< the node's functions for the bench; the context is the node
  emulated_world world;
  int limb;
  int node;
  bool powered;
  crux_frame heard[EMULATED_INBOX];  ///< since the last window
  uint32_t heard_count;
  uint64_t window_start;
  uint64_t window_end;
  double from;  ///< position at the window's start [rad, m]
  double to;
  double temperature_degC;
  uint8_t state;  ///< of the last status
  uint8_t faults;
} emulated_node;

/// Builds the board around the image; NULL with the reason in `error`. The power comes with the first control period.
emulated_node *emulated_node_new(const char *image, int limb, int node, const emulated_world *world, char *error,
                                 size_t error_bytes);
void emulated_node_delete(emulated_node *node);

#endif
