// One sender's frames under one identifier, told from another's by their counters.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "bus/frame.hpp"

namespace crux {

/// A sender's counter grows by one a frame, so its next frame is 1 to `window` ahead. Any other frame, unless it is the
/// last one again to the byte, is a jump, and nobody knows yet whose: where the counters go on from before the jump,
/// there are two senders; where they go on from the jump, the sender has restarted and nobody heard it say so. After
/// `window` cycles of silence any counter is the sender's.
class StreamWatch {
 public:
  enum class Verdict : std::uint8_t {
    kNext,     ///< the sender's
    kGap,      ///< the sender's; frames before it were lost
    kTwice,    ///< the last one again
    kJumped,   ///< nobody knows yet whose
    kResumed,  ///< the second after a jump: the sender counts anew
    kRival,    ///< there are two senders
  };

  /// @param window cycles, 1..127
  explicit StreamWatch(int window = 1) noexcept : window_(static_cast<std::uint8_t>(window)) {}

  /// Judges a frame whose CRC is right.
  Verdict judge(const Frame& frame) noexcept {
    const std::uint8_t counter = frame.data[kCounterByte];
    const auto ahead = static_cast<std::uint8_t>(counter - counter_);
    const bool jumped_before = jumped_;
    if (!seen_) {
      accept(frame, counter);
      return Verdict::kNext;
    }
    if (ahead == 0 && std::ranges::equal(frame.payload(), last_.payload())) return Verdict::kTwice;
    if (ahead >= 1 && ahead <= window_) {
      accept(frame, counter);
      if (jumped_before) return Verdict::kRival;
      return ahead == 1 ? Verdict::kNext : Verdict::kGap;
    }
    const auto after_jump = static_cast<std::uint8_t>(counter - jumped_counter_);
    if (jumped_before && after_jump >= 1 && after_jump <= window_) {
      accept(frame, counter);
      return Verdict::kResumed;
    }
    jumped_ = true;
    jumped_counter_ = counter;
    return Verdict::kJumped;
  }

  /// A cycle has passed.
  void tick() noexcept {
    silence_ = heard_ ? 0 : silence_ + 1;
    heard_ = false;
    if (silence_ >= window_) forget();
  }

  /// The sender counts anew.
  void forget() noexcept { seen_ = jumped_ = false; }

 private:
  static constexpr std::size_t kCounterByte = 2;

  void accept(const Frame& frame, std::uint8_t counter) noexcept {
    last_ = frame;
    counter_ = counter;
    seen_ = heard_ = true;
    jumped_ = false;
  }

  Frame last_{};
  std::uint8_t window_;
  std::uint8_t counter_ = 0, jumped_counter_ = 0;
  int silence_ = 0;
  bool seen_ = false, heard_ = false, jumped_ = false;
};

}  // namespace crux
