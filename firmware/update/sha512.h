/// SHA-512 (FIPS 180-4).
#ifndef CRUX_FIRMWARE_SHA512_H
#define CRUX_FIRMWARE_SHA512_H

#include <stddef.h>
#include <stdint.h>

#define CRUX_SHA512_LENGTH 64U

typedef struct crux_sha512 {
  uint64_t state[8];
  uint64_t length;  ///< bytes so far
  uint8_t block[128];
} crux_sha512;

void crux_sha512_init(crux_sha512 *sha);
void crux_sha512_add(crux_sha512 *sha, const uint8_t *bytes, size_t length);
void crux_sha512_end(crux_sha512 *sha, uint8_t digest[CRUX_SHA512_LENGTH]);

#endif
