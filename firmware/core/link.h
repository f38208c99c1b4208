/// A node's side of the bus: who it is, its transmit queue, and the frames that joints and grippers send alike
/// (identity, heartbeat, emergency) or hear alike (Sync, broadcast). Every frame leaves with its own E2E counter and
/// CRC.
#ifndef CRUX_FIRMWARE_LINK_H
#define CRUX_FIRMWARE_LINK_H

#include <stdbool.h>
#include <stdint.h>

#include "codec.h"
#include "frame.h"
#include "health.h"
#include "safety.h"

/// 0.1.0, two digits a part.
#define CRUX_FIRMWARE_VERSION 0x000100U

#define CRUX_HEARTBEAT_PERIOD_US 100000U
/// Shortest time between two emergency frames of one cause.
#define CRUX_EMERGENCY_PERIOD_US 100000U
#define CRUX_QUEUE_LENGTH 16U

/// The kinds of frames a node sends, each with a counter of its own.
typedef enum crux_sent {
  CRUX_SENT_EMERGENCY,
  CRUX_SENT_STATUS,
  CRUX_SENT_FORCE_TORQUE,
  CRUX_SENT_ANSWER,
  CRUX_SENT_HEARTBEAT,
  CRUX_SENT_IDENTITY,
  CRUX_SENT_KINDS
} crux_sent;

typedef struct crux_node_counters {
  uint32_t syncs;             ///< valid ones
  uint32_t commands;          ///< valid ones
  uint32_t rejected_crc;      ///< of Syncs and commands alike
  uint32_t rejected_counter;  ///< repeated, stale or after too long a gap
  uint32_t rejected_invalid;  ///< wrong length, unknown mode, not finite, limp
  uint32_t timeouts;          ///< latched stops
  uint32_t queue_overflows;   ///< frames lost because the port did not fetch them
} crux_node_counters;

typedef struct crux_link {
  uint64_t uptime_us;
  uint32_t parameter_hash;
  uint32_t heartbeat_us;                         ///< until the next one
  uint32_t emergency_wait_us[CRUX_CAUSE_COUNT];  ///< until that cause may be sent again
  crux_node_counters counters;
  uint8_t kind;
  uint8_t limb;  ///< 0..3
  uint8_t node;  ///< 1..7
  uint8_t faults;
  bool identity_asked;  ///< by the host, since the last tick
  crux_health told;     ///< of the drive, last
  uint8_t sent[CRUX_SENT_KINDS];
  uint8_t queue_first;
  uint8_t queue_count;
  crux_frame queue[CRUX_QUEUE_LENGTH];
} crux_link;

/// Starts the node's life on the bus: queues its identity and the emergency RESTARTED.
void crux_link_init(crux_link *link, uint8_t kind, uint8_t limb, uint8_t node, uint32_t parameter_hash);

/// Whether a HostHeartbeat that asks for the identity of node `asked` asks this one: its three bits do not reach node
/// 8, which answers when the gripper is asked.
static inline bool crux_link_is_asked(uint8_t asked, uint8_t node) {
  return (asked != 0U) && (asked == ((node < (uint8_t)CRUX_CAN_NODE_GRIPPER) ? node : (uint8_t)CRUX_CAN_NODE_GRIPPER));
}

/// A HostHeartbeat may ask this node who it is; it answers in its next tick. Anything else is for somebody else.
void crux_link_hear_host(crux_link *link, const crux_frame *frame);

/// Time passes: queues the identity where it was asked for, and the heartbeat every 100 ms, nodes of a bus one after
/// another.
void crux_link_tick(crux_link *link, uint32_t dt_us, uint8_t state);

/// Adds counter and CRC and queues the frame. When the queue is full the oldest frame is lost, and counted.
void crux_link_send(crux_link *link, crux_sent kind, crux_frame *frame);

/// Sends an emergency frame, unless one of that cause went out less than 100 ms ago.
void crux_link_event(crux_link *link, uint8_t cause, uint32_t detail);

/// Sets or clears the fault bit of a cause; an emergency goes out when it appears.
void crux_link_condition(crux_link *link, uint8_t cause, bool active, uint32_t detail);

/// Judges a Sync, counts and reports. True when it takes the waiting command over.
bool crux_link_hear_sync(crux_link *link, crux_guard *guard, const crux_frame *frame);

/// Judges a command frame of so many bytes, counts and reports; `content`: how its command was judged. True when that
/// waits for its Sync from now on.
bool crux_link_hear_command(crux_link *link, crux_guard *guard, const crux_frame *frame, uint32_t length,
                            uint8_t content);

/// As crux_link_hear_sync, of a broadcast; `content`: how its command for this node was judged.
bool crux_link_hear_broadcast(crux_link *link, crux_guard *guard, const crux_frame *frame, uint8_t content);

/// Position lost: an emergency with the drive's cause, SENSOR where it has none; again with each identity asked for.
void crux_link_lost(crux_link *link, const crux_health *health);

/// Once a tick, what a board reads: whether its controller is off the bus, whether its gate driver has stopped the
/// bridge, and its winding's temperature: over the limit, until 5 K below it; or not known, for a thermometer that is
/// open or shorted says nothing. Of the drive what has changed: a new cause, encoder samples left out, a motor whose
/// direction nobody knows.
void crux_link_board(crux_link *link, bool bus_off, bool driver_fault, const crux_health *health,
                     float temperature_degC, float limit_degC);

/// Pops the oldest frame of the transmit queue; false when it is empty.
bool crux_link_take_frame(crux_link *link, crux_frame *frame);

/// Bits of a float, for Emergency.Detail.
uint32_t crux_float_bits(float value);

/// Whole microseconds of a control period; at least 1.
uint32_t crux_microseconds(float dt_s);

#endif
