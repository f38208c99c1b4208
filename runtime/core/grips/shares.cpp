#include "core/grips/shares.hpp"

#include <Eigen/Geometry>

#include <algorithm>

#include "core/loads/internal_wrench.hpp"

namespace crux {
namespace {

PerLimb<Wrench> balanced_on_feet(const CycleView& now) noexcept {
  // Forces act at the foot points; the plan's own sum of forces stands, for a walk accelerates.
  const Vector3 below(0.0, 0.0, -now.robot.gripper.pad_radius_m);
  PerLimb<Bearer> bearers;
  PerLimb<Vector3> feet_W_m;
  Vector3 total_N = Vector3::Zero();
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = now.reference.limbs[l];
    feet_W_m[l] = now.limbs[l].anchor_W_m(limb) + below;
    bearers[l] = {feet_W_m[l], Vector3::Zero(), limb.load, {limb.wrench_W.force_N, {0, 0, 0}}};
    total_N += limb.wrench_W.force_N;
  }
  PerLimb<Wrench> wrenches = balanced_wrenches(bearers, now.com_W_m, -total_N, 0.0);
  share_along_plane(feet_W_m, wrenches);
  for (Wrench& wrench : wrenches) wrench.moment_Nm += below.cross(wrench.force_N);
  return wrenches;
}

/// Share of its load that a limb's fingers can bear. While the plan runs its clock sees to it that they press; before,
/// somebody may hold the robot to the wall while they close.
double pressed(const CycleView& now, int limb) noexcept {
  const LimbReference& reference = now.reference.limbs[limb];
  if (now.started || reference.foot() || !reference.gripping()) return 1.0;
  return std::clamp(now.limbs[limb].fingers().force_N() / now.robot.control.min_grasp_force_N, 0.0, 1.0);
}

Vector3 weight_W_N(const CycleView& now) noexcept {
  return (1.0 + now.carried) * now.robot.total_mass_kg * now.plan->gravity_W_m_s2;
}

/// What feet on footholds can bear of `wrenches`, and the rest on the others.
PerLimb<Wrench> on_feet(const CycleView& now, const PerLimb<Wrench>& wrenches,
                        const PerLimb<Bearer>& bearers) noexcept {
  if (!now.plan->footholds) return wrenches;
  PerLimb<Bearer> as_shared = bearers;
  for (int l = 0; l < kLimbs; ++l) as_shared[l].planned_W = wrenches[l];
  return within_cones(wrenches, as_shared, now.com_W_m, weight_W_N(now), now.robot.control.twist_length_m);
}

}  // namespace

PerLimb<Wrench> balanced(const CycleView& now, const PerLimb<Bearer>& bearers) noexcept {
  PerLimb<Wrench> wrenches = balanced_wrenches(bearers, now.com_W_m, weight_W_N(now), now.robot.control.twist_length_m);
  if (!now.plan->footholds) return wrenches;
  return within_cones(wrenches, bearers, now.com_W_m, weight_W_N(now), now.robot.control.twist_length_m);
}

PerLimb<Wrench> shared(const CycleView& now, const Grips& grips, LoadSharing& sharing, double torque_share) noexcept {
  if (now.plan->point_feet) return balanced_on_feet(now);
  const PerLimb<Bearer> bearing = grips.bearers(now, now.reference);
  const Matrix3& rotation_WB = now.body_W.rotation;
  PerLimb<Capacity> capacities;
  for (int l = 0; l < kLimbs; ++l) {
    capacities[l] = now.limbs[l].capacity(grips.known_contact(now, l), rotation_WB, now.plan->gravity_W_m_s2);
    capacities[l].max_torque_Nm *= torque_share;
  }
  PerLimb<Wrench> wrenches =
      sharing.within_limits(balanced(now, bearing), bearing, capacities, now.com_W_m, rotation_WB, now.robot.control);
  wrenches = on_feet(now, wrenches, bearing);
  for (int l = 0; l < kLimbs; ++l) {
    const FootCone& foot = bearing[l].foot;
    if (foot.stands) wrenches[l].moment_Nm = foot.to_foot_W_m.cross(wrenches[l].force_N);
    wrenches[l] = wrenches[l] * pressed(now, l);
  }
  return wrenches;
}

PerLimb<Wrench> wrench_errors(const CycleView& now, const Grips& grips, double engagement) noexcept {
  PerLimb<Wrench> errors;
  PerLimb<Vector3> positions_W_m;
  PerLimb<double> loads{};  // none of a limb whose sensors are not believed
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& reference = now.reference.limbs[l];
    const LimbController& limb = now.limbs[l];
    positions_W_m[l] = limb.anchor_W_m(reference);
    if (now.health.force_torque_distrusted[l] || limb.rigid()) continue;
    loads[l] = grips.load(now, l, reference) * pressed(now, l);
    if (!now.health.hold_lost[l] && !grips.slip(l).slips() && (reference.gripping() || reference.closing()))
      errors[l] = (limb.wrench_W() - now.wrenches_W[l]) * engagement;
  }
  return internal_errors(errors, positions_W_m, loads, now.com_W_m, now.robot.control.moment_length_m);
}

}  // namespace crux
