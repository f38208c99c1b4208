// How much torque the heat of their motors leaves the actuators of a limb, as their nodes count it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// A winding's heat follows the square of its current by a first-order lag; as it nears what the continuous current
/// makes, the node lets its peak fold back to that (firmware/core/drive/heat.c).
class JointHeat {
 public:
  JointHeat(const crux_msgs::robot::Motor& motor, const LimbLimits& actuators) noexcept
      : heating_time_s_(motor.heating_time_s) {
    const double motor_Nm =
        motor.continuous_current_A * motor.torque_constant_Nm_A * motor.gear_ratio * motor.gear_efficiency;
    for (int j = 0; j < kJoints; ++j) {
      peak_Nm_[j] = actuators[j].effort_Nm;
      continuous_Nm_[j] = std::min(motor_Nm, actuators[j].effort_Nm);
    }
  }

  /// Takes in the torques of the last period. The first ones count as if they had lasted: how warm the motors are is
  /// not known.
  void take(const JointVector& torque_Nm, double dt_s) noexcept {
    const double share = seen_ ? 1.0 - std::exp(-dt_s / heating_time_s_) : 1.0;
    seen_ = true;
    load_ += share * (torque_Nm.cwiseQuotient(continuous_Nm_).cwiseAbs2() - load_);
  }

  /// What the actuator's node allows now.
  double allowed_Nm(int joint) const noexcept {
    const double folded = std::clamp((load_[joint] - kFoldBackFrom) / (1.0 - kFoldBackFrom), 0.0, 1.0);
    const double peak = peak_Nm_[joint] * peak_Nm_[joint], continuous = continuous_Nm_[joint] * continuous_Nm_[joint];
    return std::sqrt(peak - folded * (peak - continuous));
  }

 private:
  static constexpr double kFoldBackFrom = 0.8;

  double heating_time_s_;
  JointVector peak_Nm_, continuous_Nm_;
  JointVector load_ = JointVector::Zero();
  bool seen_ = false;
};

}  // namespace crux
