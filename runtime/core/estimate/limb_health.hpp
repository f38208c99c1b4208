// What the faults so far say of each limb, until an operator has looked.
#pragma once

#include <algorithm>
#include <functional>

#include "core/robot/geometry.hpp"

namespace crux {

struct LimbHealth {
  PerLimb<bool> hold_lost{};                ///< it bears nothing from then on
  PerLimb<bool> force_torque_distrusted{};  ///< the F/T sensor does not fit the joints' torques: nothing is done by it
  PerLimb<bool> finger_force_distrusted{};  ///< the finger force does not fit opening and command
  PerLimb<bool> gives_way{};  ///< its hold creeps, or seems to by an encoder that drifts: it bears next to nothing

  bool any_hold_lost() const noexcept { return std::ranges::any_of(hold_lost, std::identity()); }
  bool any_gives_way() const noexcept { return std::ranges::any_of(gives_way, std::identity()); }
  bool any_force_torque_distrusted() const noexcept {
    return std::ranges::any_of(force_torque_distrusted, std::identity());
  }
};

}  // namespace crux
