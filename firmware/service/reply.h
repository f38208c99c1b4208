/// An answer in the making, and numbers in requests. Little-endian, as everything on these buses but the identifiers of
/// ISO 14229.
#ifndef CRUX_FIRMWARE_REPLY_H
#define CRUX_FIRMWARE_REPLY_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "isotp.h"

typedef struct crux_reply {
  uint16_t length;
  uint8_t bytes[CRUX_ISOTP_SENT_CAPACITY];
} crux_reply;

static inline void crux_reply_add(crux_reply *reply, const void *bytes, size_t length) {
  (void)memcpy(&reply->bytes[reply->length], bytes, length);
  reply->length = (uint16_t)(reply->length + length);
}

static inline void crux_reply_byte(crux_reply *reply, uint8_t byte) { crux_reply_add(reply, &byte, 1U); }

static inline void crux_reply_word(crux_reply *reply, uint32_t word) {
  for (uint32_t i = 0U; i < 4U; i++) {
    crux_reply_byte(reply, (uint8_t)(word >> (8U * i)));
  }
}

static inline uint32_t crux_word_at(const uint8_t *bytes) {
  return bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[3] << 24U);
}

#endif
