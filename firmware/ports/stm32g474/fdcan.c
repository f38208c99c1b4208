#include "fdcan.h"

#include <stddef.h>
#include <string.h>

#include "board.h"
#include "node_table.h"
#include "registers.h"

/// Power of two, some cycles' worth of a node's identifiers.
#define RING_LENGTH 16U

/// After the current loop, which must not wait; a frame waits in its FIFO, which holds three.
#define PRIORITY 0x10UL

// Time quanta are core clock periods (prescaler 1); the sample point stands at four fifths of a bit.
#define QUANTA(rate) (BOARD_CORE_HZ / (rate))
#define AFTER(rate) (QUANTA(rate) / 5UL)
#define BEFORE(rate) (QUANTA(rate) - AFTER(rate) - 1UL)
#define SENSOR_BIT_RATE 1000000UL  ///< of the force/torque sensor
_Static_assert((BOARD_CORE_HZ % NODE_BIT_RATE) == 0U, "the nominal bit must be a whole number of clock periods");
_Static_assert((BOARD_CORE_HZ % NODE_DATA_BIT_RATE) == 0U, "the data bit must be a whole number of clock periods");
_Static_assert((BEFORE(NODE_BIT_RATE) <= 256U) && (AFTER(NODE_BIT_RATE) <= 128U), "the bit does not fit into NBTP");
_Static_assert((BEFORE(SENSOR_BIT_RATE) <= 256U) && (AFTER(SENSOR_BIT_RATE) <= 128U), "the bit does not fit into NBTP");
_Static_assert((BEFORE(NODE_DATA_BIT_RATE) <= 32U) && (AFTER(NODE_DATA_BIT_RATE) <= 16U), "no fit into DBTP");
#define NOMINAL_TIMING(rate) (((AFTER(rate) - 1UL) << 25) | ((BEFORE(rate) - 1UL) << 8) | (AFTER(rate) - 1UL))
#define DATA_TIMING(rate) (((BEFORE(rate) - 1UL) << 8) | ((AFTER(rate) - 1UL) << 4) | (AFTER(rate) - 1UL))

static crux_frame ring[RING_LENGTH];
static volatile uint32_t ring_put;
static volatile uint32_t ring_get;

static const uint8_t lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

void fdcan_on_interrupt(void);

static void leave_bus(uint32_t can) {
  FDCAN_CCCR(can) |= FDCAN_CCCR_INIT;
  while ((FDCAN_CCCR(can) & FDCAN_CCCR_INIT) == 0U) {
  }
  FDCAN_CCCR(can) |= FDCAN_CCCR_CCE;
}

static void set_filter(uint32_t ram, uint32_t index, uint16_t id, uint16_t other_id) {
  FDCAN_FILTER(ram, index) = FDCAN_FILTER_TWO_IDS_TO_FIFO0((uint32_t)id, (uint32_t)other_id);
}

/// Hears the identifiers of the first filters and nothing else.
static void hear_only(uint32_t can, uint32_t filters) {
  FDCAN_RXGFC(can) = FDCAN_RXGFC_REJECT_REMOTE | FDCAN_RXGFC_REJECT_OTHERS | FDCAN_RXGFC_STANDARD_FILTERS(filters);
}

static void join_bus(uint32_t can) {
  FDCAN_CCCR(can) &= ~FDCAN_CCCR_INIT;
  while ((FDCAN_CCCR(can) & FDCAN_CCCR_INIT) != 0U) {
  }
}

void fdcan_init(uint16_t sync_id, uint16_t command_id, uint16_t request_id, uint16_t broadcast_id,
                uint16_t heartbeat_id) {
  leave_bus(FDCAN1);
  FDCAN_CCCR(FDCAN1) |= FDCAN_CCCR_FDOE | FDCAN_CCCR_BRSE;
  FDCAN_NBTP(FDCAN1) = NOMINAL_TIMING(NODE_BIT_RATE);
  FDCAN_DBTP(FDCAN1) = FDCAN_DBTP_TDC | DATA_TIMING(NODE_DATA_BIT_RATE);
  FDCAN_TDCR(FDCAN1) = (BEFORE(NODE_DATA_BIT_RATE) + 1UL) << 8;  // secondary sample point at the sample point
  set_filter(FDCAN1_RAM, 0U, sync_id, command_id);
  set_filter(FDCAN1_RAM, 1U, request_id, broadcast_id);
  set_filter(FDCAN1_RAM, 2U, heartbeat_id, heartbeat_id);
  hear_only(FDCAN1, 3UL);
  FDCAN_IE(FDCAN1) = FDCAN_IR_RF0N;
  FDCAN_ILS(FDCAN1) = 0UL;
  FDCAN_ILE(FDCAN1) = 1UL;
  NVIC_IPR5 = PRIORITY << (8UL * (IRQ_FDCAN1_IT0 - 20UL));
  NVIC_ISER0 = BIT(IRQ_FDCAN1_IT0);
  join_bus(FDCAN1);
}

