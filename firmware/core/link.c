#include "link.h"

#include <math.h>
#include <string.h>

#include "e2e.h"

#define TEMPERATURE_HYSTERESIS_K 5.0F

int8_t crux_whole_degrees(float temperature_degC) {
  const float rounded = roundf(temperature_degC);
  int8_t result = (int8_t)INT8_MIN;
  if (isfinite(temperature_degC) != 0) {
    result = (int8_t)crux_clamp(rounded, (float)INT8_MIN + 1.0F, (float)INT8_MAX);
  }
  return result;
}

uint32_t crux_float_bits(float value) {
  uint32_t bits = 0U;
  (void)memcpy(&bits, &value, sizeof(bits));
  return bits;
}

uint32_t crux_microseconds(float dt_s) {
  const float microseconds = roundf(dt_s * 1.0e6F);
  uint32_t result = 1U;
  if ((microseconds >= 1.0F) && (microseconds <= 1.0e6F)) {
    result = (uint32_t)microseconds;
  }
  return result;
}

void crux_link_send(crux_link *link, crux_sent kind, crux_frame *frame) {
  crux_e2e_protect(frame->id, link->sent[kind], frame->data, frame->length);
  link->sent[kind]++;
  if (link->queue_count == CRUX_QUEUE_LENGTH) {
    link->queue_first = (uint8_t)((link->queue_first + 1U) % CRUX_QUEUE_LENGTH);
    link->queue_count--;
    link->counters.queue_overflows++;
  }
  link->queue[(link->queue_first + link->queue_count) % CRUX_QUEUE_LENGTH] = *frame;
  link->queue_count++;
}

bool crux_link_take_frame(crux_link *link, crux_frame *frame) {
  const bool found = link->queue_count > 0U;
  if (found) {
    *frame = link->queue[link->queue_first];
    link->queue_first = (uint8_t)((link->queue_first + 1U) % CRUX_QUEUE_LENGTH);
    link->queue_count--;
  }
  return found;
}

static void send_identity(crux_link *link) {
  const struct crux_can_joint_identity_t identity = {
      .protocol = (uint8_t)CRUX_CAN_PROTOCOL_VERSION,
      .node_kind = link->kind,
      .node_id = link->node,
      .limb = link->limb,
      .firmware_version = CRUX_FIRMWARE_VERSION,
      .parameter_hash = link->parameter_hash,
  };
  crux_frame frame = {.id = (uint16_t)CRUX_CAN_ID_JOINT_IDENTITY(link->node),
                      .length = (uint8_t)CRUX_CAN_LENGTH_JOINT_IDENTITY};
  (void)crux_can_joint_identity_pack(frame.data, &identity, sizeof(frame.data));
  crux_link_send(link, CRUX_SENT_IDENTITY, &frame);
}

void crux_link_event(crux_link *link, uint8_t cause, uint32_t detail) {
  if (link->emergency_wait_us[cause] == 0U) {
    const struct crux_can_joint_emergency_t emergency = {.cause = cause, .detail = detail};
    crux_frame frame = {.id = (uint16_t)CRUX_CAN_ID_JOINT_EMERGENCY(link->node),
                        .length = (uint8_t)CRUX_CAN_LENGTH_JOINT_EMERGENCY};
    (void)crux_can_joint_emergency_pack(frame.data, &emergency, sizeof(frame.data));
    crux_link_send(link, CRUX_SENT_EMERGENCY, &frame);
    link->emergency_wait_us[cause] = CRUX_EMERGENCY_PERIOD_US;
  }
}

void crux_link_condition(crux_link *link, uint8_t cause, bool active, uint32_t detail) {
  const uint8_t bit = (uint8_t)CRUX_CAN_FAULT_BIT(cause);
  if (active && ((link->faults & bit) == 0U)) {
    crux_link_event(link, cause, detail);
  }
  link->faults = (uint8_t)(active ? (link->faults | bit) : (link->faults & (uint8_t)~bit));
}

