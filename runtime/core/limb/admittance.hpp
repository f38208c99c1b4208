// Admittance of one gripper: a virtual mass, damper and spring that yields to the wrench error,
//   M·v̇ + D·v + K·x = e,   I·ω̇ + D_r·ω + K_r·φ = e_m,
// with damping as a parameter of its own, so that pure force tracking (K = 0) stays damped. Semi-implicit Euler.
#pragma once

#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

class Admittance {
 public:
  explicit Admittance(const AdmittanceParameters& parameters) : parameters_(parameters) {}

  /// Takes effect at the next step. Bumpless: offset and velocity are kept.
  void set_parameters(const AdmittanceParameters& parameters) noexcept { parameters_ = parameters; }

  /// Yields to `error_W` (measured minus wanted, on the robot) for one period. `may_grow` false keeps the offset from
  /// growing further, when the limb cannot follow it any more.
  void step(const Wrench& error_W, double dt_s, bool may_grow = true) noexcept;

  /// In the air: the offset fades with a time constant, but gives way to `force_N` that the gripper feels.
  void fade(const Vector3& force_N, double time_constant_s, double dt_s) noexcept;

  /// Starts again from a given offset, at rest.
  void reset(const Vector3& offset_m, const Vector3& rotation_rad) noexcept;

  /// The same motion named from another origin: the offset is another, its speed goes on.
  void rebase(const Vector3& offset_m, const Vector3& rotation_rad) noexcept {
    offset_m_ = offset_m;
    rotation_rad_ = rotation_rad;
  }

  const AdmittanceParameters& parameters() const { return parameters_; }
  const Vector3& offset_m() const { return offset_m_; }
  const Vector3& rotation_rad() const { return rotation_rad_; }
  const Vector3& speed_m_s() const { return speed_m_s_; }
  const Vector3& rate_rad_s() const { return rate_rad_s_; }

 private:
  AdmittanceParameters parameters_;
  Vector3 offset_m_ = Vector3::Zero();
  Vector3 speed_m_s_ = Vector3::Zero();
  Vector3 rotation_rad_ = Vector3::Zero();
  Vector3 rate_rad_s_ = Vector3::Zero();
};

}  // namespace crux
