/// A signed image of a node's firmware, as `crux can sign` writes it: a header that says what it is and holds the
/// payload's digest, signed as a whole; then the payload. Numbers are little-endian.
///
///   0    8   "CRUXIMG1"
///   8    4   kind of node (DBC enumeration NodeKind)
///   12   4   version; a node takes none that is not newer than its own
///   16   4   length of the payload
///   20   4   address the payload is linked for; zero: it fits either slot
///   24   40  zero
///   64   64  SHA-512 of the payload
///   128  64  Ed25519 signature of bytes 0..127
#ifndef CRUX_FIRMWARE_IMAGE_H
#define CRUX_FIRMWARE_IMAGE_H

#include <stdbool.h>
#include <stdint.h>

#define CRUX_IMAGE_HEADER 192U
#define CRUX_IMAGE_SIGNED 128U
#define CRUX_IMAGE_KEY 32U

typedef struct crux_image {
  uint32_t kind;
  uint32_t version;
  uint32_t length;
  uint32_t address;
  const uint8_t *digest;  ///< within the header
} crux_image;

/// What a header says, whoever wrote it; false when it is none.
bool crux_image_parse(const uint8_t header[CRUX_IMAGE_HEADER], crux_image *image);

/// Reads a header; false when it is none, or not signed with the key.
bool crux_image_read(const uint8_t header[CRUX_IMAGE_HEADER], const uint8_t key[CRUX_IMAGE_KEY], crux_image *image);

#endif
