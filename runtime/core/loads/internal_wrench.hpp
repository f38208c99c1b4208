// The part of the wrench errors that the stance can change: internal, without net force or moment. The rest is the
// robot's own weight and the sensors' bias; an admittance that followed it would let the body drift.
#pragma once

#include "core/robot/geometry.hpp"

namespace crux {

/// e − W·Gᵀ·(G·W·Gᵀ)⁻¹·G·e over the limbs that bear load, with the grasp map G about `com_W_m` and weights W = load for
/// forces, load·moment_length² for moments. Errors of limbs that bear no load come back unchanged: they are free to
/// move.
PerLimb<Wrench> internal_errors(const PerLimb<Wrench>& errors, const PerLimb<Vector3>& position_W_m,
                                const PerLimb<double>& load, const Vector3& com_W_m, double moment_length_m) noexcept;

/// A limb with less load than this counts as bearing none.
inline constexpr double kBearingLoad = 0.02;

}  // namespace crux
