#pragma once

#include <linux/can.h>
#include <sys/socket.h>

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "bus/bus.hpp"
#include "bus/controller_errors.hpp"
#include "bus/descriptor.hpp"

namespace crux {

/// A CAN FD interface of the Linux kernel, as raw frames: those of the CAN database, the controller's error frames, and
/// its own frames once they have gone out, all stamped by the kernel. Stays usable while the interface is down or gone,
/// and goes on when it is back.
class SocketCanBus final : public Bus {
 public:
  /// @throws BusError when the kernel has no SocketCAN, or no CAN FD interface of that name
  explicit SocketCanBus(std::string_view interface);

  std::size_t send(std::span<const Frame> frames) noexcept override;
  std::size_t receive(std::span<Frame> frames) noexcept override;
  [[nodiscard]] int descriptor() const noexcept override { return socket_.get(); }
  [[nodiscard]] BusState state() const noexcept override;

 private:
  static constexpr std::size_t kBatch = 32;
  static constexpr std::size_t kControlBytes = 256;  // three time stamps and a counter, with room

  void went_down() noexcept;
  bool bind_to_interface() noexcept;
  bool take(std::size_t index, Frame& frame) noexcept;

  std::string interface_;
  std::vector<can_filter> filters_;
  Descriptor socket_;
  ControllerErrors errors_;
  bool down_ = false;
  bool gone_ = false;  ///< the interface does not exist at present
  bool full_ = false;
  unsigned sends_while_gone_ = 0;
  std::uint32_t kernel_dropped_ = 0;  ///< as the kernel counts them
  std::array<canfd_frame, kBatch> buffers_{};
  std::array<iovec, kBatch> parts_{};
  std::array<std::array<std::byte, kControlBytes>, kBatch> controls_{};
  std::array<mmsghdr, kBatch> headers_{};
};

/// Between crux's frames and the kernel's. `from_kernel` returns false for a frame of a size the kernel never sends.
std::size_t to_kernel(const Frame& frame, canfd_frame& out) noexcept;
bool from_kernel(const canfd_frame& in, std::size_t bytes, Frame& frame) noexcept;

}  // namespace crux
