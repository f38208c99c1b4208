// A queue from one thread to another that neither locks nor allocates after construction.
#pragma once

#include <atomic>
#include <bit>
#include <cstddef>
#include <vector>

namespace crux {

/// Single producer, single consumer. Slots are built once and used in place: the producer fills the slot it gets from
/// `back()` and publishes it, the consumer reads `front()` and gives it back.
template <class T>
class SpscRing {  // NOLINT(clang-analyzer-optin.performance.Padding): the padding is the point, see below
 public:
  /// @param capacity at least 1; rounded up to a power of two
  explicit SpscRing(std::size_t capacity) : slots_(std::bit_ceil(capacity)) {}

  /// Producer: the slot to fill next, nullptr while the ring is full.
  T* back() noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_.load(std::memory_order_acquire) == slots_.size()) return nullptr;
    return &slots_[tail & (slots_.size() - 1)];
  }
  /// Producer: hands over the slot that `back()` gave.
  void push() noexcept { tail_.store(tail_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }

  /// Consumer: the oldest slot, nullptr when the ring is empty.
  T* front() noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return nullptr;
    return &slots_[head & (slots_.size() - 1)];
  }
  /// Consumer: gives the slot of `front()` back.
  void pop() noexcept { head_.store(head_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }

  [[nodiscard]] std::size_t capacity() const noexcept { return slots_.size(); }

 private:
  std::vector<T> slots_;
  // Apart from each other, or every push would take the consumer's cache line away.
  alignas(64) std::atomic<std::size_t> head_{0};
  alignas(64) std::atomic<std::size_t> tail_{0};
};

}  // namespace crux
