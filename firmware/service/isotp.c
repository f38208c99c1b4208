#include "isotp.h"

#include <stddef.h>
#include <string.h>

/// Upper nibble of the first byte.
#define SINGLE 0x00U
#define FIRST 0x10U
#define CONSECUTIVE 0x20U
#define FLOW_CONTROL 0x30U

#define CONTINUE 0U
#define WAIT 1U
#define OVERFLOW 2U

#define FILLER 0xCCU
#define CLASSIC_LENGTH 8U  ///< up to it the length of a single frame's message stands in the first byte
#define FIRST_HEADER 2U
#define ESCAPED_HEADER 6U  ///< of a first frame whose message is longer than twelve bits can say
#define FLOW_CONTROL_LENGTH 3U
#define LONGEST_SEPARATION_US 127000U

void crux_isotp_init(crux_isotp *isotp, uint16_t receive_id, uint16_t send_id) {
  *isotp = (crux_isotp){.receive_id = receive_id, .send_id = send_id};
}

static void answer(crux_isotp *isotp, uint8_t status) {
  isotp->answer_due = true;
  isotp->answer = status;
}

static void on_single(crux_isotp *isotp, const crux_frame *frame) {
  const bool classic = frame->length <= CLASSIC_LENGTH;
  const uint8_t header = classic ? 1U : 2U;
  const uint8_t length = classic ? (uint8_t)(frame->data[0] & 0x0FU) : frame->data[1];
  const bool right = classic || ((frame->data[0] & 0x0FU) == 0U);
  if (right && (length > 0U) && (length <= (frame->length - header))) {
    (void)memcpy(isotp->message, &frame->data[header], length);
    isotp->length = length;
    isotp->receiving = CRUX_ISOTP_RECEIVED;
  }
}

static void on_first(crux_isotp *isotp, const crux_frame *frame) {
  uint32_t length = ((uint32_t)(frame->data[0] & 0x0FU) << 8U) | frame->data[1];
  uint8_t header = FIRST_HEADER;
  if (length == 0U) {
    length = ((uint32_t)frame->data[2] << 24U) | ((uint32_t)frame->data[3] << 16U) | ((uint32_t)frame->data[4] << 8U) |
             frame->data[5];
    header = ESCAPED_HEADER;
  }
  // A message that fits into a single frame of this length is not sent in several.
  const bool right = (frame->length >= CLASSIC_LENGTH) && (length > ((uint32_t)frame->length - header));
  if (right && (length > CRUX_ISOTP_RECEIVED_CAPACITY)) {
    isotp->receiving = CRUX_ISOTP_LISTENS;
    answer(isotp, OVERFLOW);
  } else if (right) {
    isotp->length = (uint16_t)length;
    isotp->filled = (uint16_t)(frame->length - header);
    (void)memcpy(isotp->message, &frame->data[header], isotp->filled);
    isotp->frame_length = frame->length;
    isotp->next_number = 1U;
    isotp->silent_us = 0U;
    isotp->receiving = CRUX_ISOTP_RECEIVES;
    answer(isotp, CONTINUE);
  } else {
    // not of this standard
  }
}

static void on_consecutive(crux_isotp *isotp, const crux_frame *frame) {
  const uint16_t left = (uint16_t)(isotp->length - isotp->filled);
  const uint16_t carried = (uint16_t)(frame->length - 1U);
  const bool last = left < isotp->frame_length;  // all of it fits into one frame
  if ((frame->data[0] & 0x0FU) != isotp->next_number) {
    isotp->receiving = CRUX_ISOTP_LISTENS;
  } else if (last ? (carried >= left) : (frame->length == isotp->frame_length)) {
    const uint16_t taken = last ? left : carried;
    (void)memcpy(&isotp->message[isotp->filled], &frame->data[1], taken);
    isotp->filled = (uint16_t)(isotp->filled + taken);
    isotp->next_number = (uint8_t)((isotp->next_number + 1U) & 0x0FU);
    isotp->silent_us = 0U;
    isotp->receiving = last ? CRUX_ISOTP_RECEIVED : CRUX_ISOTP_RECEIVES;
  } else {
    // shorter than the first frame: ignored, and missed at the next number
  }
}

