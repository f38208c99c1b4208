/// One CAN FD frame with an 11-bit identifier: all that the node cores know of a bus.
#ifndef CRUX_FIRMWARE_FRAME_H
#define CRUX_FIRMWARE_FRAME_H

#include <stdint.h>

#define CRUX_FRAME_CAPACITY 64U

typedef struct crux_frame {
  uint16_t id;     ///< 11-bit identifier
  uint8_t length;  ///< payload bytes, 0..64
  uint8_t data[CRUX_FRAME_CAPACITY];
} crux_frame;

#endif
