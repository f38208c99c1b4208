#include "service.h"

#include <string.h>

#include "codec.h"
#include "permission.h"
#include "reply.h"
#include "update_service.h"

static uint16_t identifier_at(const uint8_t *bytes) { return (uint16_t)(((uint32_t)bytes[0] << 8U) | bytes[1]); }

/// Bits of a share of a value, as the parameter's kind has them: an integer's range ends at whole numbers.
static uint32_t share_of(const crux_parameter *parameter, uint32_t described, float share, bool upwards) {
  uint32_t bits = described;
  if (parameter->is_integer) {
    const float product = share * (float)described;
    bits = (uint32_t)product;
    bits += (upwards && ((float)bits < product)) ? 1U : 0U;
  } else {
    float value = 0.0F;
    (void)memcpy(&value, &described, sizeof(value));
    value *= share;
    (void)memcpy(&bits, &value, sizeof(bits));
  }
  return bits;
}

static void describe(const crux_overrides *overrides, uint8_t index, crux_reply *answer) {
  const crux_parameter *parameter = &overrides->table[index];
  const uint32_t described = overrides->described[index];
  crux_reply_byte(answer, parameter->id);
  crux_reply_byte(answer, (uint8_t)((parameter->is_integer ? CRUX_FLAG_INTEGER : 0) |
                                    (parameter->writable ? CRUX_FLAG_WRITABLE : 0) |
                                    (parameter->acts_now ? CRUX_FLAG_ACTS_NOW : 0)));
  crux_reply_word(answer, overrides->set[index]);
  crux_reply_word(answer, described);
  crux_reply_word(answer, share_of(parameter, described, parameter->least_share, true));
  crux_reply_word(answer, share_of(parameter, described, parameter->greatest_share, false));
  crux_reply_add(answer, parameter->name, strlen(parameter->name) + 1U);
  crux_reply_add(answer, parameter->unit, strlen(parameter->unit) + 1U);
}

static uint8_t read_data(const crux_service *service, const uint8_t *request, uint16_t length, crux_reply *answer) {
  const crux_overrides *overrides = &service->overrides;
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  if (length != 3U) {
    refusal = (uint8_t)CRUX_REFUSAL_LENGTH;
  } else {
    const uint16_t identifier = identifier_at(&request[1]);
    const uint8_t index = crux_overrides_find(overrides, (uint8_t)(identifier % CRUX_DATA_PARAMETERS));
    const uint16_t group = (uint16_t)(identifier - (identifier % CRUX_DATA_PARAMETERS));
    crux_reply_add(answer, &request[1], 2U);
    if (identifier == (uint16_t)CRUX_DATA_VERSION) {
      crux_reply_word(answer, service->version);
      crux_reply_word(answer, service->parameter_hash);
      crux_reply_byte(answer, overrides->count);
    } else if ((identifier == (uint16_t)CRUX_DATA_UPDATE) && (service->update != NULL)) {
      crux_update_tell(service->update, answer);
    } else if ((group == (uint16_t)CRUX_DATA_VALUE) && (index < overrides->count)) {
      crux_reply_word(answer, overrides->set[index]);
    } else if ((group == (uint16_t)CRUX_DATA_DESCRIPTION) && (index < overrides->count)) {
      describe(overrides, index, answer);
    } else {
      refusal = (uint8_t)CRUX_REFUSAL_RANGE;
    }
  }
  return refusal;
}

