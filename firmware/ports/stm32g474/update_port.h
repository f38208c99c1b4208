/// The update of an image that runs from a slot.
#ifndef CRUX_STM32G474_UPDATE_PORT_H
#define CRUX_STM32G474_UPDATE_PORT_H

#include "service.h"

/// Version of the program that runs. Before update_port_offer.
uint32_t update_port_init(uint32_t kind);

/// Has the services take images, where the program runs from a slot.
void update_port_offer(crux_service *service);

/// Whether the program that runs has confirmed itself, or is none that must.
bool update_port_is_kept(void);

#endif
