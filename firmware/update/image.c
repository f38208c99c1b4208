#include "image.h"

#include <string.h>

#include "monocypher.h"
#include "sha512.h"

#define ZERO_FROM 24U
#define DIGEST_AT 64U

static const uint8_t MAGIC[8] = {'C', 'R', 'U', 'X', 'I', 'M', 'G', '1'};

static uint32_t word(const uint8_t *bytes) {
  return bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[3] << 24U);
}

/// RFC 8032: h = SHA-512(R, key, message), then the group equation.
static bool is_signed(const uint8_t *header, const uint8_t key[CRUX_IMAGE_KEY]) {
  const uint8_t *signature = &header[CRUX_IMAGE_SIGNED];
  uint8_t digest[CRUX_SHA512_LENGTH];
  uint8_t reduced[32];
  crux_sha512 sha;
  crux_sha512_init(&sha);
  crux_sha512_add(&sha, signature, 32U);
  crux_sha512_add(&sha, key, CRUX_IMAGE_KEY);
  crux_sha512_add(&sha, header, CRUX_IMAGE_SIGNED);
  crux_sha512_end(&sha, digest);
  crypto_eddsa_reduce(reduced, digest);
  return crypto_eddsa_check_equation(signature, key, reduced) == 0;
}

bool crux_image_parse(const uint8_t header[CRUX_IMAGE_HEADER], crux_image *image) {
  bool good = memcmp(header, MAGIC, sizeof(MAGIC)) == 0;
  for (uint32_t i = ZERO_FROM; i < DIGEST_AT; i++) {
    good = good && (header[i] == 0U);
  }
  *image = (crux_image){.kind = word(&header[8]),
                        .version = word(&header[12]),
                        .length = word(&header[16]),
                        .address = word(&header[20]),
                        .digest = &header[DIGEST_AT]};
  return good;
}

bool crux_image_read(const uint8_t header[CRUX_IMAGE_HEADER], const uint8_t key[CRUX_IMAGE_KEY], crux_image *image) {
  return crux_image_parse(header, image) && is_signed(header, key);
}
