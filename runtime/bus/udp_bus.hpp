#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <string_view>

#include "bus/bus.hpp"
#include "bus/descriptor.hpp"
#include "bus/udp_codec.hpp"

namespace crux {

/// A CAN bus made of multicast datagrams, the same on the wire as python-can's `udp_multicast`. For benches and tests:
/// it has neither arbitration nor bit timing, and a sender hears its own frames.
class UdpBus final : public Bus {
 public:
  /// @param group IPv4 multicast address, @param port UDP port 1..65535
  /// @throws BusError
  UdpBus(std::string_view group, std::uint16_t port);

  std::size_t send(std::span<const Frame> frames) noexcept override;
  std::size_t receive(std::span<Frame> frames) noexcept override;
  [[nodiscard]] int descriptor() const noexcept override { return socket_.get(); }

 private:
  static constexpr std::size_t kBatch = 32;

  Descriptor socket_;
  sockaddr_in group_{};
  std::array<std::array<std::uint8_t, kMaxDatagram>, kBatch> buffers_{};
  std::array<iovec, kBatch> parts_{};
  std::array<mmsghdr, kBatch> headers_{};
};

}  // namespace crux
