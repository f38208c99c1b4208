// Which grip bears what of the robot, and what is felt beside it.
#pragma once

#include "core/grips/grips.hpp"
#include "core/loads/load_sharing.hpp"

namespace crux {

/// Wrenches of `bearers` that balance the robot as it hangs.
PerLimb<Wrench> balanced(const CycleView& now, const PerLimb<Bearer>& bearers) noexcept;

/// What the limbs are to bear: balanced, and within what fingers and `torque_share` of each joint's torque can. Fingers
/// that do not press yet bear nothing.
PerLimb<Wrench> shared(const CycleView& now, const Grips& grips, LoadSharing& sharing, double torque_share) noexcept;

/// What force/torque sensors feel beside that, `engagement` (0..1) of it, without what would move the whole robot.
PerLimb<Wrench> wrench_errors(const CycleView& now, const Grips& grips, double engagement) noexcept;

}  // namespace crux
