#include "fdcan_model.h"

#include <string.h>

#include "fdcan_internal.h"

#define PSR_EP (1U << 5U)
#define PSR_EW (1U << 6U)
#define PSR_BO (1U << 7U)
#define PSR_LEC_NONE 0U
#define PSR_LEC_BIT0 5U
#define PSR_LEC_UNCHANGED 7U

#define IR_RF0N (1U << 0U)
#define IR_RF0F (1U << 1U)
#define IR_RF0L (1U << 2U)
#define IR_RF1N (1U << 3U)
#define IR_TC (1U << 7U)
#define IR_ELO (1U << 16U)
#define IR_EP (1U << 17U)
#define IR_EW (1U << 18U)
#define IR_BO (1U << 19U)

// Places in the message RAM, by word.
#define STANDARD_FILTERS 0U
#define RECEIVE_FIFO0 44U
#define RECEIVE_FIFO1 98U
#define TRANSMIT_BUFFERS 158U
#define ELEMENT_WORDS 18U

#define WARNING_LEVEL 96U
#define PASSIVE_LEVEL 128U
#define OFF_LEVEL 256U
#define ERROR_STEP 8U
#define ERROR_FRAME_BITS 23U  // flag, delimiter, intermission

static const uint8_t lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

static bool is_classic(const fdcan_model *can) { return can->data_bit_rate == 0U; }

static bool is_joined(const fdcan_model *can) {
  uint32_t nominal = 0U;
  uint32_t data = 0U;
  const uint32_t control = can->registers[CCCR];
  const uint32_t wanted = CCCR_FDOE | CCCR_BRSE;
  fdcan_model_rates(can, &nominal, &data);
  return ((control & CCCR_INIT) == 0U) && !can->off && (nominal == can->bit_rate) &&
         (is_classic(can) || ((data == can->data_bit_rate) && ((control & wanted) == wanted)));
}

void fdcan_model_rates(const fdcan_model *can, uint32_t *nominal, uint32_t *data) {
  const uint32_t n = can->registers[NBTP];
  const uint32_t d = can->registers[DBTP];
  const uint32_t quanta = (((n >> 16U) & 0x1FFU) + 1U) * (3U + ((n >> 8U) & 0xFFU) + (n & 0x7FU));
  const uint32_t data_quanta = (((d >> 16U) & 0x1FU) + 1U) * (3U + ((d >> 8U) & 0x1FU) + ((d >> 4U) & 0xFU));
  *nominal = can->kernel_hz / quanta;
  *data = can->kernel_hz / data_quanta;
}

void fdcan_model_reset(fdcan_model *can, uint32_t bit_rate, uint32_t data_bit_rate) {
  fdcan_model before = {.outbox_count = can->outbox_count, .outbox_first = can->outbox_first};
  (void)memcpy(before.outbox, can->outbox, sizeof(before.outbox));
  *can = before;  // what was sent has left
  can->bit_rate = bit_rate;
  can->data_bit_rate = data_bit_rate;
  can->sent_at = NEVER;
  can->back_at = NEVER;
  can->registers[CREL] = 0x32141218U;
  can->registers[DBTP] = 0x00000A33U;
  can->registers[CCCR] = CCCR_INIT;
  can->registers[NBTP] = 0x06000A03U;
  can->registers[PSR] = 0x00000707U;
}

/// Core cycles that a frame takes on the bus, without stuff bits: SOF, identifier, control and the frame's tail at the
/// nominal rate, the rest at the data rate.
static uint64_t duration(const fdcan_model *can, uint32_t length) {
  if (is_classic(can)) {
    return ((uint64_t)can->kernel_hz * (47U + (8U * length))) / can->bit_rate;
  }
  const uint32_t slow_bits = 30U;
  const uint32_t fast_bits = 5U + (8U * length) + ((length > 16U) ? 32U : 27U);
  const uint64_t hz = can->kernel_hz;
  return ((hz * slow_bits) / can->bit_rate) + ((hz * fast_bits) / can->data_bit_rate);
}

// --- errors ---

