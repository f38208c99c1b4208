#include "core/estimate/wrench_estimator.hpp"

#include <Eigen/Geometry>

namespace crux {

const Wrench& WrenchEstimator::update(const Wrench& raw_G, const Matrix3& rotation_WG, const Vector3& gravity_W_m_s2,
                                      double dt_s) noexcept {
  const Vector3 weight_W_N = hand_mass_kg_ * gravity_W_m_s2;
  const Vector3 com_W_m = rotation_WG * hand_com_G_m_;
  const Wrench sample = {rotation_WG * (raw_G.force_N - bias_G_.force_N) - weight_W_N,
                         rotation_WG * (raw_G.moment_Nm - bias_G_.moment_Nm) - com_W_m.cross(weight_W_N)};
  const double gain = started_ ? dt_s / (filter_s_ + dt_s) : 1.0;
  started_ = true;
  filtered_W_ = filtered_W_ + (sample - filtered_W_) * gain;
  return filtered_W_;
}

void WrenchEstimator::tare(const Matrix3& rotation_WG, double dt_s) noexcept {
  const double gain = dt_s / tare_time_constant_s_;
  tared_s_ += dt_s;
  const auto learn = [gain](Vector3& bias, const Vector3& felt, double most) {
    bias = (bias + gain * felt).cwiseMax(-most).cwiseMin(most);
  };
  learn(bias_G_.force_N, rotation_WG.transpose() * filtered_W_.force_N, most_bias_N_);
  learn(bias_G_.moment_Nm, rotation_WG.transpose() * filtered_W_.moment_Nm, most_bias_Nm_);
}

}  // namespace crux
