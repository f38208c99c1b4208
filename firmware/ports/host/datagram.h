/// Wire format of python-can's udp_multicast bus: one datagram a frame, a msgpack map of eleven string keys.
#ifndef CRUX_FIRMWARE_DATAGRAM_H
#define CRUX_FIRMWARE_DATAGRAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "frame.h"

/// Longest datagram that a frame becomes.
#define CRUX_DATAGRAM_CAPACITY 320U

/// Writes the frame as CAN FD with bit-rate switch; returns the length in bytes.
size_t crux_datagram_encode(const crux_frame *frame, uint8_t datagram[CRUX_DATAGRAM_CAPACITY]);

/// Reads a datagram whatever the order and width of its entries. False when it is no frame of ours: malformed, remote,
/// error or extended frame, more than 64 bytes.
bool crux_datagram_decode(const uint8_t *datagram, size_t length, crux_frame *frame);

#endif
