#include "fdcan.h"

#include <stddef.h>
#include <string.h>

#include "board.h"
#include "node_table.h"
#include "registers.h"

/// Power of two, some cycles' worth of a node's two identifiers.
#define RING_LENGTH 16U

/// After the current loop, which must not wait; a frame waits in its FIFO, which holds three.
#define PRIORITY 0x10UL

// Time quanta are core clock periods (prescaler 1); the sample point stands at four fifths of a bit.
#define NOMINAL_QUANTA (BOARD_CORE_HZ / NODE_BIT_RATE)
#define NOMINAL_AFTER (NOMINAL_QUANTA / 5UL)
#define NOMINAL_BEFORE (NOMINAL_QUANTA - NOMINAL_AFTER - 1UL)
#define DATA_QUANTA (BOARD_CORE_HZ / NODE_DATA_BIT_RATE)
#define DATA_AFTER (DATA_QUANTA / 5UL)
#define DATA_BEFORE (DATA_QUANTA - DATA_AFTER - 1UL)
_Static_assert((BOARD_CORE_HZ % NODE_BIT_RATE) == 0U, "the nominal bit must be a whole number of clock periods");
_Static_assert((BOARD_CORE_HZ % NODE_DATA_BIT_RATE) == 0U, "the data bit must be a whole number of clock periods");
_Static_assert((NOMINAL_BEFORE <= 256U) && (NOMINAL_AFTER <= 128U), "the nominal bit does not fit into NBTP");
_Static_assert((DATA_BEFORE <= 32U) && (DATA_AFTER <= 16U), "the data bit does not fit into DBTP");

static crux_frame ring[RING_LENGTH];
static volatile uint32_t ring_put;
static volatile uint32_t ring_get;

static const uint8_t lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

void fdcan_on_interrupt(void);

void fdcan_init(uint16_t sync_id, uint16_t command_id) {
  FDCAN_CCCR |= FDCAN_CCCR_INIT;
  while ((FDCAN_CCCR & FDCAN_CCCR_INIT) == 0U) {
  }
  FDCAN_CCCR |= FDCAN_CCCR_CCE | FDCAN_CCCR_FDOE | FDCAN_CCCR_BRSE;
  FDCAN_NBTP = ((NOMINAL_AFTER - 1UL) << 25) | ((NOMINAL_BEFORE - 1UL) << 8) | (NOMINAL_AFTER - 1UL);
  FDCAN_DBTP = FDCAN_DBTP_TDC | ((DATA_BEFORE - 1UL) << 8) | ((DATA_AFTER - 1UL) << 4) | (DATA_AFTER - 1UL);
  FDCAN_TDCR = (DATA_BEFORE + 1UL) << 8;  // secondary sample point at the sample point
  FDCAN_FILTER(0U) = FDCAN_FILTER_TWO_IDS_TO_FIFO0((uint32_t)sync_id, (uint32_t)command_id);
  FDCAN_RXGFC = FDCAN_RXGFC_REJECT_REMOTE | FDCAN_RXGFC_REJECT_OTHERS | FDCAN_RXGFC_STANDARD_FILTERS(1UL);
  FDCAN_IE = FDCAN_IR_RF0N;
  FDCAN_ILS = 0UL;
  FDCAN_ILE = 1UL;
  NVIC_IPR5 = PRIORITY << (8UL * (IRQ_FDCAN1_IT0 - 20UL));
  NVIC_ISER0 = BIT(IRQ_FDCAN1_IT0);
  FDCAN_CCCR &= ~FDCAN_CCCR_INIT;
  while ((FDCAN_CCCR & FDCAN_CCCR_INIT) != 0U) {
  }
}

static void copy_element(crux_frame *frame, const volatile uint32_t *element) {
  frame->id = (uint16_t)((element[0] >> 18) & 0x7FFUL);
  frame->length = lengths[(element[1] >> 16) & 0xFUL];
  for (uint32_t i = 0U; i < (((uint32_t)frame->length + 3U) / 4U); i++) {
    const uint32_t word = element[2U + i];
    (void)memcpy(&frame->data[4U * i], &word, sizeof(word));
  }
}

void fdcan_on_interrupt(void) {
  FDCAN_IR = FDCAN_IR_RF0N;  // cleared before emptying: a frame that comes now raises it again
  while ((FDCAN_RXF0S & 0xFUL) != 0U) {
    const uint32_t index = (FDCAN_RXF0S >> 8) & 3UL;
    // A full ring loses the frame: to the core that is a lost frame, which counters and watchdog see.
    if ((ring_put - ring_get) < RING_LENGTH) {
      copy_element(&ring[ring_put % RING_LENGTH], FDCAN_RX_FIFO0(index));
      ring_put++;
    }
    FDCAN_RXF0A = index;
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

bool fdcan_can_send(void) { return (FDCAN_TXFQS & FDCAN_TXFQS_FULL) == 0U; }

void fdcan_send(const crux_frame *frame) {
  const uint32_t index = (FDCAN_TXFQS >> 16) & 3UL;
  volatile uint32_t *element = FDCAN_TX_BUFFER(index);
  uint32_t code = 0U;
  while (lengths[code] < frame->length) {
    code++;
  }
  element[0] = (uint32_t)frame->id << 18;
  element[1] = (code << 16) | BIT(20) | BIT(21);  // bit-rate switch, FD format
  for (uint32_t i = 0U; i < (((uint32_t)lengths[code] + 3U) / 4U); i++) {
    uint32_t word = 0U;
    (void)memcpy(&word, &frame->data[4U * i], sizeof(word));
    element[2U + i] = word;
  }
  FDCAN_TXBAR = BIT(index);
}

bool fdcan_recover(void) {
  const bool off = (FDCAN_PSR & FDCAN_PSR_BO) != 0U;
  if (off) {
    FDCAN_CCCR &= ~FDCAN_CCCR_INIT;  // the controller then waits for 128 idle sequences by itself
  }
  return off;
}
