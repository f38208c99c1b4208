// The CAN frames of a cycle on their way to the log.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "bus/frame.hpp"
#include "crux_msgs/can_frames_t.hpp"

namespace crux {

/// Frames in the order of their coming. It never allocates; what finds no room is counted.
class FrameTape {
 public:
  static constexpr std::size_t kMostFrames = 128, kMostBytes = 4096;  // a cycle of four buses has some 70 and 1100

  struct Entry {
    std::int64_t host_ns, stamp_ns;
    std::int16_t id;
    std::int8_t bus, direction;
    std::uint8_t length;
  };

  /// @param direction of can_frames_t; an ECHO is kept without its payload
  void add(int bus, std::int8_t direction, const Frame& frame, std::int64_t host_ns) noexcept {
    const bool has_data = direction != crux_msgs::can_frames_t::ECHO;
    const auto length = static_cast<std::uint8_t>(has_data ? frame.length : 0);
    if (n_ == kMostFrames || n_bytes_ + length > kMostBytes) {
      ++lost_;
      return;
    }
    entries_[n_++] = {.host_ns = host_ns,
                      .stamp_ns = frame.stamp_ns,
                      .id = static_cast<std::int16_t>(frame.id),
                      .bus = static_cast<std::int8_t>(bus),
                      .direction = direction,
                      .length = length};
    std::copy_n(frame.data.begin(), length, data_.begin() + static_cast<std::ptrdiff_t>(n_bytes_));
    n_bytes_ += length;
  }

  void clear() noexcept { n_ = n_bytes_ = lost_ = 0; }

  /// Leaves this one empty.
  void move_to(FrameTape& other) noexcept {
    std::ranges::copy(entries(), other.entries_.begin());
    std::ranges::copy(data(), other.data_.begin());
    other.n_ = n_;
    other.n_bytes_ = n_bytes_;
    other.lost_ = lost_;
    clear();
  }

  [[nodiscard]] std::span<const Entry> entries() const noexcept { return {entries_.data(), n_}; }
  /// The payloads of all frames, one after the other.
  [[nodiscard]] std::span<const std::uint8_t> data() const noexcept { return {data_.data(), n_bytes_}; }
  [[nodiscard]] std::size_t lost() const noexcept { return lost_; }

 private:
  std::array<Entry, kMostFrames> entries_{};
  std::array<std::uint8_t, kMostBytes> data_{};
  std::size_t n_ = 0, n_bytes_ = 0, lost_ = 0;
};

}  // namespace crux
