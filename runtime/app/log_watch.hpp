// Tells when a log is not whole: once where it ends, and at every gap.
#pragma once

#include <cstdint>

#include "core/robot/fault_list.hpp"
#include "crux_msgs/fault_t.hpp"

namespace crux {

class LogWatch {
 public:
  /// What is new in this cycle, code 0 if nothing is.
  /// @param broken  the log cannot be written
  /// @param dropped cycles in all that the log's queue had no room for; 0 while it has none, so that a gap is told once
  crux_msgs::fault_t look(std::int64_t cycle, bool broken, std::int64_t dropped) noexcept {
    const bool ended = broken && !broken_;
    broken_ = broken;  // one that goes on may end again
    const bool gap = dropped > dropped_;
    crux_msgs::fault_t fault{};
    if (!ended && !gap) return fault;
    if (gap) dropped_ = dropped;
    fault.cycle = cycle;
    fault.code = static_cast<std::int16_t>(ended ? FaultCode::kLogEnded : FaultCode::kLogGap);
    fault.limb = -1;
    fault.value = static_cast<double>(ended ? cycle : dropped_);
    return fault;
  }

 private:
  bool broken_ = false;
  std::int64_t dropped_ = 0;  ///< when a gap was told last
};

}  // namespace crux
