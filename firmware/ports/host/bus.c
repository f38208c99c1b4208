#include "bus.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <linux/filter.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "datagram.h"

#define RECEIVE_BUFFER_BYTES (4 << 20)

static bool fail(char *error, size_t size, const char *url, const char *what) {
  (void)snprintf(error, size, "%s: %s: %s", url, what, strerror(errno));
  return false;
}

static bool fail_url(char *error, size_t size, const char *url, const char *what) {
  (void)snprintf(error, size,
                 "%s: %s; known are udp:GROUP:PORT (udp:239.74.163.2:43113), socketcan:NAME and memory:", url, what);
  return false;
}

/// Reads GROUP:PORT of a udp URL.
static bool parse_group(const char *url, struct sockaddr_in *address) {
  const char *group = url + strlen("udp:");
  const char *colon = strrchr(group, ':');
  char text[INET_ADDRSTRLEN] = {0};
  char *end = NULL;
  if ((colon == NULL) || (colon == group) || ((size_t)(colon - group) >= sizeof(text))) {
    return false;
  }
  (void)memcpy(text, group, (size_t)(colon - group));
  const long port = strtol(colon + 1, &end, 10);
  *address = (struct sockaddr_in){.sin_family = AF_INET};
  if ((*end != '\0') || (port < 1) || (port > 65535) || (inet_pton(AF_INET, text, &address->sin_addr) != 1)) {
    return false;
  }
  address->sin_port = htons((uint16_t)port);
  return IN_MULTICAST(ntohl(address->sin_addr.s_addr));
}

/// Lets the kernel drop our own datagrams, which multicast loops back: those from the sending socket's port.
static bool drop_own(int receive_fd, int send_fd) {
  struct sockaddr_in own = {0};
  socklen_t size = sizeof(own);
  if (getsockname(send_fd, (struct sockaddr *)&own, &size) != 0) {
    return false;
  }
  struct sock_filter code[] = {
      BPF_STMT(BPF_LD | BPF_H | BPF_ABS, 0),  // source port, the first field of the UDP header
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ntohs(own.sin_port), 0, 1),
      BPF_STMT(BPF_RET | BPF_K, 0),
      BPF_STMT(BPF_RET | BPF_K, UINT32_MAX),
  };
  const struct sock_fprog program = {.len = sizeof(code) / sizeof(code[0]), .filter = code};
  return setsockopt(receive_fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof(program)) == 0;
}

static bool open_udp(crux_bus *bus, const char *url, char *error, size_t size) {
  struct sockaddr_in group;
  const int one = 1;
  const int buffer = RECEIVE_BUFFER_BYTES;
  const unsigned char ttl = 0;  // frames never leave the machine
  if (!parse_group(url, &group)) {
    return fail_url(error, size, url, "not a multicast IPv4 group and a port");
  }
  bus->kind = CRUX_BUS_UDP;
  bus->send_fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  bus->receive_fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if ((bus->send_fd < 0) || (bus->receive_fd < 0) ||
      (setsockopt(bus->send_fd, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof(ttl)) != 0) ||
      (connect(bus->send_fd, (const struct sockaddr *)&group, sizeof(group)) != 0)) {
    return fail(error, size, url, "cannot send to the group (is there a route to 224.0.0.0/4?)");
  }
  const struct ip_mreqn membership = {.imr_multiaddr = group.sin_addr};
  // Bound to the group's own address: datagrams of other groups on the same port stay out.
  if ((setsockopt(bus->receive_fd, SOL_SOCKET, SO_REUSEADDR, &one, sizeof(one)) != 0) ||
      (setsockopt(bus->receive_fd, SOL_SOCKET, SO_REUSEPORT, &one, sizeof(one)) != 0) ||
      (setsockopt(bus->receive_fd, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof(buffer)) != 0) ||
      !drop_own(bus->receive_fd, bus->send_fd) ||
      (bind(bus->receive_fd, (const struct sockaddr *)&group, sizeof(group)) != 0) ||
      (setsockopt(bus->receive_fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof(membership)) != 0)) {
    return fail(error, size, url, "cannot join the group");
  }
  return true;
}

static bool open_socketcan(crux_bus *bus, const char *url, char *error, size_t size) {
  const int one = 1;
  const unsigned int index = if_nametoindex(url + strlen("socketcan:"));
  if (index == 0U) {
    return fail(error, size, url, "no such interface");
  }
  const struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = (int)index};
  bus->kind = CRUX_BUS_SOCKETCAN;
  bus->receive_fd = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
  bus->send_fd = bus->receive_fd;
  if (bus->receive_fd < 0) {
    return fail(error, size, url, "this kernel has no SocketCAN");
  }
  // A raw socket does not hear its own frames unless asked to.
  if ((setsockopt(bus->receive_fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &one, sizeof(one)) != 0) ||
      (bind(bus->receive_fd, (const struct sockaddr *)&address, sizeof(address)) != 0)) {
    return fail(error, size, url, "cannot bind");
  }
  return true;
}

bool crux_bus_open(crux_bus *bus, const char *url, char *error, size_t error_size) {
  bool opened = false;
  (void)memset(bus, 0, sizeof(*bus));
  bus->receive_fd = -1;
  bus->send_fd = -1;
  if (strncmp(url, "udp:", strlen("udp:")) == 0) {
    opened = open_udp(bus, url, error, error_size);
  } else if (strncmp(url, "socketcan:", strlen("socketcan:")) == 0) {
    opened = open_socketcan(bus, url, error, error_size);
  } else if (strcmp(url, "memory:") == 0) {
    bus->kind = CRUX_BUS_MEMORY;
    opened = true;
  } else {
    opened = fail_url(error, error_size, url, "unknown kind of bus");
  }
  if (!opened) {
    crux_bus_close(bus);
  }
  return opened;
}

