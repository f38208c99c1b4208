/// What a node believes and when it stops by itself. Small and apart from the control laws, so that it can be read in
/// one sitting: acceptance of frames (length, CRC, counter), acceptance of commands (known mode, finite, in range, not
/// limp) and of measurements, and the watchdog on the bus cycle.
#ifndef CRUX_FIRMWARE_SAFETY_H
#define CRUX_FIRMWARE_SAFETY_H

#include <stdbool.h>
#include <stdint.h>

#include "e2e.h"
#include "frame.h"
#include "parameters.h"

/// Counter check of one identifier: a frame counts when it is 1..window steps after the last one that did. After
/// `limit_us` without one the next valid frame is taken as it is: the sender may have restarted.
typedef struct crux_receiver {
  struct crux_e2e_receiver e2e;
  uint32_t silent_us;
  bool heard;     ///< since the last tick
  uint8_t whole;  ///< frames with a right CRC since the last valid Sync, byte-equal ones left out; whoever sent them
  uint8_t last[CRUX_FRAME_CAPACITY];  ///< the last one that counted
} crux_receiver;

/// Acceptance and watchdog of a node. A period is good when a valid Sync took over a valid command in it.
typedef struct crux_guard {
  crux_receiver sync;
  crux_receiver command;
  crux_receiver broadcast;
  uint32_t limit_us;   ///< silence that trips the watchdog: watchdog cycles times the bus period
  uint32_t silent_us;  ///< since the last good period, saturated at limit_us
  uint32_t alone_us;   ///< since a frame last showed a second sender, saturated at limit_us
  uint32_t cycle;      ///< of the last valid Sync; of a broadcast its low half
  uint8_t window;
  bool command_waiting;  ///< valid, waits for its Sync
  bool take;             ///< the last valid Sync took the waiting command over, the last broadcast its own
  bool command_fresh;    ///< taken over since the last tick
  bool answer_due;       ///< a Sync has not been answered with a status yet
  bool by_broadcast;     ///< the last valid Sync was a broadcast
} crux_guard;

typedef struct crux_joint_command {
  uint8_t mode;
  float position_rad;
  float velocity_rad_s;
  float torque_Nm;
  float position_gain_Nm_rad;
  float velocity_gain_Nms_rad;
  float asked_position_rad;  ///< before the clamp
  float asked_velocity_rad_s;
  bool position_clamped;  ///< by more than rounding explains
  bool velocity_clamped;
} crux_joint_command;

typedef struct crux_gripper_command {
  uint8_t mode;
  float opening_m;
  float speed_limit_m_s;
  float force_limit_N;
  float asked_opening_m;
  bool opening_clamped;
} crux_gripper_command;

void crux_guard_init(crux_guard *guard, uint32_t period_us, uint32_t watchdog_cycles);

/// Judges a Sync and takes the waiting command over. Returns the cause of rejection, CRUX_CAUSE_NONE when valid.
/// A host sends one command a Sync. Where more of them came, or broadcasts within the watchdog's time, somebody else
/// sends too and nobody knows whose command waits: none is taken over, and if that lasts the watchdog holds the node
/// where it is. Nor is one within the watchdog's time after a frame that shows a second sender.
uint8_t crux_guard_sync(crux_guard *guard, const crux_frame *frame);

/// Judges a command frame's length, CRC and counter. Returns the cause of rejection, CRUX_CAUSE_NONE when valid.
uint8_t crux_guard_command(crux_guard *guard, const crux_frame *frame, uint8_t length);

/// Judges a broadcast, which is command and Sync at once. `sensible`: its command for this node passed judgement; if
/// not, it still is a Sync. Returns the cause of rejection, CRUX_CAUSE_NONE when valid. A host that broadcasts sends
/// nothing else and moves the counter by one a frame. Where more frames came than the counter has steps, or commands
/// for single nodes within the watchdog's time, somebody else sends too: nothing is taken over.
uint8_t crux_guard_broadcast(crux_guard *guard, const crux_frame *frame, bool sensible);

/// Whether somebody commands the node: a good period, or a second sender, lies no longer back than the watchdog waits.
bool crux_guard_is_commanded(const crux_guard *guard);

/// Whether a second sender has shown within the watchdog's time: a whole frame came whose counter the last one that
/// counted had reached already, by no more than the window, and it is not that one again. One sender's counter only
/// grows, and what a bus delivers twice is the same to the byte.
bool crux_guard_has_rival(const crux_guard *guard);

/// Ends a control period. True in the one period in which the silence reaches the limit or, before that, a second
/// sender shows: whose command was taken over last is unknown.
bool crux_guard_tick(crux_guard *guard, uint32_t dt_us);

/// Decode a command that passed the guard and judge its content: CRUX_CAUSE_INVALID_COMMAND when the mode is unknown,
/// a number is not finite or a TRACK command would leave the joint (gripper) limp. What is out of range is clamped.
uint8_t crux_joint_command_accept(const crux_frame *frame, const crux_joint_parameters *parameters,
                                  crux_joint_command *command);
uint8_t crux_gripper_command_accept(const crux_frame *frame, const crux_gripper_parameters *parameters,
                                    crux_gripper_command *command);

/// As above, of a broadcast's part for a joint and for the gripper. Frames of another length are INVALID_COMMAND
/// too, and all for nodes above CRUX_CAN_BROADCAST_JOINTS, which have no part.
uint8_t crux_joint_broadcast_accept(const crux_frame *frame, uint8_t node, const crux_joint_parameters *parameters,
                                    crux_joint_command *command);
uint8_t crux_gripper_broadcast_accept(const crux_frame *frame, const crux_gripper_parameters *parameters,
                                      crux_gripper_command *command);

/// Whether a measurement can be one: within lower..upper, which not a number never is. What is further off than that is
/// a broken sensor, not a place, and would carry its nonsense into the torque.
bool crux_makes_sense(float measured, float lower, float upper);

/// Value limited to lower..upper.
float crux_clamp(float value, float lower, float upper);

#endif
