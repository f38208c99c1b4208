#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace crux {

/// One CAN or CAN FD frame. `length` counts payload bytes, never the coded DLC.
struct Frame {
  static constexpr std::size_t kMaxPayload = 64;

  std::uint32_t id = 0;
  std::uint8_t length = 0;
  bool extended = false;
  bool remote = false;
  bool error = false;
  bool fd = true;
  bool bit_rate_switch = true;
  bool error_state = false;
  bool own = false;           ///< sent by this very bus and heard again when it had gone out
  std::int64_t stamp_ns = 0;  ///< when it was received, or had gone out, by the kernel's clock; 0: not stamped
  std::array<std::uint8_t, kMaxPayload> data{};

  [[nodiscard]] std::span<const std::uint8_t> payload() const noexcept { return {data.data(), length}; }
};

}  // namespace crux
