// How late the drives of all joints answer, measured once control has taken over: a torque that nobody else asks for,
// and when it is seen in the torques measured.
#pragma once

#include <array>
#include <optional>

#include "core/robot/geometry.hpp"

namespace crux {

class DelayProbe {
 public:
  /// Anew, from the next cycle on.
  void restart() noexcept { *this = DelayProbe(); }

  /// Torque [Nm] to add to a joint's command in this cycle.
  double torque_Nm(int joint) const noexcept;

  /// One cycle of the measurement, after whose torque_Nm() a command goes out: takes the torques [Nm], limb-major, that
  /// came in before it.
  void step(const double* measured_Nm) noexcept;

  bool done() const noexcept { return cycle_ >= kCycles; }

  /// Cycles from the first in which a described drive answers until a joint's did, once done; none where no answer was
  /// seen.
  std::optional<int> dead_cycles(int joint) const noexcept;

 private:
  static constexpr int kSequence = 126;  ///< two periods
  static constexpr int kLongest = 24;    ///< cycles that are told apart
  static constexpr int kCycles = kSequence + kLongest;

  int cycle_ = -1;
  std::array<double, kAllJoints> last_Nm_{};
  std::array<std::array<double, kLongest>, kAllJoints> correlation_{};
};

}  // namespace crux
