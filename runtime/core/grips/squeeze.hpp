// How hard each gripper presses on its hold.
#pragma once

#include "core/grips/grips.hpp"

namespace crux {

/// The plan's squeeze, and at least what the load needs where the hold has less friction than it was planned with. The
/// grasp leads the load: it is strong enough for what comes within the lead time after `at` as well, and for what its
/// sensor feels beyond the plan. A sensor that fails leaves what it felt last.
void press_holds(const CycleView& now, const Grips& grips, const PlanTime& at, PerLimb<LimbController>& limbs,
                 bool rises, double dt_s) noexcept;

}  // namespace crux
