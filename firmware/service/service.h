/// Services of a node over ISO-TP, in the words of UDS (ISO 14229): its parameters, its firmware. They run beside the
/// node's core and touch its parameters alone; msgs/can/README.md lists requests and answers.
#ifndef CRUX_FIRMWARE_SERVICE_H
#define CRUX_FIRMWARE_SERVICE_H

#include <stdbool.h>
#include <stdint.h>

#include "crux_services.h"
#include "isotp.h"
#include "overrides.h"
#include "update.h"

/// Numbers of parameters are below; they are added to CRUX_DATA_VALUE and CRUX_DATA_DESCRIPTION.
#define CRUX_DATA_PARAMETERS 32U

typedef struct crux_service {
  crux_isotp isotp;
  crux_overrides overrides;
  crux_update *update;  ///< NULL: the node takes no images
  uint32_t healthy_us;  ///< without a fault
  bool heard;           ///< a request, since the start
  bool commanded;       ///< see crux_service_tick
  uint32_t version;
  uint32_t parameter_hash;
  bool restart;  ///< asked for and allowed: the port restarts the node once the answer is out
} crux_service;

/// Starts the services of node 1..7. `parameters` is the struct the node will be started with; stored overrides go
/// into it. The node's own copy is named afterwards by crux_service_attach.
void crux_service_init(crux_service *service, uint8_t node, uint32_t version, uint32_t parameter_hash, void *parameters,
                       const crux_store *store);

/// The node takes images, too; a new one that runs from a slot is confirmed when it is well.
void crux_service_offer_update(crux_service *service, crux_update *update);

/// From now on writes that act at once go into the running node's struct.
void crux_service_attach(crux_service *service, void *parameters);

/// Takes a frame from the bus; `state` is the node's (DBC enumeration).
void crux_service_on_frame(crux_service *service, const crux_frame *frame, uint8_t state);

/// Time passes. `commanded`: a host commands the node (crux_guard_is_commanded).
void crux_service_tick(crux_service *service, uint32_t dt_us, uint8_t state, bool commanded);

/// The next frame to send; false when there is none now.
bool crux_service_take_frame(crux_service *service, crux_frame *frame);

/// True once, when the node is to restart now.
bool crux_service_restarts(crux_service *service);

#endif