/// STmin in microseconds; what the standard reserves counts as the longest.
static uint32_t separation_us(uint8_t code) {
  uint32_t result = LONGEST_SEPARATION_US;
  if (code <= 0x7FU) {
    result = (uint32_t)code * 1000U;
  } else if ((code >= 0xF1U) && (code <= 0xF9U)) {
    result = ((uint32_t)code - 0xF0U) * 100U;
  } else {
    // reserved
  }
  return result;
}

static void on_flow_control(crux_isotp *isotp, const crux_frame *frame) {
  const uint8_t status = frame->data[0] & 0x0FU;
  if ((isotp->sending != CRUX_ISOTP_WAITS) || (frame->length < FLOW_CONTROL_LENGTH)) {
    // nobody asked
  } else if (status == CONTINUE) {
    isotp->block_left = frame->data[1];
    isotp->separation_us = separation_us(frame->data[2]);
    isotp->waited_us = isotp->separation_us;
    isotp->waits = 0U;
    isotp->sending = CRUX_ISOTP_SENDS;
  } else if ((status == WAIT) && (isotp->waits < CRUX_ISOTP_MOST_WAITS)) {
    isotp->waits++;
    isotp->waited_us = 0U;
  } else {
    isotp->sending = CRUX_ISOTP_QUIET;
  }
}

void crux_isotp_on_frame(crux_isotp *isotp, const crux_frame *frame) {
  if ((frame->id == isotp->receive_id) && (frame->length >= 2U)) {
    const uint8_t kind = frame->data[0] & 0xF0U;
    // One message at a time: a sender that does not wait for the answer to the last one is not heard.
    const bool free = isotp->receiving != CRUX_ISOTP_RECEIVED;
    if (kind == FLOW_CONTROL) {
      on_flow_control(isotp, frame);
    } else if ((kind == SINGLE) && free) {
      on_single(isotp, frame);
    } else if ((kind == FIRST) && free) {
      on_first(isotp, frame);
    } else if ((kind == CONSECUTIVE) && (isotp->receiving == CRUX_ISOTP_RECEIVES)) {
      on_consecutive(isotp, frame);
    } else {
      // not of this standard, or nobody waits for it
    }
  }
}

static uint32_t later(uint32_t us, uint32_t dt_us) { return (us > (UINT32_MAX - dt_us)) ? UINT32_MAX : (us + dt_us); }

void crux_isotp_tick(crux_isotp *isotp, uint32_t dt_us) {
  isotp->silent_us = later(isotp->silent_us, dt_us);
  isotp->waited_us = later(isotp->waited_us, dt_us);
  if ((isotp->receiving == CRUX_ISOTP_RECEIVES) && (isotp->silent_us >= CRUX_ISOTP_TIMEOUT_US)) {
    isotp->receiving = CRUX_ISOTP_LISTENS;
  }
  if ((isotp->sending == CRUX_ISOTP_WAITS) && (isotp->waited_us >= CRUX_ISOTP_TIMEOUT_US)) {
    isotp->sending = CRUX_ISOTP_QUIET;
  }
}

const uint8_t *crux_isotp_message(const crux_isotp *isotp, uint16_t *length) {
  const bool whole = isotp->receiving == CRUX_ISOTP_RECEIVED;
  *length = whole ? isotp->length : 0U;
  return whole ? isotp->message : NULL;
}

void crux_isotp_done(crux_isotp *isotp) { isotp->receiving = CRUX_ISOTP_LISTENS; }

bool crux_isotp_send(crux_isotp *isotp, const uint8_t *message, uint16_t length) {
  const bool possible = (isotp->sending == CRUX_ISOTP_QUIET) && (length > 0U) && (length <= CRUX_ISOTP_SENT_CAPACITY);
  if (possible) {
    (void)memcpy(isotp->answer_message, message, length);
    isotp->to_send = length;
    isotp->sent = 0U;
    isotp->waits = 0U;
    isotp->sending = CRUX_ISOTP_BEGINS;
  }
  return possible;
}

