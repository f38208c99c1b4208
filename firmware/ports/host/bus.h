/// A CAN FD bus of the host: python-can's udp_multicast (udp:GROUP:PORT), SocketCAN (socketcan:NAME), or a bus in this
/// process (memory:), whose other end is crux_bus_put and crux_bus_get.
#ifndef CRUX_FIRMWARE_BUS_H
#define CRUX_FIRMWARE_BUS_H

#include <stdbool.h>
#include <stddef.h>

#include "frame.h"

/// Most frames that one receive or send call handles at once.
#define CRUX_BUS_BATCH 32

/// Most frames that wait at one end of a bus in memory: those of some cycles.
#define CRUX_BUS_WAITING 128U

typedef enum crux_bus_kind { CRUX_BUS_UDP, CRUX_BUS_SOCKETCAN, CRUX_BUS_MEMORY } crux_bus_kind;

/// Frames on their way in one direction, in order.
typedef struct crux_bus_queue {
  crux_frame frames[CRUX_BUS_WAITING];
  uint32_t put;
  uint32_t taken;
} crux_bus_queue;

typedef struct crux_bus {
  crux_bus_kind kind;
  int receive_fd;  ///< to poll for input; -1: closed, or in memory
  int send_fd;
  crux_bus_queue in;   ///< memory: to this end
  crux_bus_queue out;  ///< memory: from this end
} crux_bus;

/// Opens the bus a URL names. On failure false, with the reason in `error`.
bool crux_bus_open(crux_bus *bus, const char *url, char *error, size_t error_size);

void crux_bus_close(crux_bus *bus);

/// Fetches what has arrived, without waiting and without the bus's own frames: up to CRUX_BUS_BATCH datagrams, of which
/// `*count` are frames for us. Returns the number of datagrams (CRUX_BUS_BATCH: there may be more), -1 with errno set.
int crux_bus_receive(crux_bus *bus, crux_frame frames[CRUX_BUS_BATCH], int *count);

/// Sends frames in order; false with errno set when the system refuses.
bool crux_bus_send(crux_bus *bus, const crux_frame *frames, int count);

/// The other end of a bus in memory: false when the queue is full, or empty.
bool crux_bus_put(crux_bus *bus, const crux_frame *frame);
bool crux_bus_get(crux_bus *bus, crux_frame *frame);

#endif
