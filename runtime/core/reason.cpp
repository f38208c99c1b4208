#include "core/reason.hpp"

#include <cstdio>

namespace crux {

std::string in_words(const Reason& reason) {
  std::string text = reason.text;
  const auto replace_last = [&text](const std::string& word, double number) {
    const std::size_t at = text.rfind(word);
    if (at == std::string::npos) return;
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.6g", number);
    text.replace(at, word.size(), digits);
  };
  replace_last("limit", reason.limit);  // "(limit: limit)": the second one is the number
  replace_last("value", reason.value);
  if (reason.limb < 0 || reason.limb >= kLimbs) return text;
  const std::string limb = kLimbNames[static_cast<std::size_t>(reason.limb)];
  return limb + (reason.node > 0 ? " node " + std::to_string(reason.node) : "") + ": " + text;
}

}  // namespace crux
