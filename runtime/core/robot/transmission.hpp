// Between the actuators of a limb, which its nodes know, and its joints, which kinematics knows. The same as
// crux_contracts.transmissions; msgs/golden/transmissions.json holds both to it.
#pragma once

#include <Eigen/LU>

#include <array>
#include <string>

#include "core/robot/geometry.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {

/// Of a joint or an actuator.
struct JointLimits {
  double lower_rad = 0.0;
  double upper_rad = 0.0;
  double velocity_rad_s = 0.0;
  double effort_Nm = 0.0;
};

using LimbLimits = std::array<JointLimits, kJoints>;

/// Actuators at matrix * joints + offset. Slots without a joint are actuators of their own. Where `direct()`, each
/// actuator is its joint and everything comes back to the bit. What works on vectors does not allocate.
class Transmission {
 public:
  Transmission() = default;
  /// @throws std::runtime_error naming the key of robot.yaml at `path` that is wrong
  Transmission(const crux_msgs::robot::Transmissions& section, int joints, const std::string& path);

  [[nodiscard]] bool direct() const noexcept { return direct_; }

  [[nodiscard]] JointVector actuators_rad(const JointVector& joints_rad) const noexcept {
    return direct_ ? joints_rad : JointVector(matrix_ * joints_rad + offset_rad_);
  }
  [[nodiscard]] JointVector joints_rad(const JointVector& actuators_rad) const noexcept {
    return direct_ ? actuators_rad : JointVector(inverse_ * (actuators_rad - offset_rad_));
  }
  /// Speeds or small ways of the actuators by those of the joints, and the other way round.
  [[nodiscard]] JointVector actuator_ways(const JointVector& joints) const noexcept {
    return direct_ ? joints : JointVector(matrix_ * joints);
  }
  [[nodiscard]] JointVector joint_ways(const JointVector& actuators) const noexcept {
    return direct_ ? actuators : JointVector(inverse_ * actuators);
  }
  [[nodiscard]] JointVector joint_torque_Nm(const JointVector& actuators_Nm) const noexcept {
    return direct_ ? actuators_Nm : JointVector(matrix_.transpose() * actuators_Nm);
  }
  [[nodiscard]] JointVector actuator_torque_Nm(const JointVector& joints_Nm) const noexcept {
    return direct_ ? joints_Nm : JointVector(inverse_.transpose() * joints_Nm);
  }
  /// Of the joints, as the actuators feel it.
  [[nodiscard]] JointMatrix at_actuators(const JointMatrix& inertia_kg_m2) const {
    return direct_ ? inertia_kg_m2 : JointMatrix(inverse_.transpose() * inertia_kg_m2 * inverse_);
  }

  /// Torques of the joints, shrunk until the actuators need at most `most_Nm`.
  [[nodiscard]] JointVector within_torques(const JointVector& joints_Nm, const JointVector& most_Nm) const noexcept;

  /// Limits of the joints, narrowed until the actuators keep their own whatever the joints do within.
  [[nodiscard]] LimbLimits within(const LimbLimits& joints, const LimbLimits& actuators) const;

  /// What the actuators come to as the joints do all that is within their limits.
  [[nodiscard]] LimbLimits reached(const LimbLimits& joints) const;

 private:
  int joints_ = 0;
  bool direct_ = true;
  JointMatrix matrix_ = JointMatrix::Identity(), inverse_ = JointMatrix::Identity();
  JointVector offset_rad_ = JointVector::Zero();
};

/// What the section says of the actuators themselves.
LimbLimits own_limits(const crux_msgs::robot::Transmissions& section);

}  // namespace crux
