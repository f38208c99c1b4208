/// Host port: all nodes of a robot as a shared library with a plain C interface, for the hardware-in-the-loop bench.
/// The nodes are the firmware's own cores; the plant gives measurements and takes torques. Arrays are limb-major
/// (LF, RF, LR, RR), SI units. One thread at a time.
///
/// A cycle of the bench: crux_nodes_wait_sync, crux_nodes_control, one period of physics, crux_nodes_publish.
#ifndef CRUX_NODES_H
#define CRUX_NODES_H

#include <stdint.h>

#include "crux_can_ids.h"
#include "image.h"
#include "link.h"
#include "outside_node.h"
#include "parameters.h"

#define CRUX_LIMBS ((int)CRUX_CAN_LIMBS)
#define CRUX_JOINTS ((int)(CRUX_CAN_LIMBS * CRUX_CAN_JOINTS))

#define CRUX_API __attribute__((visibility("default")))

typedef struct crux_nodes crux_nodes;

/// What moves the axis of a node: its drive; or, without power, nothing, against its motor's windings in short circuit
/// or open.
typedef enum crux_supply { CRUX_POWERED, CRUX_BRAKED, CRUX_FREE } crux_supply;

/// Opens the buses (udp:GROUP:PORT, socketcan:NAME or memory:) and starts the nodes; their identities go out with the
/// first publish. NULL on failure, crux_nodes_error() says why.
CRUX_API crux_nodes *crux_nodes_open(const char *const bus_urls[CRUX_LIMBS],
                                     const crux_joint_parameters joint[CRUX_JOINTS],
                                     const crux_gripper_parameters gripper[CRUX_LIMBS], uint32_t parameter_hash);
CRUX_API void crux_nodes_close(crux_nodes *nodes);

/// Reason of the last failure in this thread.
CRUX_API const char *crux_nodes_error(void);

/// From now on this node runs elsewhere: its frames, control periods, restarts and temperature go to `by`, which must
/// outlive `nodes`. Its counters stay 0. 0, or -1 when there is no such node.
CRUX_API int crux_nodes_replace(crux_nodes *nodes, int limb, int node, const crux_outside_node *by);

/// Feeds frames to the nodes until all buses have brought a new Sync of the same cycle: 1, and the cycle. 0 when
/// timeout_ms passed or a signal came first, -1 on error. A cycle 0 repeated is new each time.
CRUX_API int crux_nodes_wait_sync(crux_nodes *nodes, int timeout_ms, uint32_t *cycle);

/// One control period of dt > 0 seconds of every node. Call it without a Sync, too, while time passes: watchdogs count.
/// Torque [Nm] of the joints; force [N] a finger, positive closes. A NaN measurement is a lost sensor.
CRUX_API void crux_nodes_control(crux_nodes *nodes, double dt, const double joint_position[CRUX_JOINTS],
                                 const double joint_velocity[CRUX_JOINTS], const double finger_opening[CRUX_LIMBS],
                                 const double finger_speed[CRUX_LIMBS], const double finger_force[CRUX_LIMBS],
                                 double joint_torque_out[CRUX_JOINTS], double finger_force_out[CRUX_LIMBS]);

/// Answers the last Sync with these measurements and sends what else the nodes have to say. Nodes whose Sync is
/// answered or was not valid send no status. ft_wrench: fx fy fz mx my mz of the world on each gripper, gripper frame.
/// 0, or -1 when a bus refuses.
CRUX_API int crux_nodes_publish(crux_nodes *nodes, const double joint_position[CRUX_JOINTS],
                                const double joint_velocity[CRUX_JOINTS], const double joint_torque[CRUX_JOINTS],
                                const double finger_opening[CRUX_LIMBS], const double finger_speed[CRUX_LIMBS],
                                const double finger_force[CRUX_LIMBS], const double ft_wrench[CRUX_LIMBS * 6]);

/// The host's end of a limb's bus in memory: a frame for the nodes; the next one of theirs. 0 when the queue is full,
/// or empty. crux_nodes_wait_sync does not wait for such buses.
CRUX_API int crux_nodes_put(crux_nodes *nodes, int limb, const crux_frame *frame);
CRUX_API int crux_nodes_get(crux_nodes *nodes, int limb, crux_frame *frame);

/// HostState of the last valid HostHeartbeat on any bus; 0xFF before the first.
CRUX_API uint8_t crux_nodes_host_state(const crux_nodes *nodes);

/// States (DBC: JointStatus.State, GripperStatus.State) and fault bits.
CRUX_API void crux_nodes_states(const crux_nodes *nodes, uint8_t joint_state[CRUX_JOINTS],
                                uint8_t joint_faults[CRUX_JOINTS], uint8_t gripper_state[CRUX_LIMBS],
                                uint8_t gripper_faults[CRUX_LIMBS]);

/// Counters of a node: limb 0..3, node 1..8. 0, or -1 when there is no such node.
CRUX_API int crux_nodes_counters(const crux_nodes *nodes, int limb, int node, crux_node_counters *counters);

// Faults the bench can inject. 0, or -1 when there is no such node or limb.

/// The node does not hear its next `count` frames (its commands and Syncs), or hears them with a flipped bit.
CRUX_API int crux_nodes_drop_received(crux_nodes *nodes, int limb, int node, uint32_t count);
CRUX_API int crux_nodes_corrupt_received(crux_nodes *nodes, int limb, int node, uint32_t count);
/// The next `count` frames of the node get lost on their way to the bus.
CRUX_API int crux_nodes_drop_sent(crux_nodes *nodes, int limb, int node, uint32_t count);
/// While on, no frame passes between the node and its bus, and its controller goes off; it comes back by itself after.
CRUX_API int crux_nodes_disturb(crux_nodes *nodes, int limb, int node, int on);
/// From now on this share of the frames between the bus and each of the limb's nodes gets lost, both ways, at random;
/// the same seed loses the same frames. A share of 1 cuts the bus, 0 repairs it.
CRUX_API int crux_nodes_lose(crux_nodes *nodes, int limb, double share, uint32_t seed);
/// Whether the limb's bus exists for the nodes: without it no Sync is waited for there and nothing is sent.
CRUX_API int crux_nodes_connect(crux_nodes *nodes, int limb, int connected);
/// A rogue host's frame of at most CRUX_FRAME_CAPACITY bytes: goes out on the limb's bus, and its nodes receive it.
CRUX_API int crux_nodes_intrude(crux_nodes *nodes, int limb, uint16_t id, const uint8_t *data, int length);
/// From now on all nodes trust images signed with the key whose public half this is; before, they take none.
CRUX_API void crux_nodes_trust(crux_nodes *nodes, const uint8_t key[CRUX_IMAGE_KEY]);
/// The power of a node's flash fails within its operation'th write or erase from now on, until crux_nodes_cut_power is
/// called again; 0: it does not fail.
CRUX_API int crux_nodes_cut_power(crux_nodes *nodes, int limb, int node, uint32_t operation);
/// The node restarts as after a loss of power.
CRUX_API int crux_nodes_reset(crux_nodes *nodes, int limb, int node);
/// From now on the node has this supply: without it, it hears, does and says nothing, with it again it restarts.
CRUX_API int crux_nodes_power(crux_nodes *nodes, int limb, int node, crux_supply supply);
/// In the next control period; braked where the node has just restarted.
CRUX_API crux_supply crux_nodes_supply(const crux_nodes *nodes, int limb, int node);
/// What the node's thermometer reads from now on; 25 degC at the start.
CRUX_API int crux_nodes_set_temperature(crux_nodes *nodes, int limb, int node, double temperature_degC);

#endif
