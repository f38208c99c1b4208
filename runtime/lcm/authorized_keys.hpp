// Who may command this robot: a file with a line a key.
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace crux {

/// The file cannot be used; the message says where, what it says there and what would be right.
class KeysError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class Role : std::uint8_t {
  kWatch,    ///< may hold, and ask, which needs no signature; nothing else
  kOperate,  ///< may command
};

struct AuthorizedKey {
  std::array<std::uint8_t, 32> key{};  ///< Ed25519, the public half
  Role role = Role::kWatch;
  std::string name;  ///< of the operator, for refusals and for the log
};

/// A line a key: 64 hexadecimal digits, `operate` or `watch`, a name. Empty lines and those that begin with # are
/// skipped.
/// @param where what the messages call the text
/// @throws KeysError
std::vector<AuthorizedKey> parse_keys(std::string_view text, const std::string& where);

/// Reads a file that belongs to root or to this process's user, and that nobody else may write to: who can, could make
/// himself an operator.
/// @throws KeysError
std::vector<AuthorizedKey> read_keys(const std::string& path);

}  // namespace crux
