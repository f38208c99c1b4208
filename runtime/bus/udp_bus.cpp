#include "bus/udp_bus.hpp"

#include <arpa/inet.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>

namespace crux {
namespace {

template <typename T>
void set_option(int socket, int level, int option, T value, const std::string& what) {
  if (::setsockopt(socket, level, option, &value, sizeof value) != 0)
    throw BusError(what + ": " + std::strerror(errno));
}

}  // namespace

UdpBus::UdpBus(std::string_view group, std::uint16_t port) {
  const std::string name = "bus udp:" + std::string(group) + ":" + std::to_string(port);
  group_.sin_family = AF_INET;
  group_.sin_port = htons(port);
  if (::inet_pton(AF_INET, std::string(group).c_str(), &group_.sin_addr) != 1 ||
      !IN_MULTICAST(ntohl(group_.sin_addr.s_addr)))
    throw BusError(name + ": '" + std::string(group) +
                   "' is not an IPv4 multicast address (224.0.0.0 .. 239.255.255.255)");

  socket_ = Descriptor(::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (socket_.get() < 0) throw BusError(name + ": no socket: " + std::strerror(errno));
  const int fd = socket_.get();
  set_option(fd, SOL_SOCKET, SO_REUSEADDR, 1, name + ": cannot share the port");
  set_option(fd, SOL_SOCKET, SO_REUSEPORT, 1, name + ": cannot share the port");
  take_receive_buffer(fd, name);
  set_option(fd, IPPROTO_IP, IP_MULTICAST_TTL, 0, name + ": cannot keep datagrams on this machine");
  set_option(fd, IPPROTO_IP, IP_MULTICAST_LOOP, 1, name + ": cannot loop datagrams back");
  // Bound to the group, not to any address: buses that differ by group alone must not hear each other.
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&group_), sizeof group_) != 0)
    throw BusError(name + ": cannot bind: " + std::strerror(errno));
  // Not ip_mreqn, which says no more here: qemu's emulation of arm64 programs passes that one on wrongly.
  const ip_mreq membership{.imr_multiaddr = group_.sin_addr, .imr_interface = {INADDR_ANY}};
  set_option(
      fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, membership,
      name +
          ": cannot join the group (a route for 224.0.0.0/4 is needed, for example 'ip route add 224.0.0.0/4 dev lo')");

  for (std::size_t i = 0; i < kBatch; ++i) {
    parts_[i].iov_base = buffers_[i].data();
    headers_[i].msg_hdr.msg_iov = &parts_[i];
    headers_[i].msg_hdr.msg_iovlen = 1;
  }
}

std::size_t UdpBus::send(std::span<const Frame> frames) noexcept {
  std::size_t taken = 0;
  while (taken < frames.size()) {
    const std::size_t n = std::min(frames.size() - taken, kBatch);
    for (std::size_t i = 0; i < n; ++i) {
      parts_[i].iov_len = encode_datagram(frames[taken + i], buffers_[i]);
      headers_[i].msg_hdr.msg_name = &group_;
      headers_[i].msg_hdr.msg_namelen = sizeof group_;
    }
    const int sent = ::sendmmsg(socket_.get(), headers_.data(), static_cast<unsigned>(n), 0);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) break;
    taken += static_cast<std::size_t>(sent);
  }
  statistics_.sent += taken;
  statistics_.send_failed += frames.size() - taken;
  return taken;
}

std::size_t UdpBus::receive(std::span<Frame> frames) noexcept {
  std::size_t written = 0;
  while (written < frames.size()) {
    const std::size_t room = std::min(frames.size() - written, kBatch);
    for (std::size_t i = 0; i < room; ++i) {
      parts_[i].iov_len = kMaxDatagram;
      headers_[i].msg_hdr.msg_name = nullptr;
      headers_[i].msg_hdr.msg_namelen = 0;
    }
    const int n = ::recvmmsg(socket_.get(), headers_.data(), static_cast<unsigned>(room), MSG_DONTWAIT, nullptr);
    if (n <= 0) break;
    for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
      const bool whole = (headers_[i].msg_hdr.msg_flags & MSG_TRUNC) == 0;
      if (whole && decode_datagram({buffers_[i].data(), headers_[i].msg_len}, frames[written]))
        ++written;
      else
        ++statistics_.malformed;
    }
    if (static_cast<std::size_t>(n) < room) break;
  }
  statistics_.received += written;
  return written;
}

}  // namespace crux
