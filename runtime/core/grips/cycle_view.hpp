// The robot on its holds, as far as a cycle has it so far. Grips, loads and faults are judged by it.
#pragma once

#include "core/estimate/limb_health.hpp"
#include "core/limb/limb_controller.hpp"
#include "core/plan/reference_player.hpp"

namespace crux {

/// Refers to what the core owns, so it changes as the cycle goes on; the two flags at the end do not.
struct CycleView {
  const RobotDescription& robot;
  const PreparedPlan* plan;  ///< null: none is loaded
  const PerLimb<LimbController>& limbs;
  const LimbHealth& health;
  const Pose& body_W;
  const Vector3& com_W_m;
  const PlanReference& reference;
  const PerLimb<Wrench>& wrenches_W;  ///< that the limbs are to bear
  double carried;                     ///< beyond the described weight, as a share of it
  bool engaged;                       ///< control has taken over from the nodes' own hold
  bool started;                       ///< the plan's clock has left zero
};

}  // namespace crux
