// How far load moves one gripper against the other grips: pads, spines, rock and what servos give.
#pragma once

#include "core/robot/geometry.hpp"

namespace crux {

/// Least squares of shift on force over the last moments, each about its mean: a grip gives way against the force that
/// it bears the robot with, shift = −compliance · force.
class ComplianceEstimator {
 public:
  /// Once a cycle. `grips`: which limbs hold, a bit each, 0 where this one does not; the means begin anew where that
  /// changes, for the shift is counted from other grips then. Both vectors in axes of the gripper.
  void update(unsigned grips, const Vector3& force_G_N, const Vector3& shift_G_m, double dt_s) noexcept;

  /// Of the present grip; 0 until its load has changed enough to tell.
  double compliance_m_N() const { return compliance_m_N_; }

 private:
  unsigned grips_ = 0;
  double weight_ = 0.0;  ///< of what the means count [s]
  Vector3 force_G_N_ = Vector3::Zero(), shift_G_m_ = Vector3::Zero();
  double force_squared_N2_ = 0.0, product_Nm_ = 0.0;  ///< variance, and covariance
  double compliance_m_N_ = 0.0;
};

}  // namespace crux
