/// A CAN FD bus of the host: python-can's udp_multicast (udp:GROUP:PORT) or SocketCAN (socketcan:NAME).
#ifndef CRUX_FIRMWARE_BUS_H
#define CRUX_FIRMWARE_BUS_H

#include <stdbool.h>
#include <stddef.h>

#include "frame.h"

/// Most frames that one receive or send call handles at once.
#define CRUX_BUS_BATCH 32

typedef struct crux_bus {
  bool is_udp;
  int receive_fd;  ///< to poll for input; -1: closed
  int send_fd;
} crux_bus;

/// Opens the bus a URL names. On failure false, with the reason in `error`.
bool crux_bus_open(crux_bus *bus, const char *url, char *error, size_t error_size);

void crux_bus_close(crux_bus *bus);

/// Fetches what has arrived, without waiting and without the bus's own frames: up to CRUX_BUS_BATCH datagrams, of which
/// `*count` are frames for us. Returns the number of datagrams (CRUX_BUS_BATCH: there may be more), -1 with errno set.
int crux_bus_receive(crux_bus *bus, crux_frame frames[CRUX_BUS_BATCH], int *count);

/// Sends frames in order; false with errno set when the system refuses.
bool crux_bus_send(crux_bus *bus, const crux_frame *frames, int count);

#endif
