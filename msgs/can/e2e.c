#include "e2e.h"

// CRC of the sixteen values of a nibble: small enough for a node's flash, two look-ups a byte.
static const uint16_t NIBBLE_TABLE[16] = {
    0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
    0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF,
};

static uint16_t add_nibble(uint16_t crc, uint8_t nibble) {
  return (uint16_t)((uint16_t)(crc << 4) ^ NIBBLE_TABLE[((crc >> 12) ^ nibble) & 0x0Fu]);
}

static uint16_t add_byte(uint16_t crc, uint8_t byte) {
  return add_nibble(add_nibble(crc, (uint8_t)(byte >> 4)), (uint8_t)(byte & 0x0Fu));
}

uint16_t crux_e2e_crc(uint32_t identifier, const uint8_t *payload, size_t length) {
  uint16_t crc = 0xFFFFu;
  for (size_t i = 2; i < length; ++i) {
    crc = add_byte(crc, payload[i]);
  }
  crc = add_byte(crc, (uint8_t)(identifier & 0xFFu));
  return add_byte(crc, (uint8_t)((identifier >> 8) & 0xFFu));
}

void crux_e2e_protect(uint32_t identifier, uint8_t counter, uint8_t *payload, size_t length) {
  payload[2] = counter;
  const uint16_t crc = crux_e2e_crc(identifier, payload, length);
  payload[0] = (uint8_t)(crc & 0xFFu);
  payload[1] = (uint8_t)(crc >> 8);
}

enum crux_e2e_verdict crux_e2e_check(uint32_t identifier, const uint8_t *payload, size_t length,
                                     struct crux_e2e_receiver *receiver) {
  if (length < CRUX_E2E_HEADER_LENGTH) {
    return CRUX_E2E_CORRUPT;
  }
  const uint16_t received = (uint16_t)(payload[0] | (uint16_t)(payload[1] << 8));
  if (received != crux_e2e_crc(identifier, payload, length)) {
    return CRUX_E2E_CORRUPT;
  }
  const uint8_t step = (uint8_t)(payload[2] - receiver->counter);
  if (receiver->seen && step == 0u) {
    return CRUX_E2E_REPEATED;
  }
  const bool next = !receiver->seen || step == 1u;
  receiver->seen = true;
  receiver->counter = payload[2];
  return next ? CRUX_E2E_OK : CRUX_E2E_LOST;
}
