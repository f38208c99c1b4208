#include "core/supervise/plan_start.hpp"

namespace crux {

Reason off_stance(const CycleView& now, const PlanReference& start) noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    const bool grips = now.reference.limbs[l].gripping() && !now.health.hold_lost[l];
    if (start.limbs[l].gripping() && !grips)
      return {"the plan starts with this gripper on a hold, but it is in the air: its fingers press with {value} N", l,
              0, now.limbs[l].fingers().force_N()};
    if (!start.limbs[l].gripping() && grips)
      return {"the plan starts with this gripper in the air, but it is on its hold and bears {value} N", l, 0,
              now.limbs[l].wrench_W().force_N.norm()};
  }
  return {};
}

Reason off_start(const CycleView& now, const PlanReference& start, bool must_press) noexcept {
  const SupervisorParameters& p = now.robot.supervisor;
  const double most_m = now.robot.control.max_body_correction_m;
  const double body_m = (now.body_W.position_m - start.body_W.position_m).norm();
  if (!(body_m <= most_m))
    return {"the body is {value} m from the plan's start pose (limit: {limit} m)", -1, 0, body_m, most_m};
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = start.limbs[l];
    double distance_m = 0.0, angle_rad = 0.0;
    now.limbs[l].pose_error(limb, now.body_W, distance_m, angle_rad);
    if (!(distance_m <= p.start_tolerance_m))
      return {"the gripper is {value} m from the plan's start pose (limit: {limit} m)", l, 0, distance_m,
              p.start_tolerance_m};
    if (!(angle_rad <= p.start_tolerance_rad))
      return {"the gripper is rotated by {value} rad from the plan's start pose (limit: {limit} rad)", l, 0, angle_rad,
              p.start_tolerance_rad};
    const double force_N = now.limbs[l].fingers().force_N();
    if (must_press && !limb.foot() && limb.gripping() && !(force_N >= p.min_stance_force_N))
      return {"the plan starts with this gripper closed, but its fingers press with {value} N (least: {limit} N)", l, 0,
              force_N, p.min_stance_force_N};
  }
  return {};
}

}  // namespace crux
