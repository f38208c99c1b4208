// Who commands the robot: opens signed messages, and lets through what an operator has signed for this run, anew, while
// he has the lease; and HOLD, whenever the holder of a key has signed it. Pure: no LCM, no clock; whatever comes in is
// taken for hostile.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "crux_msgs/command_t.hpp"
#include "crux_msgs/plan_piece_t.hpp"
#include "crux_msgs/signed_t.hpp"
#include "lcm/authorized_keys.hpp"

namespace crux {

/// Why a message is not let through; no reason: it is.
struct Denial {
  std::string reason;
  bool stale = false;   ///< its sender may sign it anew, for what the runtime says of itself now
  bool forged = false;  ///< nobody whose key is known has signed it
  explicit operator bool() const noexcept { return !reason.empty(); }
};

/// What is in a signed message, and whether it is let through.
struct Opened {
  enum class Kind : std::uint8_t { kNothing, kLease, kCommand, kPiece };
  Kind kind = Kind::kNothing;  ///< nothing: the bytes are no signed message
  std::int64_t counter = 0;
  crux_msgs::command_t command{};
  crux_msgs::plan_piece_t piece{};
  std::vector<std::uint8_t> bytes;  ///< of the command or the piece, as encoded
  Denial denial;
  std::string new_holder;  ///< of a lease that nobody had
};

class CommandGate {
 public:
  using Time = std::chrono::steady_clock::time_point;
  using Random = std::function<std::int64_t()>;  ///< gives numbers that nobody can know beforehand

  static constexpr std::chrono::seconds kLease{10};

  /// @param keys none: whoever reaches the runtime commands it
  CommandGate(std::vector<AuthorizedKey> keys, Random random);

  CommandGate(CommandGate&&) = default;  // `holder_` points into `operators_`: no copies
  CommandGate(const CommandGate&) = delete;

  /// Judges a message. One that is let through uses its counter up, and renews its operator's lease.
  Opened open(std::span<const std::uint8_t> message, Time now);

  [[nodiscard]] bool insecure() const noexcept { return operators_.empty(); }
  [[nodiscard]] std::int64_t session() const noexcept { return session_; }
  /// 0: nobody has it.
  [[nodiscard]] std::int64_t lease(Time now) const noexcept { return now < lease_end_ ? lease_ : 0; }
  /// Name of the operator who has it; empty: nobody.
  [[nodiscard]] std::string holder(Time now) const;
  [[nodiscard]] std::chrono::duration<double> left(Time now) const noexcept;

 private:
  struct Operator : AuthorizedKey {
    std::int64_t counter = 0;  ///< the last one used
  };

  Denial refuse_proof(std::span<const std::uint8_t> message, const crux_msgs::signed_t& envelope, bool holds,
                      Operator*& from);
  Denial refuse_lease(const Operator& from, std::int64_t lease, Opened& opened, Time now);

  std::vector<Operator> operators_;
  Random random_;
  std::int64_t session_;
  std::int64_t lease_ = 0;
  const Operator* holder_ = nullptr;
  Time lease_end_;
};

/// Random numbers of the kernel's.
/// @throws std::system_error
std::int64_t unpredictable();

}  // namespace crux
