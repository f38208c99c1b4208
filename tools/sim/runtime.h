/// The robot's runtime in this process: control core, limb buses, operator server and log writer of crux-runtime, on
/// buses in memory whose other ends are the nodes. One thread at a time; only the log is written by a thread of its
/// own.
///
/// A cycle of the simulation: crux_runtime_turn, crux_nodes_wait_sync, control and physics, crux_nodes_publish.
#ifndef CRUX_SIM_RUNTIME_H
#define CRUX_SIM_RUNTIME_H

#include <stdint.h>

#include "plant.h"

typedef struct crux_nodes crux_nodes;

#ifdef __cplusplus
extern "C" {
#endif

typedef struct crux_runtime crux_runtime;

/// With the options of crux-runtime's command line; pace, buses and LCM are given. `nodes` have buses in memory and
/// outlive it. NULL on failure, crux_runtime_error() says why.
CRUX_SIM_API crux_runtime *crux_runtime_open(crux_nodes *nodes, int32_t count, const char *const arguments[]);

/// Reason of the last failure in this thread.
CRUX_SIM_API const char *crux_runtime_error(void);

/// Takes what the nodes have answered and sends the next cycle's frames; before they have all answered once, Sync(0).
/// 0 when a stop was asked for and the robot has been told to hold.
CRUX_SIM_API int32_t crux_runtime_turn(crux_runtime *runtime);

/// Sends an operator's message, and serves him until nothing is left to do.
CRUX_SIM_API void crux_runtime_tell(crux_runtime *runtime, const char *channel, const uint8_t *data, int32_t size);

/// The next answer_t: its bytes, valid until the next call. NULL when there is none.
CRUX_SIM_API const uint8_t *crux_runtime_next(crux_runtime *runtime, int32_t *size);

/// Ends the log. Empty, or why it is incomplete.
CRUX_SIM_API const char *crux_runtime_finish(crux_runtime *runtime);

CRUX_SIM_API void crux_runtime_close(crux_runtime *runtime);

/// One control period of every node and of the physics between them.
CRUX_SIM_API void crux_sim_step(crux_nodes *nodes, crux_plant *plant, double dt_s);

/// The nodes answer the last Sync with the plant's measurements. 0, or -1 when a bus refuses.
CRUX_SIM_API int32_t crux_sim_publish(crux_nodes *nodes, crux_plant *plant);

#ifdef __cplusplus
}
#endif
#endif
