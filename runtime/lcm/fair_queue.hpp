// Messages that wait for their turn: a turn each sender, whatever he sends, and memory that is bounded whatever comes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "crux_msgs/channels.hpp"

namespace crux {

class FairQueue {
 public:
  static constexpr std::size_t kSenders = 128, kEach = 256;       ///< more are dropped
  static constexpr std::size_t kBytes = 16 << 20, kSmall = 1024;  ///< beyond so many: one small message a sender

  struct Message {
    std::uint64_t sender;
    crux_msgs::Channel channel;
    std::vector<std::uint8_t> bytes;
  };

  void put(std::uint64_t sender, crux_msgs::Channel channel, std::span<const std::uint8_t> bytes);

  /// The next one: the oldest of the sender who has waited longest for his turn.
  std::optional<Message> take();

  [[nodiscard]] bool empty() const noexcept { return turns_.empty(); }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_; }

 private:
  std::unordered_map<std::uint64_t, std::deque<Message>> waiting_;  ///< by sender; none is empty
  std::deque<std::uint64_t> turns_;                                 ///< of the same senders
  std::size_t bytes_ = 0;
  std::uint64_t dropped_ = 0;
};

}  // namespace crux
