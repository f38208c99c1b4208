#include "lcm/plan_assembly.hpp"

#include <algorithm>

namespace crux {
namespace {

using crux_msgs::plan_piece_t;

constexpr std::size_t kSha256Digits = 64;

std::string range(const std::string& what, std::int64_t value, std::int64_t from, std::int64_t to) {
  if (value >= from && value <= to) return "";
  return what + " is " + std::to_string(value) + ", right is " + std::to_string(from) + " to " + std::to_string(to);
}

/// What is wrong with a piece by itself.
std::string defect(const plan_piece_t& piece) {
  std::string reason = range("total_bytes", piece.total_bytes, 1, PlanAssembly::kMaxPlanBytes);
  if (reason.empty())
    reason = range("n_pieces", piece.n_pieces, 1, std::min(PlanAssembly::kMaxPieces, piece.total_bytes));
  if (reason.empty()) reason = range("piece", piece.piece, 0, piece.n_pieces - 1);
  if (reason.empty())
    reason = range("n_bytes", piece.n_bytes, 1, std::min<std::int32_t>(plan_piece_t::MAX_BYTES, piece.total_bytes));
  if (reason.empty() && piece.bytes_sha256.size() != kSha256Digits)
    reason = "bytes_sha256 has " + std::to_string(piece.bytes_sha256.size()) +
             " characters, right are 64 hexadecimal digits";
  return reason;
}

}  // namespace

bool PlanAssembly::belongs(const plan_piece_t& piece) const {
  return n_pieces_ > 0 && piece.transfer_id == transfer_id_ && piece.plan_id == plan_id_ &&
         piece.bytes_sha256 == bytes_sha256_ && piece.total_bytes == total_bytes_ && piece.n_pieces == n_pieces_;
}

std::string PlanAssembly::take(const plan_piece_t& piece) {
  if (std::string reason = defect(piece); !reason.empty()) return reason;
  if (!belongs(piece)) {
    clear();
    transfer_id_ = piece.transfer_id;
    plan_id_ = piece.plan_id;
    bytes_sha256_ = piece.bytes_sha256;
    total_bytes_ = piece.total_bytes;
    n_pieces_ = piece.n_pieces;
    pieces_.resize(static_cast<std::size_t>(n_pieces_));
  }
  // The newest bytes of a piece count: a damaged one is replaced by sending it again.
  std::vector<std::uint8_t>& place = pieces_[static_cast<std::size_t>(piece.piece)];
  if (place.empty()) ++n_received_;
  n_bytes_ += piece.n_bytes - static_cast<std::int32_t>(place.size());
  place = piece.data;
  const std::int32_t missing = n_pieces_ - n_received_;  // each has one byte at least
  if (n_bytes_ + missing > total_bytes_ || (missing == 0 && n_bytes_ != total_bytes_)) {
    clear();
    return "the pieces do not add up to total_bytes, " + std::to_string(piece.total_bytes);
  }
  return "";
}

std::vector<std::uint8_t> PlanAssembly::bytes() const {
  std::vector<std::uint8_t> all;
  all.reserve(static_cast<std::size_t>(total_bytes_));
  for (const auto& piece : pieces_) all.insert(all.end(), piece.begin(), piece.end());
  return all;
}

void PlanAssembly::clear() { *this = PlanAssembly(); }

}  // namespace crux
