/// Messages longer than a frame: ISO 15765-2 over CAN FD with 11-bit identifiers and normal addressing. One message at
/// a time in each direction. No clock, no driver, no allocation: time comes from crux_isotp_tick.
#ifndef CRUX_FIRMWARE_ISOTP_H
#define CRUX_FIRMWARE_ISOTP_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"

/// Longest message that is taken in, and longest that is sent.
#define CRUX_ISOTP_RECEIVED_CAPACITY 1024U
#define CRUX_ISOTP_SENT_CAPACITY 256U

/// Gap between consecutive frames that we ask a sender for: at 64 bytes a frame 4 % of the bus, beside the control
/// cycle.
#define CRUX_ISOTP_SEPARATION_MS 5U

/// N_Bs and N_Cr: silence after which a transfer is given up.
#define CRUX_ISOTP_TIMEOUT_US 1000000U

/// N_WFTmax: flow control frames that say "wait", in a row, before a transfer is given up.
#define CRUX_ISOTP_MOST_WAITS 10U

typedef enum crux_isotp_receiving {
  CRUX_ISOTP_LISTENS,   ///< for a new message
  CRUX_ISOTP_RECEIVES,  ///< consecutive frames
  CRUX_ISOTP_RECEIVED   ///< a whole message waits to be fetched
} crux_isotp_receiving;

typedef enum crux_isotp_sending {
  CRUX_ISOTP_QUIET,
  CRUX_ISOTP_BEGINS,  ///< single or first frame is due
  CRUX_ISOTP_WAITS,   ///< for flow control
  CRUX_ISOTP_SENDS    ///< consecutive frames
} crux_isotp_sending;

typedef struct crux_isotp {
  uint16_t receive_id;
  uint16_t send_id;
  // what comes in
  crux_isotp_receiving receiving;
  uint32_t silent_us;
  uint16_t length;
  uint16_t filled;
  uint8_t next_number;
  uint8_t frame_length;  ///< of the first frame, and so of all but the last
  bool answer_due;       ///< flow control
  uint8_t answer;        ///< its status
  uint8_t message[CRUX_ISOTP_RECEIVED_CAPACITY];
  // what goes out
  crux_isotp_sending sending;
  uint32_t waited_us;
  uint32_t separation_us;
  uint16_t to_send;
  uint16_t sent;
  uint8_t number;
  uint8_t block_left;  ///< frames until the next flow control; 0: no limit
  uint8_t waits;
  uint8_t answer_message[CRUX_ISOTP_SENT_CAPACITY];
} crux_isotp;

void crux_isotp_init(crux_isotp *isotp, uint16_t receive_id, uint16_t send_id);

/// Takes a frame from the bus. Other identifiers and what breaks the standard are ignored.
void crux_isotp_on_frame(crux_isotp *isotp, const crux_frame *frame);

/// Time passes.
void crux_isotp_tick(crux_isotp *isotp, uint32_t dt_us);

/// The message that has come in whole, or NULL; it stays, and no other comes in, until crux_isotp_done.
const uint8_t *crux_isotp_message(const crux_isotp *isotp, uint16_t *length);
void crux_isotp_done(crux_isotp *isotp);

/// Begins to send 1..CRUX_ISOTP_SENT_CAPACITY bytes. False when they are too many or a message is still on its way.
bool crux_isotp_send(crux_isotp *isotp, const uint8_t *message, uint16_t length);

/// Whether a message is on its way out.
bool crux_isotp_is_sending(const crux_isotp *isotp);

/// The next frame that is due now; false when there is none.
bool crux_isotp_take_frame(crux_isotp *isotp, crux_frame *frame);

#endif
