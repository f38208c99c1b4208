// A plan's bytes from its pieces, whatever order, number or damage they arrive in. Pure: no LCM, no clock.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "crux_msgs/plan_piece_t.hpp"

namespace crux {

class PlanAssembly {
 public:
  /// Bounds what a sender can make the runtime keep. A plan of 120 steps has 0.2 MB.
  static constexpr std::int32_t kMaxPlanBytes = 8 << 20;
  static constexpr std::int32_t kMaxPieces = 4096;

  /// Files one piece. Returns why it is refused, empty when it is good. A piece of another transfer ends the one
  /// before; a piece that comes again replaces what it was; pieces that cannot add up to the announced size end their
  /// transfer.
  std::string take(const crux_msgs::plan_piece_t& piece);

  [[nodiscard]] bool complete() const noexcept { return n_pieces_ > 0 && n_received_ == n_pieces_; }

  /// The pieces in order. Only when complete().
  [[nodiscard]] std::vector<std::uint8_t> bytes() const;

  [[nodiscard]] const std::string& bytes_sha256() const noexcept { return bytes_sha256_; }
  [[nodiscard]] std::int64_t transfer_id() const noexcept { return transfer_id_; }

  void clear();

 private:
  [[nodiscard]] bool belongs(const crux_msgs::plan_piece_t& piece) const;

  std::int64_t transfer_id_ = 0;
  std::string plan_id_, bytes_sha256_;
  std::int32_t total_bytes_ = 0, n_pieces_ = 0, n_received_ = 0, n_bytes_ = 0;
  std::vector<std::vector<std::uint8_t>> pieces_;
};

}  // namespace crux
