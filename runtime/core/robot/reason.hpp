// Why something was refused or went wrong, in a form that the real-time thread can fill: a literal in which {value} and
// {limit} stand for numbers (as in msgs/faults.yaml), the place and the numbers.
#pragma once

#include <string>

#include "core/robot/geometry.hpp"

namespace crux {

inline constexpr PerLimb<const char*> kLimbNames = crux_msgs::robot::kLimbNames;

struct Reason {
  const char* text = "";  ///< empty: not refused
  int limb = -1;
  int node = 0;  ///< CAN node on the limb's bus, 0: none
  double value = 0.0, limit = 0.0;

  explicit operator bool() const { return *text != '\0'; }
};

/// "LF node 3: no valid status from the node for 12 cycles (limit: 5)". For messages, it allocates.
std::string in_words(const Reason& reason);

}  // namespace crux
