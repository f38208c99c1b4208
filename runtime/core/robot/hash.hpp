// SHA-256, as the contracts use it for robots and plans.
#pragma once

#include <string>
#include <string_view>

namespace crux {

/// Lower-case hex SHA-256 of the bytes.
std::string sha256_hex(std::string_view bytes);

/// Its first digits, as names of files bear them.
inline std::string short_hash(std::string_view bytes) { return sha256_hex(bytes).substr(0, 16); }

}  // namespace crux
