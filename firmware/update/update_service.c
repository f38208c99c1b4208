#include "update_service.h"

#include "crux_services.h"
#include "permission.h"

#define ACKNOWLEDGEMENT 4U

static uint8_t download(crux_update *update, const uint8_t *request, uint16_t length, uint8_t state, bool commanded,
                        crux_reply *reply) {
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  if (length != (1U + ACKNOWLEDGEMENT + CRUX_IMAGE_HEADER)) {
    refusal = (uint8_t)CRUX_REFUSAL_LENGTH;
  } else if (!crux_may_restart(state, commanded, crux_word_at(&request[1]))) {
    refusal = (uint8_t)CRUX_REFUSAL_CONDITIONS;
  } else {
    refusal = crux_update_begin(update, &request[1U + ACKNOWLEDGEMENT]);
    crux_reply_word(reply, CRUX_UPDATE_BLOCK);
  }
  return refusal;
}

uint8_t crux_update_serve(crux_update *update, const uint8_t *request, uint16_t length, uint8_t state, bool commanded,
                          crux_reply *reply) {
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  if (request[0] == (uint8_t)CRUX_SERVICE_DOWNLOAD) {
    refusal = download(update, request, length, state, commanded, reply);
  } else if (!crux_is_at_rest(state)) {
    crux_update_abort(update);
    refusal = (uint8_t)CRUX_REFUSAL_CONDITIONS;
  } else if (request[0] == (uint8_t)CRUX_SERVICE_TRANSFER) {
    if (length < 3U) {
      refusal = (uint8_t)CRUX_REFUSAL_LENGTH;
    } else {
      refusal = crux_update_block(update, request[1], &request[2], (uint32_t)length - 2U);
      crux_reply_byte(reply, request[1]);
    }
  } else {
    refusal = (length == 1U) ? crux_update_end(update) : (uint8_t)CRUX_REFUSAL_LENGTH;
  }
  return refusal;
}

void crux_update_tell(const crux_update *update, crux_reply *reply) {
  crux_reply_byte(reply, update->running.slot);
  crux_reply_byte(reply, update->running.confirmed ? 1U : 0U);
  crux_reply_word(reply, update->running.version);
  crux_reply_word(reply, update->target_version);
  crux_reply_word(reply, crux_slot_capacity(update->slots));
  crux_reply_word(reply, crux_slot_linked_for(update->slots, update->target));
}
