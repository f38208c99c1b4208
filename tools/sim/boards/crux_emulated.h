/// Emulated node boards as a shared library with a plain C interface: each runs the real image for the Cortex-M4F. They
/// take the place of nodes in crux_nodes (crux_nodes_replace), on the same bus. One thread at a time.
#ifndef CRUX_EMULATED_H
#define CRUX_EMULATED_H

#include <stdint.h>

#include "cortex_cycles.h"
#include "emulated_node.h"

#define CRUX_API __attribute__((visibility("default")))

/// A board with the image at `path`; limb 0..3, node 1..7. NULL on failure, crux_emulated_error() says why.
CRUX_API emulated_node *crux_emulated_open(const char *image, int limb, int node, const emulated_world *world);
CRUX_API void crux_emulated_close(emulated_node *node);

/// Reason of the last failure in this thread.
CRUX_API const char *crux_emulated_error(void);

/// Power comes on with the shaft at `position` [rad, m], and the board boots. Otherwise the first control period does
/// it.
CRUX_API void crux_emulated_power_on(emulated_node *node, double position);

/// What crux_nodes_replace takes; lives as long as the board.
CRUX_API const crux_outside_node *crux_emulated_port(emulated_node *node);

/// What the image did wrong first (an access to nothing, an instruction that is none), "" when it did not.
CRUX_API const char *crux_emulated_fault(const emulated_node *node);

/// Instructions and cycles since power-on.
CRUX_API uint64_t crux_emulated_instructions(const emulated_node *node);

/// Bounds of the cycles of an instruction, see cortex_cycles.h.
CRUX_API cortex_cycles crux_emulated_cycles(uint16_t first, uint16_t second);

/// While on, bounds of the cycles are counted; a board is slower then.
CRUX_API void crux_emulated_measure(emulated_node *node, int on);

/// Cost of an exception's handler: 15 SysTick, 16 + n interrupt n; 0 the main loop from one sleep to the next.
CRUX_API cortex_cost crux_emulated_cost(const emulated_node *node, uint32_t exception);

// A board by itself, without crux_nodes, and what can be done to it.

/// A control period of dt seconds in which the shaft goes to `position` [rad, m]; joint torque [Nm] or drive force of a
/// finger [N].
CRUX_API double crux_emulated_control(emulated_node *node, double dt, double position);

/// A frame of at most CRUX_FRAME_CAPACITY bytes at the start of the next period.
CRUX_API void crux_emulated_hear(emulated_node *node, uint16_t id, const uint8_t *data, int length);

/// `count` of such frames in the FIFO at once, now; see fdcan_model_flood.
CRUX_API void crux_emulated_flood(emulated_node *node, uint16_t id, const uint8_t *data, int length, int count);

/// While on, no frame passes between the board and its bus: sending is an error each time, until the controller is off.
CRUX_API void crux_emulated_disturb(emulated_node *node, int on);

/// While on, the motor's encoder does not answer.
CRUX_API void crux_emulated_break_encoder(emulated_node *node, int on);

/// The motor's encoder finds an error in a command.
CRUX_API void crux_emulated_flag_encoder(emulated_node *node);

/// The amplifier of phase 0 (a) or 1 (b) says so many amperes, whatever flows; not a number: it works.
CRUX_API void crux_emulated_stick_amplifier(emulated_node *node, int phase, double current_A);

/// Phases b and c of the motor are swapped (or not).
CRUX_API void crux_emulated_swap_phases(emulated_node *node, int on);

/// The magnets are so far from where the calibration has them [rad electrical].
CRUX_API void crux_emulated_turn_magnets(emulated_node *node, double electrical_rad);

/// The board has never been calibrated; before its power comes on.
CRUX_API void crux_emulated_blank(emulated_node *node);

/// While on, the gate driver reports a fault: it pulls the timer's break input.
CRUX_API void crux_emulated_break_driver(emulated_node *node, int on);

/// A register of FDCAN1, by its offset.
CRUX_API uint32_t crux_emulated_can_register(const emulated_node *node, uint32_t offset);

// Its flash.

/// The power fails in the `operation`th write or erase from now on, before, within or after it (crux_flash_cut), and
/// stays off until the board is restarted. 0: never.
CRUX_API void crux_emulated_cut_power(emulated_node *node, uint32_t operation, int cut);

/// Writes and erases are recorded from now on; 0 when there is no memory for that.
CRUX_API int crux_emulated_record(emulated_node *node);

/// How many so far.
CRUX_API uint32_t crux_emulated_recorded(const emulated_node *node);

/// Makes the flash as if the power had failed in one of them, counted from 1; then crux_emulated_power_on.
CRUX_API void crux_emulated_replay(emulated_node *node, uint32_t operation, int cut);

/// The programs in the flash's slots are those of this ELF file, where the board's state is looked up.
CRUX_API void crux_emulated_look_into(emulated_node *node, const char *program);

/// Address of the vectors of the program that runs.
CRUX_API uint32_t crux_emulated_vectors(const emulated_node *node);

#endif