void fdcan_sensor_init(uint16_t first_id, uint16_t second_id) {
  leave_bus(FDCAN2);
  FDCAN_NBTP(FDCAN2) = NOMINAL_TIMING(SENSOR_BIT_RATE);
  set_filter(FDCAN2_RAM, 0U, first_id, second_id);
  hear_only(FDCAN2, 1UL);
  join_bus(FDCAN2);
}

static void copy_element(crux_frame *frame, const volatile uint32_t *element) {
  frame->id = (uint16_t)((element[0] >> 18) & 0x7FFUL);
  frame->length = lengths[(element[1] >> 16) & 0xFUL];
  for (uint32_t i = 0U; i < (((uint32_t)frame->length + 3U) / 4U); i++) {
    const uint32_t word = element[2U + i];
    (void)memcpy(&frame->data[4U * i], &word, sizeof(word));
  }
}

/// Takes the oldest frame out of a controller's FIFO; false when there is none.
static bool take_element(uint32_t can, uint32_t ram, crux_frame *frame) {
  const uint32_t state = FDCAN_RXF0S(can);
  const bool found = (state & 0xFUL) != 0U;
  if (found) {
    const uint32_t index = (state >> 8) & 3UL;
    copy_element(frame, FDCAN_RX_FIFO0(ram, index));
    FDCAN_RXF0A(can) = index;
  }
  return found;
}

void fdcan_on_interrupt(void) {
  FDCAN_IR(FDCAN1) = FDCAN_IR_RF0N;  // cleared before emptying: a frame that comes now raises it again
  crux_frame frame;
  while (take_element(FDCAN1, FDCAN1_RAM, &frame)) {
    // A full ring loses the frame: to the core that is a lost frame, which counters and watchdog see.
    if ((ring_put - ring_get) < RING_LENGTH) {
      ring[ring_put % RING_LENGTH] = frame;
      ring_put++;
    }
  }
}

bool fdcan_receive(crux_frame *frame) {
  const bool found = ring_put != ring_get;
  if (found) {
    __asm volatile("" ::: "memory");
    *frame = ring[ring_get % RING_LENGTH];
    __asm volatile("" ::: "memory");
    ring_get++;
  }
  return found;
}

static bool can_send(uint32_t can) { return (FDCAN_TXFQS(can) & FDCAN_TXFQS_FULL) == 0U; }

/// `format`: bits of the element's second word beside the length.
static void put_element(uint32_t can, uint32_t ram, const crux_frame *frame, uint32_t format) {
  const uint32_t index = (FDCAN_TXFQS(can) >> 16) & 3UL;
  volatile uint32_t *element = FDCAN_TX_BUFFER(ram, index);
  uint32_t code = 0U;
  while (lengths[code] < frame->length) {
    code++;
  }
  element[0] = (uint32_t)frame->id << 18;
  element[1] = (code << 16) | format;
  for (uint32_t i = 0U; i < (((uint32_t)lengths[code] + 3U) / 4U); i++) {
    uint32_t word = 0U;
    (void)memcpy(&word, &frame->data[4U * i], sizeof(word));
    element[2U + i] = word;
  }
  FDCAN_TXBAR(can) = BIT(index);
}

bool fdcan_can_send(void) { return can_send(FDCAN1); }

bool fdcan_has_sent(void) { return FDCAN_TXBRP(FDCAN1) == 0UL; }

void fdcan_send(const crux_frame *frame) {
  put_element(FDCAN1, FDCAN1_RAM, frame, BIT(20) | BIT(21));  // bit-rate switch, FD format
}

bool fdcan_sensor_receive(crux_frame *frame) { return take_element(FDCAN2, FDCAN2_RAM, frame); }

void fdcan_sensor_send(const crux_frame *frame) {
  if (can_send(FDCAN2)) {
    put_element(FDCAN2, FDCAN2_RAM, frame, 0U);
  }
}

static bool recover(uint32_t can) {
  const bool off = (FDCAN_PSR(can) & FDCAN_PSR_BO) != 0U;
  if (off) {
    FDCAN_CCCR(can) &= ~FDCAN_CCCR_INIT;  // the controller then waits for 128 idle sequences by itself
  }
  return off;
}

bool fdcan_recover(void) { return recover(FDCAN1); }

void fdcan_sensor_recover(void) { (void)recover(FDCAN2); }
