// Which limb bears what, within what fingers and joints can: a small quadratic program about the balanced wrenches.
#pragma once

#include <cstdint>
#include <memory>

#include "core/loads/grasp_force.hpp"
#include "core/loads/wrench_distribution.hpp"
#include "core/robot/limb_kinematics.hpp"

namespace crux {

/// What one limb can bear where it is.
struct Capacity {
  Contact contact;                               ///< its friction is what the grasp is known to have
  const LimbState* limb = nullptr;               ///< for joint torques
  JointVector gravity_Nm = JointVector::Zero();  ///< of its links
  JointVector max_torque_Nm = JointVector::Zero();
};

/// Σ|Δf|² + |Δm/length|² over the limbs, each over its load, is made least, where Δ is what a wrench is off the
/// balanced one, under
///   Σ Δ = 0 about the centre of mass,
///   the squeeze each pad needs (required_grasp_force_N) ≤ the most that its hold and actuator allow,
///   |τ| ≤ max_torque_Nm of every joint, and a foot's force in its cone.
/// The cone of a pad enters by tangent planes where it was touched last, a joint's limit by the side it was nearer to,
/// so that answers of successive cycles converge. What planes leave out of the cones, their curvature, is counted with
/// the multipliers of the last solution: without it answers swing for ever where limits cannot all be kept. Limits that
/// cannot all be kept are exceeded by as little as possible. Where the balanced wrenches keep them nothing is solved,
/// and what Δ there was fades. In every cycle Δ is balanced on the limbs that bear in it.
class LoadSharing {
 public:
  LoadSharing();
  ~LoadSharing();
  LoadSharing(const LoadSharing&) = delete;
  LoadSharing& operator=(const LoadSharing&) = delete;

  /// `balanced`: of balanced_wrenches() for these `bearers`. Where the solver finds no answer the last one
  /// stays for a moment and fades then.
  PerLimb<Wrench> within_limits(const PerLimb<Wrench>& balanced, const PerLimb<Bearer>& bearers,
                                const PerLimb<Capacity>& capacities, const Vector3& com_W_m, const Matrix3& rotation_WB,
                                const ControlParameters& control) noexcept;

  /// Times that the solver has found no answer.
  std::int64_t failures() const noexcept;

 private:
  struct Program;
  std::unique_ptr<Program> program_;
};

}  // namespace crux
