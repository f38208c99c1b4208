// The newest value of a thread, for another one that looks at it when it likes.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace crux {

/// One writer, one reader, three slots: neither ever waits, and the reader sees whole values only.
template <class T>
class LatestValue {
 public:
  /// Writer: the slot to fill; publish() makes it the newest value.
  T& slot() noexcept { return slots_[writing_]; }
  void publish() noexcept {
    writing_ = middle_.exchange(static_cast<std::uint8_t>(writing_ | kFresh), std::memory_order_acq_rel) & kIndex;
  }

  /// Reader: the newest value; nullptr when there is none newer than at the last call.
  const T* take() noexcept {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return nullptr;
    reading_ = middle_.exchange(reading_, std::memory_order_acq_rel) & kIndex;
    return &slots_[reading_];
  }

 private:
  static constexpr std::uint8_t kIndex = 0x3, kFresh = 0x4;
  std::array<T, 3> slots_{};
  std::uint8_t writing_ = 0, reading_ = 1;
  std::atomic<std::uint8_t> middle_{2};
};

}  // namespace crux
