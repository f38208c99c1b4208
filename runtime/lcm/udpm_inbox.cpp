#include "lcm/udpm_inbox.hpp"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <stdexcept>

namespace crux {
namespace {

constexpr std::string_view kUdp = "udpm://", kTtl = "ttl=";
constexpr std::uint32_t kWhole = 0x4c433032;            // "LC02": a message in one datagram
constexpr std::size_t kHeader = 2 * sizeof kWhole;      // that word, and a sequence number
constexpr int kUdpHeader = 8, kReceiveBytes = 8 << 20;  // the kernel gives as much as it may

struct Place {
  sockaddr_in group{};
  bool stays_here = true;
};

bool parse(std::string_view text, std::uint16_t& number) {
  return std::from_chars(text.data(), text.data() + text.size(), number).ec == std::errc{};
}

Place place_of(std::string_view url) {
  Place place;
  const std::string_view rest = url.substr(kUdp.size()), address = rest.substr(0, rest.find('?'));
  const std::size_t colon = address.find(':'), ttl = rest.find(kTtl);
  std::uint16_t port = 0, hops = 0;
  if (colon == std::string_view::npos || !parse(address.substr(colon + 1), port) ||
      (ttl != std::string_view::npos && !parse(rest.substr(ttl + kTtl.size()), hops)) ||
      ::inet_pton(AF_INET, std::string(address.substr(0, colon)).c_str(), &place.group.sin_addr) != 1)
    throw std::runtime_error("no address");
  place.group.sin_family = AF_INET;
  place.group.sin_port = htons(port);
  place.stays_here = hops == 0;
  return place;
}

constexpr std::uint32_t word(const char (&text)[5]) {
  std::uint32_t all = 0;
  for (int i = 0; i < 4; ++i) all = all << 8U | static_cast<std::uint8_t>(text[i]);
  return all;
}

/// Whole messages alone, on the channels of tools by the first letters of their names; with `here` of them what the
/// kernel has looped back of multicasts from here, and what comes in by the loopback interface.
bool filter(int fd, bool here) {
  constexpr auto kOf = [](int what) { return static_cast<std::uint32_t>(SKF_AD_OFF + what); };
  const std::uint32_t loopback = ::if_nametoindex("lo");
  std::array<sock_filter, 13> program = {{
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kUdpHeader),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kWhole, 0, 10),
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kUdpHeader + kHeader + sizeof "CRUX" - 1),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, word("_SIG"), 2, 0),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, word("_COM"), 1, 0),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, word("_PLA"), 0, 6),
      BPF_JUMP(BPF_JMP | BPF_JA, here ? 0U : 4U, 0, 0),
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kOf(SKF_AD_PKTTYPE)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, PACKET_LOOPBACK, 2, 0),
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kOf(SKF_AD_IFINDEX)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, loopback, 0, 1),
      BPF_STMT(BPF_RET | BPF_K, UINT32_MAX),
      BPF_STMT(BPF_RET | BPF_K, 0),
  }};
  const sock_fprog all{.len = program.size(), .filter = program.data()};
  return ::setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &all, sizeof all) == 0;
}

template <class Value>
bool set(int fd, int level, int option, const Value& value) {
  return ::setsockopt(fd, level, option, &value, sizeof value) == 0;
}

}  // namespace

UdpmInbox::UdpmInbox(const std::string& url) : buffers_(std::make_unique<decltype(buffers_)::element_type>()) {
  const Place place = place_of(url);
  const ip_mreq group{.imr_multiaddr = place.group.sin_addr, .imr_interface = {.s_addr = htonl(INADDR_ANY)}};
  fd_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (!set(fd_, SOL_SOCKET, SO_RCVBUFFORCE, kReceiveBytes)) set(fd_, SOL_SOCKET, SO_RCVBUF, kReceiveBytes);
  // LCM's programs share the port. The filter stands before the first message.
  if (set(fd_, SOL_SOCKET, SO_REUSEADDR, 1) && set(fd_, SOL_SOCKET, SO_REUSEPORT, 1) && filter(fd_, place.stays_here) &&
      ::bind(fd_, reinterpret_cast<const sockaddr*>(&place.group), sizeof place.group) == 0 &&
      set(fd_, IPPROTO_IP, IP_ADD_MEMBERSHIP, group))
    return;
  const std::string reason = std::strerror(errno);
  ::close(fd_);
  throw std::runtime_error(reason);
}

UdpmInbox::~UdpmInbox() { ::close(fd_); }

void UdpmInbox::drain(const Handler& handler) {
  std::array<mmsghdr, kBatch> messages{};
  std::array<sockaddr_in, kBatch> senders{};
  std::array<iovec, kBatch> places{};
  for (std::size_t done = 0; done < kMost;) {
    for (std::size_t i = 0; i < kBatch; ++i) {
      places[i] = {.iov_base = (*buffers_)[i].data(), .iov_len = kDatagram};
      messages[i].msg_hdr = {};
      messages[i].msg_hdr.msg_name = &senders[i];
      messages[i].msg_hdr.msg_namelen = sizeof senders[i];
      messages[i].msg_hdr.msg_iov = &places[i];
      messages[i].msg_hdr.msg_iovlen = 1;
    }
    const int got = ::recvmmsg(fd_, messages.data(), kBatch, MSG_DONTWAIT, nullptr);
    for (int i = 0; i < got; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const std::span<const std::uint8_t> all((*buffers_)[k].data(), messages[k].msg_len);
      if (all.size() <= kHeader) continue;
      const std::span<const std::uint8_t> rest = all.subspan(kHeader);
      const auto* end = static_cast<const std::uint8_t*>(std::memchr(rest.data(), 0, rest.size()));
      if (end == nullptr) continue;
      const auto length = static_cast<std::size_t>(end - rest.data());
      const std::uint64_t sender = std::uint64_t{senders[k].sin_addr.s_addr} << 16U | senders[k].sin_port;
      handler(sender, {reinterpret_cast<const char*>(rest.data()), length}, rest.subspan(length + 1));
    }
    if (got < static_cast<int>(kBatch)) return;
    done += kBatch;
  }
}

}  // namespace crux