static void show_errors(fdcan_model *can, uint32_t last_code) {
  const uint32_t before = can->registers[PSR];
  uint32_t state = (before & 0x1FU & ~7U) | last_code;
  state |= (can->transmit_errors >= WARNING_LEVEL) || (can->receive_errors >= WARNING_LEVEL) ? PSR_EW : 0U;
  state |= (can->transmit_errors >= PASSIVE_LEVEL) || (can->receive_errors >= PASSIVE_LEVEL) ? PSR_EP : 0U;
  state |= can->off ? PSR_BO : 0U;
  const uint32_t changed = before ^ state;
  can->registers[IR] |= ((changed & PSR_EW) != 0U ? IR_EW : 0U) | ((changed & PSR_EP) != 0U ? IR_EP : 0U) |
                        ((changed & PSR_BO) != 0U ? IR_BO : 0U);
  can->registers[PSR] = (before & ~0xFFU) | state;
  const uint32_t shown = (can->transmit_errors < 255U) ? can->transmit_errors : 255U;
  can->registers[ECR] = shown | (can->receive_errors << 8U);
}

static void leave_bus(fdcan_model *can) {
  can->off = true;
  can->registers[CCCR] |= CCCR_INIT;
  can->sent_at = NEVER;
}

// --- receiving ---

/// FIFO that the filters choose for an identifier, -1: none.
static int accepted_by(const fdcan_model *can, uint32_t id) {
  const uint32_t global = can->registers[RXGFC];
  const uint32_t count = (global >> 16U) & 0x1FU;
  for (uint32_t i = 0U; i < count; i++) {
    const uint32_t filter = can->ram[STANDARD_FILTERS + i];
    const uint32_t first = (filter >> 16U) & 0x7FFU;
    const uint32_t second = filter & 0x7FFU;
    const uint32_t element = (filter >> 27U) & 7U;
    bool matches = false;
    switch (filter >> 30U) {
      case 0U:
        matches = (id >= first) && (id <= second);
        break;
      case 1U:
        matches = (id == first) || (id == second);
        break;
      case 2U:
        matches = ((id ^ first) & second) == 0U;
        break;
      default:
        break;
    }
    if (matches && (element != 0U)) {
      return (element == 1U) ? 0 : ((element == 2U) ? 1 : -1);
    }
  }
  const uint32_t rest = (global >> 4U) & 3U;
  return (rest == 0U) ? 0 : ((rest == 1U) ? 1 : -1);
}

static void receive(fdcan_model *can, const crux_frame *frame) {
  if (!is_joined(can)) {
    return;
  }
  if (can->disturbed) {
    can->receive_errors += (can->receive_errors < PASSIVE_LEVEL) ? 1U : 0U;
    show_errors(can, PSR_LEC_BIT0);
    return;
  }
  can->receive_errors -= (can->receive_errors > 0U) ? 1U : 0U;
  const int number = accepted_by(can, frame->id);
  if (number < 0) {
    return;
  }
  fdcan_fifo *fifo = &can->fifo[number];
  const uint32_t shift = (number == 0) ? 0U : 3U;
  if (fifo->fill == FIFO_LENGTH) {
    fifo->lost = true;
    can->registers[IR] |= IR_RF0L << shift;
    can->overruns++;
    return;
  }
  uint32_t code = 0U;
  while (lengths[code] < frame->length) {
    code++;
  }
  uint32_t *element = &can->ram[((number == 0) ? RECEIVE_FIFO0 : RECEIVE_FIFO1) + (ELEMENT_WORDS * fifo->put)];
  element[0] = (uint32_t)frame->id << 18U;
  element[1] = (code << 16U) | (is_classic(can) ? 0U : (3U << 20U));
  (void)memcpy(&element[2], frame->data, frame->length);
  fifo->put = (fifo->put + 1U) % FIFO_LENGTH;
  fifo->fill++;
  can->registers[IR] |= ((fifo->fill == FIFO_LENGTH) ? (IR_RF0N | IR_RF0F) : IR_RF0N) << shift;
}

static void expect(fdcan_model *can, uint64_t arrives, const crux_frame *frame) {
  if (can->coming_count == FDCAN_WAITING) {
    can->overruns++;
    return;
  }
  can->coming[(can->coming_first + can->coming_count) % FDCAN_WAITING] =
      (fdcan_waiting){.frame = *frame, .arrives = arrives};
  can->coming_count++;
}

void fdcan_model_hear(fdcan_model *can, uint64_t now, const crux_frame *frame) {
  can->idle_at = (can->idle_at < now) ? now : can->idle_at;
  can->idle_at += (can->kernel_hz > 0U) ? duration(can, frame->length) : 0U;
  expect(can, can->idle_at, frame);
}

void fdcan_model_flood(fdcan_model *can, uint64_t now, const crux_frame *frame, uint32_t count) {
  can->idle_at = (can->idle_at < now) ? now : can->idle_at;
  for (uint32_t i = 0U; i < count; i++) {
    expect(can, can->idle_at, frame);
  }
}