bool crux_isotp_is_sending(const crux_isotp *isotp) { return isotp->sending != CRUX_ISOTP_QUIET; }

/// Puts as many bytes of the message as fit behind `header` bytes; the rest up to a length that CAN FD has is filled
/// up.
static void put(crux_isotp *isotp, crux_frame *frame, uint8_t header) {
  static const uint8_t LENGTHS[] = {8U, 12U, 16U, 20U, 24U, 32U, 48U, 64U};
  const uint16_t left = (uint16_t)(isotp->to_send - isotp->sent);
  const uint16_t room = (uint16_t)(CRUX_FRAME_CAPACITY - header);
  const uint16_t taken = (left < room) ? left : room;
  const uint8_t used = (uint8_t)(header + taken);
  uint8_t padded = used;
  for (uint32_t i = 0U; (used > CLASSIC_LENGTH) && (i < sizeof(LENGTHS)); i++) {
    padded = LENGTHS[i];
    if (padded >= used) {
      break;
    }
  }
  (void)memcpy(&frame->data[header], &isotp->answer_message[isotp->sent], taken);
  (void)memset(&frame->data[used], (int)FILLER, (size_t)padded - used);
  frame->length = padded;
  isotp->sent = (uint16_t)(isotp->sent + taken);
}

static void begin(crux_isotp *isotp, crux_frame *frame) {
  const uint16_t length = isotp->to_send;
  if (length < CLASSIC_LENGTH) {
    frame->data[0] = (uint8_t)(SINGLE | length);
    put(isotp, frame, 1U);
    isotp->sending = CRUX_ISOTP_QUIET;
  } else if (length <= (CRUX_FRAME_CAPACITY - 2U)) {
    frame->data[0] = SINGLE;
    frame->data[1] = (uint8_t)length;
    put(isotp, frame, 2U);
    isotp->sending = CRUX_ISOTP_QUIET;
  } else {
    frame->data[0] = (uint8_t)(FIRST | (length >> 8U));
    frame->data[1] = (uint8_t)(length & 0xFFU);
    put(isotp, frame, FIRST_HEADER);
    isotp->number = 1U;
    isotp->waited_us = 0U;
    isotp->sending = CRUX_ISOTP_WAITS;
  }
}

static void go_on(crux_isotp *isotp, crux_frame *frame) {
  frame->data[0] = (uint8_t)(CONSECUTIVE | isotp->number);
  put(isotp, frame, 1U);
  isotp->number = (uint8_t)((isotp->number + 1U) & 0x0FU);
  isotp->waited_us = 0U;
  if (isotp->sent == isotp->to_send) {
    isotp->sending = CRUX_ISOTP_QUIET;
  } else if (isotp->block_left == 1U) {
    isotp->sending = CRUX_ISOTP_WAITS;
  } else {
    isotp->block_left = (uint8_t)((isotp->block_left > 0U) ? (isotp->block_left - 1U) : 0U);
  }
}

bool crux_isotp_take_frame(crux_isotp *isotp, crux_frame *frame) {
  bool due = true;
  frame->id = isotp->send_id;
  if (isotp->answer_due) {
    frame->data[0] = (uint8_t)(FLOW_CONTROL | isotp->answer);
    frame->data[1] = 0U;  // no further flow control needed
    frame->data[2] = (uint8_t)CRUX_ISOTP_SEPARATION_MS;
    frame->length = FLOW_CONTROL_LENGTH;
    isotp->answer_due = false;
  } else if (isotp->sending == CRUX_ISOTP_BEGINS) {
    begin(isotp, frame);
  } else if ((isotp->sending == CRUX_ISOTP_SENDS) && (isotp->waited_us >= isotp->separation_us)) {
    go_on(isotp, frame);
  } else {
    due = false;
  }
  return due;
}
