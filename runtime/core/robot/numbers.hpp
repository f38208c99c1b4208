// Decimal numbers of description files.
#pragma once

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <string>

namespace crux {

/// Nothing for what is no decimal number; strtod alone would also take nan and 0x1.
inline std::optional<double> decimal(const std::string& word) {
  if (word.find_first_not_of("+-.0123456789eE") != std::string::npos) return std::nullopt;
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  if (end == word.c_str() || *end != '\0') return std::nullopt;
  return value;
}

/// Calls `use` with each word of a text that white space parts.
template <class Use>
void for_each_word(const std::string& text, Use use) {
  constexpr const char* kSpace = " \t\r\n";
  for (std::size_t at = 0; (at = text.find_first_not_of(kSpace, at)) != std::string::npos;) {
    const std::size_t end = std::min(text.find_first_of(kSpace, at), text.size());
    use(text.substr(at, end - at));
    at = end;
  }
}

}  // namespace crux
