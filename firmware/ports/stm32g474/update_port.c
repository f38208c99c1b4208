#include "update_port.h"

#include <string.h>

#include "flash_port.h"
#include "link.h"

static crux_slots slots;
static crux_update update;

uint32_t update_port_init(uint32_t kind) {
  crux_running running = {.slot = flash_port_running_slot(), .confirmed = true, .version = CRUX_FIRMWARE_VERSION};
  if (running.slot != CRUX_NO_SLOT) {
    flash_port_slots(&slots, kind);
    crux_boot_running(&slots, running.slot, &running);
    crux_update_init(&update, &slots, &running);
  }
  return running.version;
}

void update_port_offer(crux_service *service) {
  if (update.slots != NULL) {
    crux_service_offer_update(service, &update);
  }
}

bool update_port_is_kept(void) { return (update.slots == NULL) || update.running.confirmed; }

void update_port_keep(crux_requests *requests, const crux_frame *frame) {
  if ((frame->id == requests->id) && (requests->count < UPDATE_PORT_REQUESTS)) {
    requests->frames[requests->count] = *frame;
    requests->count++;
  }
}

bool update_port_take(crux_requests *requests, crux_frame *frame) {
  const bool found = requests->count > 0U;
  if (found) {
    *frame = requests->frames[0];
    requests->count--;
    (void)memmove(&requests->frames[0], &requests->frames[1], requests->count * sizeof(requests->frames[0]));
  }
  return found;
}