// --- sending ---

static const uint32_t *transmit_buffer(const fdcan_model *can, uint32_t index) {
  return &can->ram[TRANSMIT_BUFFERS + (ELEMENT_WORDS * index)];
}

static uint32_t buffer_length(const fdcan_model *can, uint32_t index) {
  return lengths[(transmit_buffer(can, index)[1] >> 16U) & 0xFU];
}

void fdcan_begin_to_send(fdcan_model *can, uint64_t now) {
  if ((can->transmit_count > 0U) && (can->sent_at == NEVER) && is_joined(can)) {
    if (can->disturbed) {
      can->sent_at = now + (((uint64_t)can->kernel_hz * ERROR_FRAME_BITS) / can->bit_rate);
    } else {
      can->idle_at = (can->idle_at < now) ? now : can->idle_at;
      can->idle_at += duration(can, buffer_length(can, can->transmit_order[0]));
      can->sent_at = can->idle_at;
    }
  }
}

static void remove_first(fdcan_model *can) {
  can->transmit_count--;
  can->transmit_order[0] = can->transmit_order[1];
  can->transmit_order[1] = can->transmit_order[2];
}

static void finish_sending(fdcan_model *can) {
  const uint64_t at = can->sent_at;
  const uint32_t index = can->transmit_order[0];
  can->sent_at = NEVER;
  if (can->disturbed) {
    can->transmit_errors += ERROR_STEP;
    if (can->transmit_errors >= OFF_LEVEL) {
      leave_bus(can);
    }
    show_errors(can, PSR_LEC_BIT0);
  } else {
    const uint32_t *element = transmit_buffer(can, index);
    if (can->outbox_count < FDCAN_WAITING) {
      crux_frame *frame = &can->outbox[(can->outbox_first + can->outbox_count) % FDCAN_WAITING];
      frame->id = (uint16_t)((element[0] >> 18U) & 0x7FFU);
      frame->length = (uint8_t)buffer_length(can, index);
      (void)memcpy(frame->data, &element[2], frame->length);
      can->outbox_count++;
    }
    can->transmit_errors -= (can->transmit_errors > 0U) ? 1U : 0U;
    can->registers[TXBRP] &= ~(1U << index);
    can->registers[TXBTO] |= 1U << index;
    can->registers[IR] |= ((can->registers[TXBTIE] >> index) & 1U) != 0U ? IR_TC : 0U;
    remove_first(can);
    show_errors(can, PSR_LEC_NONE);
  }
  fdcan_begin_to_send(can, at);
}

void fdcan_request_transmission(fdcan_model *can, uint64_t now, uint32_t bits) {
  for (uint32_t i = 0U; i < 3U; i++) {
    if ((((bits & ~can->registers[TXBRP]) >> i) & 1U) != 0U) {
      can->registers[TXBRP] |= 1U << i;
      can->registers[TXBTO] &= ~(1U << i);
      can->transmit_order[can->transmit_count] = i;
      can->transmit_count++;
    }
  }
  fdcan_begin_to_send(can, now);
}

// --- time ---

uint64_t fdcan_model_next(const fdcan_model *can) {
  uint64_t next = (can->sent_at < can->back_at) ? can->sent_at : can->back_at;
  if (can->coming_count > 0U) {
    const uint64_t arrives = can->coming[can->coming_first].arrives;
    next = (arrives < next) ? arrives : next;
  }
  return next;
}

void fdcan_model_advance(fdcan_model *can, uint64_t now) {
  while ((can->coming_count > 0U) && (can->coming[can->coming_first].arrives <= now)) {
    receive(can, &can->coming[can->coming_first].frame);
    can->coming_first = (can->coming_first + 1U) % FDCAN_WAITING;
    can->coming_count--;
  }
  while (can->sent_at <= now) {
    finish_sending(can);
  }
  if (can->back_at <= now) {
    can->back_at = NEVER;
    can->off = false;
    can->transmit_errors = 0U;
    can->receive_errors = 0U;
    show_errors(can, PSR_LEC_UNCHANGED);
    fdcan_begin_to_send(can, now);
  }
}

bool fdcan_model_fetch(fdcan_model *can, crux_frame *frame) {
  const bool found = can->outbox_count > 0U;
  if (found) {
    *frame = can->outbox[can->outbox_first];
    can->outbox_first = (can->outbox_first + 1U) % FDCAN_WAITING;
    can->outbox_count--;
  }
  return found;
}