/// Counts a rejected (cause) or accepted (CRUX_CAUSE_NONE) frame and reports the rejection.
static void count(crux_link *link, uint8_t cause, uint32_t *accepted) {
  uint32_t *counter = accepted;
  if (cause == (uint8_t)CRUX_CAUSE_E2E_CRC) {
    counter = &link->counters.rejected_crc;
  } else if (cause == (uint8_t)CRUX_CAUSE_E2E_COUNTER) {
    counter = &link->counters.rejected_counter;
  } else if (cause == (uint8_t)CRUX_CAUSE_INVALID_COMMAND) {
    counter = &link->counters.rejected_invalid;
  } else {
    // accepted
  }
  (*counter)++;
  if (cause != (uint8_t)CRUX_CAUSE_NONE) {
    crux_link_event(link, cause, *counter);
  }
}

bool crux_link_hear_sync(crux_link *link, crux_guard *guard, const crux_frame *frame) {
  const uint8_t cause = crux_guard_sync(guard, frame);
  count(link, cause, &link->counters.syncs);
  return (cause == (uint8_t)CRUX_CAUSE_NONE) && guard->take;
}

bool crux_link_hear_command(crux_link *link, crux_guard *guard, const crux_frame *frame, uint32_t length,
                            uint8_t content) {
  const uint8_t refused = crux_guard_command(guard, frame, (uint8_t)length);
  const uint8_t cause = (refused == (uint8_t)CRUX_CAUSE_NONE) ? content : refused;
  const bool valid = cause == (uint8_t)CRUX_CAUSE_NONE;
  if (valid) {
    guard->command_waiting = true;
  }
  count(link, cause, &link->counters.commands);
  return valid;
}

bool crux_link_hear_broadcast(crux_link *link, crux_guard *guard, const crux_frame *frame, uint8_t content) {
  const uint8_t cause = crux_guard_broadcast(guard, frame, content == (uint8_t)CRUX_CAUSE_NONE);
  const bool valid = cause == (uint8_t)CRUX_CAUSE_NONE;
  count(link, cause, &link->counters.syncs);
  if (valid) {
    count(link, content, &link->counters.commands);
  }
  return valid && guard->take;
}

static void tell_temperature(crux_link *link, float temperature_degC, float limit_degC) {
  const bool was_hot = (link->faults & CRUX_CAN_FAULT_BIT((uint32_t)CRUX_CAUSE_OVER_TEMPERATURE)) != 0U;
  const float threshold_degC = was_hot ? (limit_degC - TEMPERATURE_HYSTERESIS_K) : limit_degC;
  crux_link_condition(link, (uint8_t)CRUX_CAUSE_OVER_TEMPERATURE, temperature_degC >= threshold_degC,
                      crux_float_bits(temperature_degC));
  crux_link_condition(link, (uint8_t)CRUX_CAUSE_THERMOMETER, isfinite(temperature_degC) == 0, 0U);
}

/// Position lost: by the drive's cause, or by a reading that makes no sense.
static void tell_loss(crux_link *link) {
  const bool known = link->told.cause != (uint8_t)CRUX_CAUSE_NONE;
  crux_link_event(link, known ? link->told.cause : (uint8_t)CRUX_CAUSE_SENSOR, 0U);
}

void crux_link_lost(crux_link *link, const crux_health *health) {
  link->told.cause = health->cause;
  tell_loss(link);
}

static void tell_health(crux_link *link, const crux_health *health) {
  bool encoder_news = health->encoder_errors != link->told.encoder_errors;
  if (health->cause != link->told.cause) {
    link->told.cause = health->cause;
    if (health->cause != (uint8_t)CRUX_CAUSE_NONE) {
      tell_loss(link);
    } else {
      encoder_news = true;  // it is back
    }
  }
  if (health->direction_unchecked && !link->told.direction_unchecked) {
    crux_link_event(link, (uint8_t)CRUX_CAUSE_DIRECTION_UNCHECKED, 0U);
  }
  link->told.direction_unchecked = health->direction_unchecked;
  if (encoder_news && (link->emergency_wait_us[CRUX_CAUSE_ENCODER_ERRORS] == 0U)) {
    crux_link_event(link, (uint8_t)CRUX_CAUSE_ENCODER_ERRORS, health->encoder_errors);
    link->told.encoder_errors = health->encoder_errors;
  }
  const uint8_t bit = (uint8_t)CRUX_CAN_FAULT_BIT((uint32_t)CRUX_CAUSE_NOT_CALIBRATED);
  const bool blank = health->cause == (uint8_t)CRUX_CAUSE_NOT_CALIBRATED;
  link->faults = (uint8_t)(blank ? (link->faults | bit) : (link->faults & (uint8_t)~bit));
}

