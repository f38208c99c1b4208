/// What the files of the FDCAN share; its users include fdcan_model.h.
#ifndef CRUX_EMULATED_FDCAN_INTERNAL_H
#define CRUX_EMULATED_FDCAN_INTERNAL_H

#include "fdcan_model.h"

#define NEVER UINT64_MAX
#define FIFO_LENGTH 3U

// Registers, by word.
enum {
  CREL = 0x00 / 4,
  DBTP = 0x0C / 4,
  CCCR = 0x18 / 4,
  NBTP = 0x1C / 4,
  ECR = 0x40 / 4,
  PSR = 0x44 / 4,
  TDCR = 0x48 / 4,
  IR = 0x50 / 4,
  IE = 0x54 / 4,
  ILS = 0x58 / 4,
  ILE = 0x5C / 4,
  RXGFC = 0x80 / 4,
  RXF0S = 0x90 / 4,
  RXF0A = 0x94 / 4,
  RXF1S = 0x98 / 4,
  RXF1A = 0x9C / 4,
  TXBC = 0xC0 / 4,
  TXFQS = 0xC4 / 4,
  TXBRP = 0xC8 / 4,
  TXBAR = 0xCC / 4,
  TXBCR = 0xD0 / 4,
  TXBTO = 0xD4 / 4,
  TXBTIE = 0xDC / 4
};

#define CCCR_INIT (1U << 0U)
#define CCCR_CCE (1U << 1U)
#define CCCR_FDOE (1U << 8U)
#define CCCR_BRSE (1U << 9U)

/// Bits that a controller that is off must see pass by before it may join again.
#define RECOVERY_BITS (128U * 11U)

/// Takes the transmit buffers whose bits are set.
void fdcan_request_transmission(fdcan_model *can, uint64_t now, uint32_t bits);

/// Begins with the oldest frame if the bus can be had.
void fdcan_begin_to_send(fdcan_model *can, uint64_t now);

#endif
