#include "core/estimate/compliance_estimator.hpp"

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

constexpr double kMemory_s = 2.0;       // about as long as a pull
constexpr double kLeastSpread_N = 3.0;  // deviation of the force: noise alone spreads less

}  // namespace

void ComplianceEstimator::update(unsigned grips, const Vector3& force_G_N, const Vector3& shift_G_m,
                                 double dt_s) noexcept {
  if (grips != grips_) {
    const double known_m_N = grips != 0 && grips_ != 0 ? compliance_m_N_ : 0.0;
    *this = ComplianceEstimator();
    grips_ = grips;
    compliance_m_N_ = known_m_N;
  }
  if (grips == 0 || dt_s <= 0.0) return;
  // Welford's recursion with weights that fade.
  const double kept = std::exp(-dt_s / kMemory_s);
  weight_ = kept * weight_ + dt_s;
  const double share = dt_s / weight_;
  const Vector3 force_off_N = force_G_N - force_G_N_, shift_off_m = shift_G_m - shift_G_m_;
  force_G_N_ += share * force_off_N;
  shift_G_m_ += share * shift_off_m;
  force_squared_N2_ = (1.0 - share) * (force_squared_N2_ + share * force_off_N.squaredNorm());
  product_Nm_ = (1.0 - share) * (product_Nm_ + share * force_off_N.dot(shift_off_m));
  if (force_squared_N2_ > kLeastSpread_N * kLeastSpread_N)
    compliance_m_N_ = std::max(-product_Nm_ / force_squared_N2_, 0.0);
}

}  // namespace crux
