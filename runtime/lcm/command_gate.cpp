#include "lcm/command_gate.hpp"

#include <openssl/evp.h>
#include <sys/random.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <memory>
#include <system_error>
#include <utility>

#include "crux_msgs/cdr.hpp"

namespace crux {
namespace {

using crux_msgs::command_t;
using crux_msgs::signed_t;

constexpr std::size_t kSignature = sizeof signed_t{}.signature;

template <class T, void (*free)(T*)>
struct Freed {
  void operator()(T* pointer) const noexcept { free(pointer); }
};

/// Ed25519 (RFC 8032).
bool is_signed(std::span<const std::uint8_t> message, const std::array<std::uint8_t, 32>& key,
               std::span<const std::uint8_t> signature) {
  const std::unique_ptr<EVP_PKEY, Freed<EVP_PKEY, EVP_PKEY_free>> public_key(
      EVP_PKEY_new_raw_public_key(EVP_PKEY_ED25519, nullptr, key.data(), key.size()));
  const std::unique_ptr<EVP_MD_CTX, Freed<EVP_MD_CTX, EVP_MD_CTX_free>> context(EVP_MD_CTX_new());
  return public_key && context &&
         EVP_DigestVerifyInit(context.get(), nullptr, nullptr, nullptr, public_key.get()) == 1 &&
         EVP_DigestVerify(context.get(), signature.data(), signature.size(), message.data(), message.size()) == 1;
}

/// At once: one that is scheduled takes a place from other commands.
bool is_hold(const Opened& opened) {
  return opened.kind == Opened::Kind::kCommand && opened.command.command == command_t::HOLD &&
         opened.command.at_cycle == 0;
}

std::string in_seconds(std::chrono::duration<double> left) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.1f s", left.count());
  return text.data();
}

std::string first_digits(const std::uint8_t* key) {
  std::array<char, 12> text{};
  std::snprintf(text.data(), text.size(), "%02x%02x%02x%02x...", key[0], key[1], key[2], key[3]);
  return text.data();
}

}  // namespace

CommandGate::CommandGate(std::vector<AuthorizedKey> keys, Random random)
    : random_(std::move(random)), session_(random_()) {
  for (AuthorizedKey& key : keys) operators_.push_back({{std::move(key)}, 0});
}

Opened CommandGate::open(std::span<const std::uint8_t> message, Time now) {
  Opened opened;
  signed_t envelope{};
  if (!crux_msgs::decode_lcm(message, envelope)) return opened;
  opened.counter = envelope.counter;
  opened.bytes = std::move(envelope.data);
  if (opened.bytes.empty())
    opened.kind = Opened::Kind::kLease;
  else if (crux_msgs::decode_lcm(opened.bytes, opened.command))
    opened.kind = Opened::Kind::kCommand;
  else if (crux_msgs::decode_lcm(opened.bytes, opened.piece))
    opened.kind = Opened::Kind::kPiece;
  if (insecure() || opened.kind == Opened::Kind::kNothing) return opened;
  Operator* from = nullptr;
  const bool holds = is_hold(opened);
  opened.denial = refuse_proof(message, envelope, holds, from);
  if (opened.denial || from == nullptr || holds) return opened;
  from->counter = envelope.counter;
  if (from->role != Role::kOperate)
    opened.denial = {"key '" + from->name + "' may watch, not operate"};
  else
    opened.denial = refuse_lease(*from, envelope.lease, opened, now);
  return opened;
}

/// The costly signature last: who has no key costs little. Of HOLD it alone counts: whoever wants the robot to stop
/// need know nothing of this run, and a HOLD that is replayed holds the robot again, which is the safe state.
Denial CommandGate::refuse_proof(std::span<const std::uint8_t> message, const signed_t& envelope, bool holds,
                                 Operator*& from) {
  const auto found = std::ranges::find_if(
      operators_, [&envelope](const Operator& each) { return std::ranges::equal(each.key, envelope.key); });
  if (found == operators_.end())
    return {"its key " + first_digits(&envelope.key[0]) + " is not among the keys of this runtime", false, true};
  if (!holds && envelope.session != session_) return {"it was signed for another session of the runtime", true};
  if (!holds && envelope.counter <= found->counter)
    return {"its counter is not above the last one of key '" + found->name +
                "': replayed, overtaken, or from a computer whose clock is behind",
            true};
  if (!is_signed(message.first(message.size() - kSignature), found->key, envelope.signature))
    return {"its signature is wrong: altered, or not signed with key '" + found->name + "'", false, true};
  from = &*found;
  return {};
}

Denial CommandGate::refuse_lease(const Operator& from, std::int64_t lease, Opened& opened, Time now) {
  const bool runs = now < lease_end_;
  if (runs && holder_ != &from)
    return {"operator '" + holder_->name + "' has the lease, for " + in_seconds(left(now)) + " more"};
  if (opened.kind == Opened::Kind::kLease && !runs) {
    do lease_ = random_();
    while (lease_ == 0);
    holder_ = &from;
    opened.new_holder = from.name;
  } else if (opened.kind != Opened::Kind::kLease && (!runs || lease != lease_)) {
    return {"the lease it was signed under has ended", true};
  }
  lease_end_ = now + kLease;
  return {};
}

std::string CommandGate::holder(Time now) const { return now < lease_end_ ? holder_->name : ""; }

std::chrono::duration<double> CommandGate::left(Time now) const noexcept {
  return std::max(std::chrono::duration<double>(lease_end_ - now), std::chrono::duration<double>::zero());
}

std::int64_t unpredictable() {
  std::int64_t number = 0;
  if (::getrandom(&number, sizeof number, 0) != sizeof number)
    throw std::system_error(errno, std::generic_category(), "random numbers of the kernel");
  return number;
}

}  // namespace crux
