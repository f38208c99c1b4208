// Faults that were seen in one cycle, or that stand.
#pragma once

#include <algorithm>
#include <array>
#include <crux_msgs/faults.hpp>
#include <cstddef>

namespace crux {

using crux_msgs::FaultCode;

struct FaultEvent {
  FaultCode code = FaultCode::kNone;
  int limb = -1;
  int node = 0;  ///< CAN node on the limb's bus, 0: none
  double value = 0.0;
  double limit = 0.0;

  explicit operator bool() const { return code != FaultCode::kNone; }
  bool same(const FaultEvent& other) const { return code == other.code && limb == other.limb && node == other.node; }
};

/// In the order in which they came; each fault of each place once.
class FaultList {
 public:
  static constexpr std::size_t kMost = 32;

  FaultList() = default;
  FaultList(const FaultEvent& fault) noexcept { add(fault); }  // NOLINT(google-explicit-constructor)

  /// False where there is none to add, it is there already, or the list is full.
  bool add(const FaultEvent& fault) noexcept {
    if (!fault || size_ == kMost || std::any_of(begin(), end(), [&](const auto& f) { return f.same(fault); }))
      return false;
    faults_[size_++] = fault;
    return true;
  }
  /// False where there was none of that code.
  bool remove(FaultCode code) noexcept {
    const auto* kept =
        std::remove_if(faults_.data(), faults_.data() + size_, [&](const auto& f) { return f.code == code; });
    const std::size_t before = size_;
    size_ = static_cast<std::size_t>(kept - begin());
    return size_ < before;
  }
  void clear() noexcept { size_ = 0; }

  bool empty() const noexcept { return size_ == 0; }
  std::size_t size() const noexcept { return size_; }
  const FaultEvent& operator[](std::size_t i) const noexcept { return faults_[i]; }
  const FaultEvent* begin() const noexcept { return faults_.data(); }
  const FaultEvent* end() const noexcept { return faults_.data() + size_; }

 private:
  std::array<FaultEvent, kMost> faults_{};
  std::size_t size_ = 0;
};

}  // namespace crux
