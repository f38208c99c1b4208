/// A node board: chip, image, straps, bridge, motor, sensors. Joint (node 1..6 or 8) or gripper (7).
///
/// Time. Each control period of the bench is a window of as many core cycles. In it the frames heard since the last
/// window arrive one after another, each taking its time on the bus. The shaft goes from where the bench last saw it to
/// where it sees it now, at constant speed: this is how a semi-implicit integrator has moved it in that period, so the
/// sensors never jump; they are one period behind at the window's start and up to date at its end. The mean of the
/// motor's torque over the window goes to the bench.
#ifndef CRUX_EMULATED_NODE_H
#define CRUX_EMULATED_NODE_H

#include "board_sensors.h"
#include "motor_model.h"
#include "outside_node.h"
#include "stm32g4.h"

#define EMULATED_GRIPPER 7
#define EMULATED_LAST 8
#define EMULATED_INBOX 128U

/// Numbers of the robot that surround the chip. The shaft's position is the joint's angle [rad] or the fingers'
/// opening [m].
typedef struct emulated_world {
  double bit_rate;
  double data_bit_rate;
  double pole_pairs;
  double resistance_ohm;
  double inductance_H;
  double flux_Wb;
  double supply_V;
  double zero_position;          ///< where rotor and coarse encoder count from
  double rotor_turns_per_unit;   ///< of the motor a unit of the position
  double coarse_turns_per_unit;  ///< of the coarse encoder
  double effort_per_Nm;          ///< joint torque [Nm], drive force of a finger [N] by rotor torque
} emulated_world;

/// How the board was mounted, as its calibration page says.
typedef struct emulated_mounting {
  uint32_t electrical_offset_counts;
  uint32_t rotor_zero_counts;
  uint32_t coarse_zero_counts;
  uint32_t phase_zero_counts[2];
} emulated_mounting;

typedef struct emulated_node {
  stm32g4 chip;
  crux_outside_node port;  ///< the node's functions for the bench; the context is the node
  emulated_world world;
  emulated_mounting mounting;
  motor_model motor;
  magnetic_encoder rotor_encoder;
  magnetic_encoder coarse_encoder;
  bool encoder_broken;        ///< of the rotor: its line stays high
  bool phases_swapped;        ///< of the motor: b and c
  double magnets_turned_rad;  ///< electrical, from where the calibration has them
  double stuck_A[2];          ///< what the amplifiers of phases a and b say; NAN: the current
  int limb;
  int node;
  bool powered;
  crux_frame heard[EMULATED_INBOX];  ///< since the last window
  uint32_t heard_count;
  bool controlled;  ///< a period has passed since frames were last fetched
  double dt;        ///< of the last period
  uint64_t window_start;
  uint64_t window_end;
  double from;  ///< position at the window's start
  double to;
  uint64_t stepped_at;  ///< until when the motor's current is known
  double angle_rad;     ///< electrical, then
  double torque_time;   ///< integral of the rotor's torque over the window [Nm cycles]
  double temperature_degC;
  bool wrench_asked;      ///< the force/torque sensor sends samples
  uint64_t wrench_at;     ///< when the next one is due
  const uint8_t *object;  ///< crux_joint_node or crux_gripper_node in the image's memory, NULL: unknown
} emulated_node;

/// Builds the board around the image; NULL with the reason in `error`. Without emulated_node_power_on the power comes
/// with the first control period.
emulated_node *emulated_node_new(const char *image, int limb, int node, const emulated_world *world, char *error,
                                 size_t error_bytes);
void emulated_node_delete(emulated_node *node);

/// Power comes on with the shaft at `position`; the board boots.
void emulated_node_power_on(emulated_node *node, double position);

/// The board has never been calibrated. Takes effect when the power comes on.
void emulated_node_blank(emulated_node *node);

/// The board runs the program of another ELF file than the one its flash was filled from: states are looked up there.
void emulated_node_look_into(emulated_node *node, const char *image);

#endif
