#include "core/limb/admittance.hpp"

#include <algorithm>

namespace crux {
namespace {

struct Axis {
  double mass, damping, stiffness, max_speed, max_offset;
};

void integrate(const Axis& axis, const Vector3& error, double dt_s, bool may_grow, Vector3& x, Vector3& v) {
  v = (axis.mass * v + dt_s * (error - axis.stiffness * x)) / (axis.mass + dt_s * axis.damping);
  v = clamped_norm(v, axis.max_speed);
  const Vector3 moved = x + dt_s * v;
  // An offset taken over from elsewhere may lie outside the clamp: it may shrink, never jump.
  const Vector3 clamped = clamped_norm(moved, std::max(axis.max_offset, x.norm()));
  if ((!may_grow && moved.squaredNorm() > x.squaredNorm()) || clamped != moved) {
    // Against wind-up: at the clamp the speed that leads outwards is lost, so the way back begins at once.
    const double outwards = x.norm() > 0.0 ? v.dot(x.normalized()) : 0.0;
    if (outwards > 0.0) v -= outwards * x.normalized();
    if (!may_grow) return;
  }
  x = clamped;
}

}  // namespace

void Admittance::step(const Wrench& error_W, double dt_s, bool may_grow) noexcept {
  const AdmittanceParameters& p = parameters_;
  integrate({p.mass_kg, p.damping_Ns_m, p.stiffness_N_m, p.max_speed_m_s, p.max_offset_m}, error_W.force_N, dt_s,
            may_grow, offset_m_, speed_m_s_);
  integrate({p.inertia_kg_m2, p.rotational_damping_Nms_rad, p.rotational_stiffness_Nm_rad, p.max_rate_rad_s,
             p.max_rotation_rad},
            error_W.moment_Nm, dt_s, may_grow, rotation_rad_, rate_rad_s_);
}

void Admittance::fade(const Vector3& force_N, double time_constant_s, double dt_s) noexcept {
  const AdmittanceParameters& p = parameters_;
  // A spring of D/time_constant: the same equation, so that the speed is continuous where a swing begins. It pulls no
  // harder than the greatest speed needs, so that an offset of decimetres gives way as well as one of millimetres.
  const double stretched = offset_m_.norm() / (p.max_speed_m_s * time_constant_s);
  const double stiffness = p.damping_Ns_m / time_constant_s / std::max(stretched, 1.0);
  integrate({p.mass_kg, p.damping_Ns_m, stiffness, p.max_speed_m_s, p.max_offset_m}, force_N, dt_s, true, offset_m_,
            speed_m_s_);
  integrate({p.inertia_kg_m2, p.rotational_damping_Nms_rad, p.rotational_damping_Nms_rad / time_constant_s,
             p.max_rate_rad_s, p.max_rotation_rad},
            Vector3::Zero(), dt_s, true, rotation_rad_, rate_rad_s_);
}

void Admittance::reset(const Vector3& offset_m, const Vector3& rotation_rad) noexcept {
  offset_m_ = offset_m;
  rotation_rad_ = rotation_rad;
  speed_m_s_.setZero();
  rate_rad_s_.setZero();
}

}  // namespace crux
