// SHA-256, as the contracts use it for robots and plans.
#pragma once

#include <string>
#include <string_view>

namespace crux {

/// Lower-case hex SHA-256 of the bytes.
std::string sha256_hex(std::string_view bytes);

}  // namespace crux
