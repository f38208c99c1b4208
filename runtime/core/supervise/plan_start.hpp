// Whether the robot stands where a plan begins.
#pragma once

#include "core/grips/cycle_view.hpp"
#include "core/robot/reason.hpp"

namespace crux {

/// A limb that grips where the plan begins and is in the air here, or the other way round.
Reason off_stance(const CycleView& now, const PlanReference& start) noexcept;

/// How far body or grippers are from where the plan begins. `must_press`: its grips must press on their holds already.
Reason off_start(const CycleView& now, const PlanReference& start, bool must_press) noexcept;

}  // namespace crux
