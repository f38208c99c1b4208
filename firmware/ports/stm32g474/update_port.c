#include "update_port.h"

#include <string.h>

#include "board.h"
#include "fdcan.h"
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

/// The oldest frame that waits; false when there is none.
static bool take(crux_requests *requests, crux_frame *frame) {
  const bool found = requests->count > 0U;
  if (found) {
    *frame = requests->frames[0];
    requests->count--;
    (void)memmove(&requests->frames[0], &requests->frames[1], requests->count * sizeof(requests->frames[0]));
  }
  return found;
}

void update_port_serve(crux_service *service, crux_requests *requests, bool tick, const uint8_t *state,
                       const crux_guard *guard) {
  crux_frame frame;
  while (take(requests, &frame)) {
    crux_service_on_frame(service, &frame, *state);
  }
  if (tick) {
    crux_service_tick(service, BOARD_TICK_US, *state, crux_guard_is_commanded(guard));
  }
  while (fdcan_can_send() && crux_service_take_frame(service, &frame)) {
    fdcan_send(&frame);
  }
  if (fdcan_has_sent() && crux_service_restarts(service)) {
    board_restart();
  }
}