static uint8_t write_data(crux_service *service, const uint8_t *request, uint16_t length, uint8_t state,
                          crux_reply *answer) {
  crux_overrides *overrides = &service->overrides;
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  if (length != 7U) {
    refusal = (uint8_t)CRUX_REFUSAL_LENGTH;
  } else {
    const uint16_t identifier = identifier_at(&request[1]);
    const uint8_t index = crux_overrides_find(overrides, (uint8_t)(identifier % CRUX_DATA_PARAMETERS));
    const uint32_t bits = crux_word_at(&request[3]);
    if (((identifier - (identifier % CRUX_DATA_PARAMETERS)) != (uint32_t)CRUX_DATA_VALUE) ||
        (index >= overrides->count) ||
        !crux_parameter_accepts(&overrides->table[index], overrides->described[index], bits)) {
      refusal = (uint8_t)CRUX_REFUSAL_RANGE;
    } else if (!crux_is_at_rest(state)) {
      refusal = (uint8_t)CRUX_REFUSAL_CONDITIONS;
    } else {
      crux_overrides_set(overrides, index, bits);
      crux_reply_add(answer, &request[1], 2U);
    }
  }
  return refusal;
}

static uint8_t run_routine(crux_service *service, const uint8_t *request, uint16_t length, uint8_t state,
                           crux_reply *answer) {
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  const uint16_t routine = (length == 4U) ? identifier_at(&request[2]) : 0U;
  if (length != 4U) {
    refusal = (uint8_t)CRUX_REFUSAL_LENGTH;
  } else if (request[1] != 1U) {
    refusal = (uint8_t)CRUX_REFUSAL_UNKNOWN_FUNCTION;
  } else if ((routine != (uint16_t)CRUX_ROUTINE_SAVE) && (routine != (uint16_t)CRUX_ROUTINE_FORGET)) {
    refusal = (uint8_t)CRUX_REFUSAL_RANGE;
  } else if (!crux_is_at_rest(state)) {
    refusal = (uint8_t)CRUX_REFUSAL_CONDITIONS;
  } else {
    if (routine == (uint16_t)CRUX_ROUTINE_FORGET) {
      crux_overrides_clear(&service->overrides);
    }
    refusal = crux_overrides_save(&service->overrides) ? (uint8_t)CRUX_REFUSAL_NONE : (uint8_t)CRUX_REFUSAL_MEMORY;
    crux_reply_add(answer, &request[1], 3U);
  }
  return refusal;
}

/// 0x11 0x01 and the operator's acknowledgement.
static uint8_t reset(crux_service *service, const uint8_t *request, uint16_t length, uint8_t state,
                     crux_reply *answer) {
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_NONE;
  if (length != 6U) {
    refusal = (uint8_t)CRUX_REFUSAL_LENGTH;
  } else if (request[1] != 1U) {
    refusal = (uint8_t)CRUX_REFUSAL_UNKNOWN_FUNCTION;
  } else if (!crux_may_restart(state, service->commanded, crux_word_at(&request[2]))) {
    refusal = (uint8_t)CRUX_REFUSAL_CONDITIONS;
  } else {
    service->restart = true;
    crux_reply_byte(answer, request[1]);
  }
  return refusal;
}

static uint8_t serve(crux_service *service, const uint8_t *request, uint16_t length, uint8_t state,
                     crux_reply *answer) {
  uint8_t refusal = (uint8_t)CRUX_REFUSAL_UNKNOWN_SERVICE;
  crux_reply_byte(answer, (uint8_t)(request[0] + CRUX_SERVICE_ACCEPTED));
  if (request[0] == (uint8_t)CRUX_SERVICE_READ) {
    refusal = read_data(service, request, length, answer);
  } else if (request[0] == (uint8_t)CRUX_SERVICE_WRITE) {
    refusal = write_data(service, request, length, state, answer);
  } else if (request[0] == (uint8_t)CRUX_SERVICE_ROUTINE) {
    refusal = run_routine(service, request, length, state, answer);
  } else if (request[0] == (uint8_t)CRUX_SERVICE_RESET) {
    refusal = reset(service, request, length, state, answer);
  } else if (request[0] == (uint8_t)CRUX_SERVICE_PRESENT) {
    refusal = (uint8_t)CRUX_REFUSAL_NONE;
    crux_reply_byte(answer, 0U);
  } else if ((service->update != NULL) &&
             ((request[0] == (uint8_t)CRUX_SERVICE_DOWNLOAD) || (request[0] == (uint8_t)CRUX_SERVICE_TRANSFER) ||
              (request[0] == (uint8_t)CRUX_SERVICE_TRANSFER_EXIT))) {
    refusal = crux_update_serve(service->update, request, length, state, service->commanded, answer);
  } else {
    // unknown
  }
  return refusal;
}

