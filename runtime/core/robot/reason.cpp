#include "core/robot/reason.hpp"

#include "core/robot/description_problem.hpp"

namespace crux {

std::string in_words(const Reason& reason) {
  std::string text = reason.text;
  const auto fill_in = [&text](const std::string& place, double number) {
    const std::size_t at = text.find(place);
    if (at != std::string::npos) text.replace(at, place.size(), shown(number));
  };
  fill_in("{limit}", reason.limit);
  fill_in("{value}", reason.value);
  if (reason.limb < 0 || reason.limb >= kLimbs) return text;
  const std::string limb = kLimbNames[static_cast<std::size_t>(reason.limb)];
  return limb + (reason.node > 0 ? " node " + std::to_string(reason.node) : "") + ": " + text;
}

}  // namespace crux
