/// The services of a node on its board, and the update of an image that runs from a slot.
#ifndef CRUX_STM32G474_UPDATE_PORT_H
#define CRUX_STM32G474_UPDATE_PORT_H

#include "safety.h"
#include "service.h"

/// Version of the program that runs. Before update_port_offer.
uint32_t update_port_init(uint32_t kind);

/// Has the services take images, where the program runs from a slot.
void update_port_offer(crux_service *service);

/// Whether the program that runs has confirmed itself, or is none that must.
bool update_port_is_kept(void);

#define UPDATE_PORT_REQUESTS 4U

/// Frames of requests that wait: a service that writes to the flash lets the node run meanwhile, and hears nothing.
typedef struct crux_requests {
  uint16_t id;
  uint8_t count;
  crux_frame frames[UPDATE_PORT_REQUESTS];
} crux_requests;

/// Keeps a frame if it is one of a request. What comes faster than the node asked for is lost, as on a full bus.
void update_port_keep(crux_requests *requests, const crux_frame *frame);

/// One turn of the services: what waits, their time at a tick, their answers, and the restart that was asked for. The
/// node runs on while they wait for the flash, so its state and guard are read where they are.
void update_port_serve(crux_service *service, crux_requests *requests, bool tick, const uint8_t *state,
                       const crux_guard *guard);

#endif
