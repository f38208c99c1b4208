// End-to-end protection of every CAN frame (the shape of AUTOSAR E2E profile 5): CRC-16, polynomial 0x1021, initial
// value 0xFFFF, over the payload after the Crc field and then the identifier, low byte first; Counter plus one a frame
// of that identifier. Payload bytes 0..1 hold the Crc little-endian, byte 2 the Counter (crux.dbc).
#ifndef CRUX_E2E_H
#define CRUX_E2E_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CRUX_E2E_HEADER_LENGTH 3u

enum crux_e2e_verdict {
  CRUX_E2E_OK = 0,        // the next frame, or the first one seen
  CRUX_E2E_LOST = 1,      // good, but frames before it were lost
  CRUX_E2E_REPEATED = 2,  // the same counter again: not to be used
  CRUX_E2E_CORRUPT = 3    // wrong CRC or too short: not to be used
};

// What a receiver remembers of one identifier. All zero before the first frame.
struct crux_e2e_receiver {
  bool seen;
  uint8_t counter;  // of the last good frame
};

// CRC of payload[2 .. length) and the identifier. length >= CRUX_E2E_HEADER_LENGTH.
uint16_t crux_e2e_crc(uint32_t identifier, const uint8_t *payload, size_t length);

// Writes counter and CRC into a payload whose other fields are final. length >= CRUX_E2E_HEADER_LENGTH.
void crux_e2e_protect(uint32_t identifier, uint8_t counter, uint8_t *payload, size_t length);

// Judges a received payload; `receiver` moves on only for CRUX_E2E_OK and CRUX_E2E_LOST.
enum crux_e2e_verdict crux_e2e_check(uint32_t identifier, const uint8_t *payload, size_t length,
                                     struct crux_e2e_receiver *receiver);

static inline bool crux_e2e_is_usable(enum crux_e2e_verdict verdict) {
  return verdict == CRUX_E2E_OK || verdict == CRUX_E2E_LOST;
}

#ifdef __cplusplus
}
#endif

#endif