void crux_bus_close(crux_bus *bus) {
  if (bus->receive_fd >= 0) {
    (void)close(bus->receive_fd);
  }
  if ((bus->send_fd >= 0) && (bus->send_fd != bus->receive_fd)) {
    (void)close(bus->send_fd);
  }
  bus->receive_fd = -1;
  bus->send_fd = -1;
}

static bool from_socketcan(const void *bytes, size_t length, crux_frame *frame) {
  struct canfd_frame raw;
  if ((length != CANFD_MTU) && (length != CAN_MTU)) {
    return false;
  }
  (void)memcpy(&raw, bytes, length);
  if (((raw.can_id & ~(canid_t)CAN_SFF_MASK) != 0U) || (raw.len > CRUX_FRAME_CAPACITY)) {
    return false;  // extended, remote or error frame
  }
  frame->id = (uint16_t)raw.can_id;
  frame->length = raw.len;
  (void)memcpy(frame->data, raw.data, raw.len);
  return true;
}

static bool push(crux_bus_queue *queue, const crux_frame *frame) {
  const bool room = (queue->put - queue->taken) < CRUX_BUS_WAITING;
  if (room) {
    queue->frames[queue->put % CRUX_BUS_WAITING] = *frame;
    queue->put++;
  }
  return room;
}

static bool pop(crux_bus_queue *queue, crux_frame *frame) {
  const bool any = queue->put != queue->taken;
  if (any) {
    *frame = queue->frames[queue->taken % CRUX_BUS_WAITING];
    queue->taken++;
  }
  return any;
}

bool crux_bus_put(crux_bus *bus, const crux_frame *frame) { return push(&bus->in, frame); }

bool crux_bus_get(crux_bus *bus, crux_frame *frame) { return pop(&bus->out, frame); }

int crux_bus_receive(crux_bus *bus, crux_frame frames[CRUX_BUS_BATCH], int *count) {
  *count = 0;
  if (bus->kind == CRUX_BUS_MEMORY) {
    while ((*count < CRUX_BUS_BATCH) && pop(&bus->in, &frames[*count])) {
      (*count)++;
    }
    return *count;
  }
  uint8_t packets[CRUX_BUS_BATCH][CRUX_DATAGRAM_CAPACITY];
  struct iovec parts[CRUX_BUS_BATCH];
  struct mmsghdr messages[CRUX_BUS_BATCH];
  for (int i = 0; i < CRUX_BUS_BATCH; i++) {
    parts[i] = (struct iovec){.iov_base = packets[i], .iov_len = sizeof(packets[i])};
    messages[i] = (struct mmsghdr){.msg_hdr = {.msg_iov = &parts[i], .msg_iovlen = 1}};
  }
  const int received = recvmmsg(bus->receive_fd, messages, CRUX_BUS_BATCH, MSG_DONTWAIT, NULL);
  if (received < 0) {
    return ((errno == EAGAIN) || (errno == EINTR)) ? 0 : -1;
  }
  for (int i = 0; i < received; i++) {
    const bool whole = (messages[i].msg_hdr.msg_flags & MSG_TRUNC) == 0;
    if (whole && ((bus->kind == CRUX_BUS_UDP) ? crux_datagram_decode(packets[i], messages[i].msg_len, &frames[*count])
                                              : from_socketcan(packets[i], messages[i].msg_len, &frames[*count]))) {
      (*count)++;
    }
  }
  return received;
}

static size_t encode(const crux_bus *bus, const crux_frame *frame, uint8_t packet[CRUX_DATAGRAM_CAPACITY]) {
  if (bus->kind == CRUX_BUS_UDP) {
    return crux_datagram_encode(frame, packet);
  }
  struct canfd_frame raw = {.can_id = frame->id, .len = frame->length, .flags = CANFD_BRS};
  (void)memcpy(raw.data, frame->data, frame->length);
  (void)memcpy(packet, &raw, sizeof(raw));
  return sizeof(raw);
}

/// What finds no room is lost, as on a bus that nobody listens to.
static bool send_in_memory(crux_bus *bus, const crux_frame *frames, int count) {
  for (int i = 0; i < count; i++) {
    (void)push(&bus->out, &frames[i]);
  }
  return true;
}

bool crux_bus_send(crux_bus *bus, const crux_frame *frames, int count) {
  if (bus->kind == CRUX_BUS_MEMORY) {
    return send_in_memory(bus, frames, count);
  }
  uint8_t packets[CRUX_BUS_BATCH][CRUX_DATAGRAM_CAPACITY];
  struct iovec parts[CRUX_BUS_BATCH];
  struct mmsghdr messages[CRUX_BUS_BATCH];
  int done = 0;
  while (done < count) {
    const int batch = ((count - done) < CRUX_BUS_BATCH) ? (count - done) : CRUX_BUS_BATCH;
    for (int i = 0; i < batch; i++) {
      parts[i] = (struct iovec){.iov_base = packets[i], .iov_len = encode(bus, &frames[done + i], packets[i])};
      messages[i] = (struct mmsghdr){.msg_hdr = {.msg_iov = &parts[i], .msg_iovlen = 1}};
    }
    const int sent = sendmmsg(bus->send_fd, messages, (unsigned int)batch, 0);
    if ((sent < 0) && (errno != EINTR)) {
      return false;
    }
    done += (sent > 0) ? sent : 0;
  }
  return true;
}
