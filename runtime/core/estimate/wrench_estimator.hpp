// The wrench of the wall on one gripper from its F/T sensor: weight of the hand and bias taken off, filtered, in W.
#pragma once

#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

class WrenchEstimator {
 public:
  WrenchEstimator(const LimbDescription& limb, const ForceTorqueDescription& sensor, const ControlParameters& control)
      : hand_mass_kg_(limb.hand_mass_kg),
        hand_com_G_m_(limb.hand_com_G_m),
        most_bias_N_(kMostBiases * sensor.bias_N),
        most_bias_Nm_(kMostBiases * sensor.bias_Nm),
        filter_s_(control.force_filter_s),
        tare_time_constant_s_(control.tare_time_constant_s) {}

  /// `raw_G`: world and weight on the gripper about its centre, as the sensor gives it; `rotation_WG`: W <- G;
  /// `gravity_W_m_s2`: gravity as far as it acts on the hand. The first sample initialises the filter.
  const Wrench& update(const Wrench& raw_G, const Matrix3& rotation_WG, const Vector3& gravity_W_m_s2,
                       double dt_s) noexcept;

  /// Learns the bias from the last sample; only while the gripper touches nothing. No channel's bias is taken for more
  /// than three times what the sensor's is described to be: a touch that nobody notices is not learnt as one.
  void tare(const Matrix3& rotation_WG, double dt_s) noexcept;

  /// The bias is known from before.
  void take_bias(const Wrench& bias_G) noexcept {
    bias_G_ = bias_G;
    tared_s_ = kTareTimeConstants * tare_time_constant_s_;
  }

  /// The bias has been learnt.
  bool tared() const { return tared_s_ >= kTareTimeConstants * tare_time_constant_s_; }

  static constexpr double kTareTimeConstants = 3.0;
  static constexpr double kMostBiases = 3.0;

  /// Wrench of the wall on the gripper about its centre, axes of W.
  const Wrench& wrench_W() const { return filtered_W_; }
  const Wrench& bias_G() const { return bias_G_; }

 private:
  double hand_mass_kg_;
  Vector3 hand_com_G_m_;
  double most_bias_N_, most_bias_Nm_;
  double filter_s_;
  double tare_time_constant_s_;
  Wrench filtered_W_;
  Wrench bias_G_;
  double tared_s_ = 0.0;
  bool started_ = false;
};

}  // namespace crux
