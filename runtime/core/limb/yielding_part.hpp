// What a limb of few joints can yield to.
#pragma once

#include "core/robot/limb_kinematics.hpp"

namespace crux {

/// Of a wrench at the gripper, axes of the body, the part to which a gripper that moves by its virtual damping alone
/// (v = F/D, ω = M/D) answers by a motion of the limb's joints: D·J·(Jᵀ·D·J)⁻¹·Jᵀ times the wrench. All of it where the
/// joints make every motion.
[[nodiscard]] Wrench yielding_part(const LimbState& limb, const Wrench& wrench_B,
                                   const AdmittanceParameters& gains) noexcept;

}  // namespace crux
