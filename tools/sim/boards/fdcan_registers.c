/// The FDCAN as its registers show it.
#include "fdcan_internal.h"

static uint32_t fifo_state(const fdcan_fifo *fifo) {
  return fifo->fill | (fifo->get << 8U) | (fifo->put << 16U) | ((fifo->fill == FIFO_LENGTH) ? (1U << 24U) : 0U) |
         (fifo->lost ? (1U << 25U) : 0U);
}

static uint32_t queue_state(const fdcan_model *can) {
  const uint32_t pending = can->registers[TXBRP];
  uint32_t put = 0U;
  while ((put < 2U) && (((pending >> put) & 1U) != 0U)) {
    put++;
  }
  const uint32_t oldest = (can->transmit_count > 0U) ? can->transmit_order[0] : 0U;
  return (3U - can->transmit_count) | (oldest << 8U) | (put << 16U) | ((can->transmit_count == 3U) ? (1U << 21U) : 0U);
}

uint32_t fdcan_model_read(const fdcan_model *can, uint32_t offset) {
  switch (offset / 4U) {
    case RXF0S:
      return fifo_state(&can->fifo[0]);
    case RXF1S:
      return fifo_state(&can->fifo[1]);
    case TXFQS:
      return queue_state(can);
    default:
      return (offset / 4U < FDCAN_REGISTER_WORDS) ? can->registers[offset / 4U] : 0U;
  }
}

static void acknowledge(fdcan_fifo *fifo, uint32_t index) {
  if (fifo->fill > 0U) {
    fifo->fill -= ((index + FIFO_LENGTH - fifo->get) % FIFO_LENGTH) + 1U;
    fifo->fill = (fifo->fill > FIFO_LENGTH) ? 0U : fifo->fill;
    fifo->get = (index + 1U) % FIFO_LENGTH;
    fifo->lost = false;
  }
}

static void write_control(fdcan_model *can, uint64_t now, uint32_t value) {
  const uint32_t before = can->registers[CCCR];
  uint32_t after = value;
  if ((before & CCCR_INIT) == 0U) {
    after &= ~CCCR_CCE;  // only together with INIT
  }
  if ((before & CCCR_CCE) == 0U) {
    after = (after & ~(CCCR_FDOE | CCCR_BRSE)) | (before & (CCCR_FDOE | CCCR_BRSE));
  }
  if ((after & CCCR_INIT) == 0U) {
    after &= ~CCCR_CCE;
    if (can->off && (can->back_at == NEVER)) {
      can->back_at = now + (((uint64_t)can->kernel_hz * RECOVERY_BITS) / can->bit_rate);
    }
  }
  can->registers[CCCR] = after;
  fdcan_begin_to_send(can, now);
}

void fdcan_model_write(fdcan_model *can, uint64_t now, uint32_t offset, uint32_t value) {
  const uint32_t word = offset / 4U;
  const bool unlocked = (can->registers[CCCR] & CCCR_CCE) != 0U;
  switch (word) {
    case CCCR:
      write_control(can, now, value);
      break;
    case IR:
      can->registers[IR] &= ~value;
      break;
    case RXF0A:
      acknowledge(&can->fifo[0], value % FIFO_LENGTH);
      break;
    case RXF1A:
      acknowledge(&can->fifo[1], value % FIFO_LENGTH);
      break;
    case TXBAR:
      fdcan_request_transmission(can, now, value & 7U);
      break;
    case DBTP:
    case NBTP:
    case TDCR:
    case RXGFC:
    case TXBC:
      if (unlocked) {
        can->registers[word] = value;
      }
      break;
    case IE:
    case ILS:
    case ILE:
    case TXBTIE:
      can->registers[word] = value;
      break;
    default:
      break;  // read-only, or of no effect here
  }
}

bool fdcan_model_line(const fdcan_model *can, unsigned line) {
  // ILS groups sources: receive FIFO 0, FIFO 1, status messages, transmit FIFO error, miscellaneous, bit and line
  // errors, protocol errors.
  static const uint32_t groups[7] = {0x7U, 0x38U, 0x1C0U, 0x1E00U, 0xE000U, 0x70000U, 0xF80000U};
  uint32_t on_line = 0U;
  for (unsigned i = 0U; i < 7U; i++) {
    on_line |= (((can->registers[ILS] >> i) & 1U) == line) ? groups[i] : 0U;
  }
  return ((can->registers[ILE] >> line) & 1U) != 0U && (can->registers[IR] & can->registers[IE] & on_line) != 0U;
}
