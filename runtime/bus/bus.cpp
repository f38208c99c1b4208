#include "bus/bus.hpp"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>

#include "bus/socketcan_bus.hpp"
#include "bus/udp_bus.hpp"

namespace crux {
namespace {

constexpr std::string_view kUdp = "udp:", kSocketCan = "socketcan:";

struct UdpName {
  std::string_view group;
  std::uint16_t port;
};

UdpName parse_udp(std::string_view name) {
  const auto wrong = [&](const std::string& what) {
    return BusError("bus '" + std::string(name) + "': " + what + ", for example udp:239.74.163.2:43113");
  };
  const std::string_view rest = name.substr(kUdp.size());
  const std::size_t colon = rest.rfind(':');
  if (colon == std::string_view::npos) throw wrong("a UDP bus is udp:GROUP:PORT");
  const std::string_view digits = rest.substr(colon + 1);
  unsigned port = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  if (error != std::errc{} || end != digits.data() + digits.size() || port < 1 || port > 65535)
    throw wrong("the port '" + std::string(digits) + "' is not a number from 1 to 65535");
  return {rest.substr(0, colon), static_cast<std::uint16_t>(port)};
}

}  // namespace

BusStatistics& BusStatistics::operator+=(const BusStatistics& other) noexcept {
  sent += other.sent;
  received += other.received;
  malformed += other.malformed;
  send_failed += other.send_failed;
  queue_full += other.queue_full;
  interface_down += other.interface_down;
  receive_lost += other.receive_lost;
  error_frames += other.error_frames;
  error_passive += other.error_passive;
  bus_off += other.bus_off;
  restarts += other.restarts;
  unacknowledged += other.unacknowledged;
  return *this;
}

void take_receive_buffer(int socket, std::string_view name) {
  constexpr int kReceiveBufferBytes = 4 << 20;
  // Beyond net.core.rmem_max only a privileged process may go; others get what the machine allows.
  if (::setsockopt(socket, SOL_SOCKET, SO_RCVBUFFORCE, &kReceiveBufferBytes, sizeof kReceiveBufferBytes) != 0 &&
      ::setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &kReceiveBufferBytes, sizeof kReceiveBufferBytes) != 0)
    throw BusError(std::string(name) + ": no receive buffer: " + std::strerror(errno));
}

std::unique_ptr<Bus> open_bus(std::string_view name) {
  if (name.starts_with(kSocketCan)) return std::make_unique<SocketCanBus>(name.substr(kSocketCan.size()));
  if (name.starts_with(kUdp)) {
    const UdpName udp = parse_udp(name);
    return std::make_unique<UdpBus>(udp.group, udp.port);
  }
  throw BusError("bus '" + std::string(name) + "': unknown kind; right are socketcan:NAME and udp:GROUP:PORT");
}

std::array<std::string, 4> consecutive_udp_buses(std::string_view first) {
  if (!first.starts_with(kUdp))
    throw BusError("bus base '" + std::string(first) + "': only udp:GROUP:PORT has consecutive ports");
  const UdpName udp = parse_udp(first);
  std::array<std::string, 4> names;
  if (udp.port + names.size() - 1 > 65535)
    throw BusError("bus base '" + std::string(first) + "': four consecutive ports end above 65535");
  for (std::size_t i = 0; i < names.size(); ++i)
    names[i] = std::string(kUdp) + std::string(udp.group) + ":" + std::to_string(udp.port + i);
  return names;
}

bool wait_readable(std::span<const std::unique_ptr<Bus>> buses, std::chrono::nanoseconds timeout) noexcept {
  std::array<pollfd, 16> polls{};
  const std::size_t n = std::min(buses.size(), polls.size());
  for (std::size_t i = 0; i < n; ++i) polls[i] = {.fd = buses[i]->descriptor(), .events = POLLIN, .revents = 0};
  const auto ns = std::max(timeout, std::chrono::nanoseconds::zero()).count();
  const timespec limit{.tv_sec = ns / 1'000'000'000, .tv_nsec = ns % 1'000'000'000};
  return ::ppoll(polls.data(), n, &limit, nullptr) > 0;
}

}  // namespace crux
