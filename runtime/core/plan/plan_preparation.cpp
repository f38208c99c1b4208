#include "core/plan/plan_preparation.hpp"

#include <Eigen/Geometry>
#include <string>
#include <utility>

#include "core/plan/plan_join.hpp"
#include "core/plan/plan_validation.hpp"

namespace crux {
namespace {

/// From foot points to grippers on their pads: `radius_m` above, moments about the gripper centre.
void stand_on_pads(PreparedPlan& plan, double radius_m) {
  const Vector3 above(0.0, 0.0, radius_m);
  for (PerLimb<LimbKnot>& knot : plan.limbs) {
    for (LimbKnot& limb : knot) {
      limb.gripper_position_W_m += above;
      limb.wrench_W.moment_Nm -= above.cross(limb.wrench_W.force_N);
    }
  }
}

}  // namespace

Result<std::unique_ptr<const PreparedPlan>> prepare_plan(const RobotDescription& robot, const crux_msgs::plan_t& plan,
                                                         const PreparedPlan* running) {
  if (std::string defect = plan_message_defect(robot, plan); !defect.empty()) return Refusal{defect};
  std::unique_ptr<PreparedPlan> tables = tabulate(plan);
  if (running != nullptr && running->plan_id != plan.plan_id) {
    tables->shared = shared_intervals(*tables, *running);
    if (tables->shared > 0) tables->follows = running->plan_id;
  }
  if (tables->point_feet) stand_on_pads(*tables, robot.gripper.pad_radius_m);
  std::unique_ptr<const PreparedPlan> prepared = std::move(tables);
  // Grips that were found elsewhere are so in what has passed, too, where nobody asks any more whether limbs reach
  // them.
  if (std::string defect = plan_reach_defect(robot, *prepared, prepared->shared); !defect.empty())
    return Refusal{defect};
  return prepared;
}

}  // namespace crux
