#pragma once

#include <linux/can.h>
#include <sys/socket.h>

#include <array>
#include <string_view>

#include "bus/bus.hpp"
#include "bus/descriptor.hpp"

namespace crux {

/// A CAN FD interface of the Linux kernel, as raw frames.
class SocketCanBus final : public Bus {
 public:
  /// @throws BusError when the kernel has no SocketCAN, or no CAN FD interface of that name
  explicit SocketCanBus(std::string_view interface);

  std::size_t send(std::span<const Frame> frames) noexcept override;
  std::size_t receive(std::span<Frame> frames) noexcept override;
  [[nodiscard]] int descriptor() const noexcept override { return socket_.get(); }

 private:
  static constexpr std::size_t kBatch = 32;

  Descriptor socket_;
  std::array<canfd_frame, kBatch> buffers_{};
  std::array<iovec, kBatch> parts_{};
  std::array<mmsghdr, kBatch> headers_{};
};

/// Between crux's frames and the kernel's. `from_kernel` returns false for a frame of a size the kernel never sends.
std::size_t to_kernel(const Frame& frame, canfd_frame& out) noexcept;
bool from_kernel(const canfd_frame& in, std::size_t bytes, Frame& frame) noexcept;

}  // namespace crux
