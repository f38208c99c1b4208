// How a wrong robot description is refused: file:line: key: value: what would be right, as crux_contracts says it.
#pragma once

#include <array>
#include <cstdio>
#include <initializer_list>
#include <stdexcept>
#include <string>

namespace crux {

/// A number as messages show it.
inline std::string shown(double value, const char* form = "%g") {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), form, value + 0.0);  // + 0.0: -0 is 0
  return text.data();
}

/// The parts that are not empty; `line` 0: unknown.
inline std::string problem(const std::string& path, const std::string& key, const std::string& value,
                           const std::string& expected, int line = 0) {
  std::string all = line > 0 ? path + ":" + std::to_string(line) : path;
  for (const std::string& part : {key, value, expected})
    if (!part.empty()) all += ": " + part;
  return all;
}

[[noreturn]] inline void refuse(const std::string& path, const std::string& key, const std::string& value,
                                const std::string& expected) {
  throw std::runtime_error(problem(path, key, value, expected));
}

}  // namespace crux
