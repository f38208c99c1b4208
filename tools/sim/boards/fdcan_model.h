/// FDCAN 1 of an STM32G474 as its registers show it: acceptance filters, two receive FIFOs of three, three transmit
/// buffers, interrupts, error counters, bus-off and the way back; and the bus it is joined to, where a frame takes its
/// time. The message RAM stands at a fixed place of its own.
///
/// Not modelled: arbitration against other nodes (frames from outside and own ones wait for each other, no more), bit
/// stuffing, transceiver delay, event FIFO, extended filters.
#ifndef CRUX_EMULATED_FDCAN_MODEL_H
#define CRUX_EMULATED_FDCAN_MODEL_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"

#define FDCAN_REGISTER_WORDS 64U
#define FDCAN_RAM_WORDS 212U
#define FDCAN_WAITING 128U

typedef struct fdcan_fifo {
  uint32_t put;
  uint32_t get;
  uint32_t fill;
  bool lost;
} fdcan_fifo;

typedef struct fdcan_waiting {
  crux_frame frame;
  uint64_t arrives;
} fdcan_waiting;

typedef struct fdcan_model {
  uint32_t registers[FDCAN_REGISTER_WORDS];
  uint32_t ram[FDCAN_RAM_WORDS];
  fdcan_fifo fifo[2];
  uint32_t kernel_hz;  ///< of the clock that bit times are counted in; 0: none
  uint32_t bit_rate;   ///< of the bus
  uint32_t data_bit_rate;
  bool disturbed;  ///< no frame passes: each attempt to send is an error
  bool off;        ///< bus-off
  uint32_t transmit_errors;
  uint32_t receive_errors;
  uint32_t transmit_order[3];  ///< buffers that wait to be sent, oldest first
  uint32_t transmit_count;
  uint64_t sent_at;                     ///< when the frame being sent is out; never: none
  uint64_t back_at;                     ///< when a recovery from bus-off is done
  uint64_t idle_at;                     ///< when the bus is free again
  fdcan_waiting coming[FDCAN_WAITING];  ///< on their way to us
  uint32_t coming_first;
  uint32_t coming_count;
  crux_frame outbox[FDCAN_WAITING];  ///< sent, not fetched yet
  uint32_t outbox_first;
  uint32_t outbox_count;
  uint64_t overruns;  ///< frames lost because a FIFO was full
} fdcan_model;

/// As after a reset; frames sent before it stay sent. Bit rates are those of the bus; a data bit rate of 0: a classic
/// one.
void fdcan_model_reset(fdcan_model *can, uint32_t bit_rate, uint32_t data_bit_rate);

uint32_t fdcan_model_read(const fdcan_model *can, uint32_t offset);
void fdcan_model_write(fdcan_model *can, uint64_t now, uint32_t offset, uint32_t value);

/// A frame of somebody else begins at `now`, or when the bus is free.
void fdcan_model_hear(fdcan_model *can, uint64_t now, const crux_frame *frame);

/// So many of such frames at the same instant, as no bus can bring them: the FIFO is as full as it gets.
void fdcan_model_flood(fdcan_model *can, uint64_t now, const crux_frame *frame, uint32_t count);

/// What was due until `now`.
void fdcan_model_advance(fdcan_model *can, uint64_t now);

/// When fdcan_model_advance has something to do next; UINT64_MAX: not by itself.
uint64_t fdcan_model_next(const fdcan_model *can);

/// Level of interrupt line 0 or 1.
bool fdcan_model_line(const fdcan_model *can, unsigned line);

/// Pops a frame that went out; false when there is none.
bool fdcan_model_fetch(fdcan_model *can, crux_frame *frame);

/// Bit rates the image has set, nominal and data [bit/s]; 0: none.
void fdcan_model_rates(const fdcan_model *can, uint32_t *nominal, uint32_t *data);

#endif
