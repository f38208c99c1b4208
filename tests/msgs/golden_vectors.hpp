// Reads the golden vectors of msgs/golden.
#pragma once

#include <cstdint>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace crux_test {

inline nlohmann::json golden(const std::string& file) {
  std::ifstream stream(std::string(CRUX_GOLDEN) + "/" + file);
  return nlohmann::json::parse(stream);
}

inline std::vector<std::uint8_t> bytes_of(const std::string& hex) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoul(hex.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

}  // namespace crux_test