void crux_link_board(crux_link *link, bool bus_off, bool driver_fault, const crux_health *health,
                     float temperature_degC, float limit_degC) {
  crux_link_condition(link, (uint8_t)CRUX_CAUSE_BUS_OFF, bus_off, 0U);
  crux_link_condition(link, (uint8_t)CRUX_CAUSE_DRIVER, driver_fault, 0U);
  tell_health(link, health);
  if (health->cause != (uint8_t)CRUX_CAUSE_NOT_CALIBRATED) {  // such a board reads no thermometer
    tell_temperature(link, temperature_degC, limit_degC);
  }
}

void crux_link_init(crux_link *link, uint8_t kind, uint8_t limb, uint8_t node, uint32_t parameter_hash) {
  *link = (crux_link){0};
  link->kind = kind;
  link->limb = limb;
  link->node = node;
  link->parameter_hash = parameter_hash;
  // Heartbeats of a bus are spread over the period, so that they never load one cycle all at once.
  const uint32_t apart_us = CRUX_HEARTBEAT_PERIOD_US / CRUX_CAN_NODE_GRIPPER;
  link->heartbeat_us = (node <= CRUX_CAN_NODE_GRIPPER) ? (apart_us * node) : (apart_us / 2U);
  send_identity(link);
  crux_link_event(link, (uint8_t)CRUX_CAUSE_RESTARTED, CRUX_FIRMWARE_VERSION);
}

void crux_link_hear_host(crux_link *link, const crux_frame *frame) {
  // A question changes nothing in the node, so a repeated one is no danger: any counter will do.
  struct crux_e2e_receiver receiver = {0};
  if ((frame->id == (uint16_t)CRUX_CAN_ID_HOST_HEARTBEAT) &&
      (frame->length == (uint8_t)CRUX_CAN_LENGTH_HOST_HEARTBEAT) &&
      crux_e2e_is_usable(crux_e2e_check(frame->id, frame->data, frame->length, &receiver))) {
    struct crux_can_host_heartbeat_t heartbeat;
    (void)crux_can_host_heartbeat_unpack(&heartbeat, frame->data, frame->length);
    const bool asked = crux_link_is_asked(heartbeat.identify, link->node);
    link->identity_asked = link->identity_asked || asked;
  }
}

void crux_link_tick(crux_link *link, uint32_t dt_us, uint8_t state) {
  link->uptime_us += dt_us;
  if (link->identity_asked) {
    link->identity_asked = false;
    send_identity(link);
    if (state == (uint8_t)CRUX_STATE_FAULT) {
      tell_loss(link);  // who asks may not have heard it
    }
  }
  for (uint32_t cause = 0U; cause < (uint32_t)CRUX_CAUSE_COUNT; cause++) {
    uint32_t *wait_us = &link->emergency_wait_us[cause];
    *wait_us = (*wait_us > dt_us) ? (*wait_us - dt_us) : 0U;
  }
  if (link->heartbeat_us > dt_us) {
    link->heartbeat_us -= dt_us;
  } else {
    // The remainder is carried over: the mean rate is exact even when dt does not divide the period.
    link->heartbeat_us += CRUX_HEARTBEAT_PERIOD_US - (dt_us % CRUX_HEARTBEAT_PERIOD_US);
    const struct crux_can_joint_heartbeat_t heartbeat = {.state = state,
                                                         .uptime_ms = (uint32_t)(link->uptime_us / 1000U)};
    crux_frame frame = {.id = (uint16_t)CRUX_CAN_ID_JOINT_HEARTBEAT(link->node),
                        .length = (uint8_t)CRUX_CAN_LENGTH_JOINT_HEARTBEAT};
    (void)crux_can_joint_heartbeat_pack(frame.data, &heartbeat, sizeof(frame.data));
    crux_link_send(link, CRUX_SENT_HEARTBEAT, &frame);
  }
}
