// What a limb of fewer than six joints cannot do: turns of its gripper about axes of its own, which stay at zero. With
// them the limb has as many turns as a pose has numbers. crux_contracts/still_turns.py has the same.
#pragma once

#include "core/robot/robot_description.hpp"

namespace crux {

/// Appends them to the chain, with limits for inverse kinematics alone. False: the joints cannot move the gripper in
/// all directions.
[[nodiscard]] bool add_still_turns(LimbDescription& limb);

}  // namespace crux