void crux_service_init(crux_service *service, uint8_t node, uint32_t version, uint32_t parameter_hash, void *parameters,
                       const crux_store *store) {
  *service = (crux_service){.version = version, .parameter_hash = parameter_hash};
  crux_isotp_init(&service->isotp, (uint16_t)CRUX_CAN_ID_JOINT_REQUEST(node),
                  (uint16_t)CRUX_CAN_ID_JOINT_RESPONSE(node));
  const crux_parameter *table = crux_gripper_parameter_table;
  uint8_t count = (uint8_t)CRUX_GRIPPER_PARAMETERS;
  if (node != CRUX_CAN_NODE_GRIPPER) {
    table = crux_joint_parameter_table;
    count = (uint8_t)CRUX_JOINT_PARAMETERS;
  }
  crux_overrides_init(&service->overrides, table, count, parameters, store);
}

void crux_service_offer_update(crux_service *service, crux_update *update) { service->update = update; }

void crux_service_attach(crux_service *service, void *parameters) { service->overrides.parameters = parameters; }

/// Answers the request that waits, as soon as the last answer is out; a node about to restart hears nothing more.
static void respond(crux_service *service, uint8_t state) {
  uint16_t length = 0U;
  const uint8_t *request = crux_isotp_message(&service->isotp, &length);
  if ((request != NULL) && !crux_isotp_is_sending(&service->isotp) && !service->restart) {
    crux_reply answer = {0};
    const uint8_t refusal = serve(service, request, length, state, &answer);
    if (refusal != (uint8_t)CRUX_REFUSAL_NONE) {
      answer.bytes[0] = (uint8_t)CRUX_SERVICE_REFUSED;
      answer.bytes[1] = request[0];
      answer.bytes[2] = refusal;
      answer.length = 3U;
    }
    crux_isotp_done(&service->isotp);
    service->heard = true;
    (void)crux_isotp_send(&service->isotp, answer.bytes, answer.length);
  }
}

void crux_service_on_frame(crux_service *service, const crux_frame *frame, uint8_t state) {
  crux_isotp_on_frame(&service->isotp, frame);
  respond(service, state);
}

/// A new image that runs, measures and can be talked to, thus also replaced, is kept.
static void probe(crux_service *service, uint32_t dt_us, uint8_t state) {
  crux_update *update = service->update;
  service->healthy_us = (state == (uint8_t)CRUX_STATE_FAULT) ? 0U : (service->healthy_us + dt_us);
  if (!update->running.confirmed && service->heard && (service->healthy_us >= CRUX_UPDATE_PROBATION_US)) {
    (void)crux_boot_confirm(update->slots, &update->running);
  }
  if (!crux_is_at_rest(state)) {
    crux_update_abort(update);
  }
}

void crux_service_tick(crux_service *service, uint32_t dt_us, uint8_t state, bool commanded) {
  service->commanded = commanded;
  crux_isotp_tick(&service->isotp, dt_us);
  // A command that came since the reset was granted goes first.
  service->restart = service->restart && crux_is_at_rest(state);
  if (service->update != NULL) {
    probe(service, dt_us, state);
  }
  respond(service, state);
}

bool crux_service_take_frame(crux_service *service, crux_frame *frame) {
  return crux_isotp_take_frame(&service->isotp, frame);
}

bool crux_service_restarts(crux_service *service) {
  const bool now = service->restart && !crux_isotp_is_sending(&service->isotp);
  service->restart = service->restart && !now;
  return now;
}
