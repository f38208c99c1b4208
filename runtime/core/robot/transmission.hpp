// Between the actuators of a limb, which its nodes know, and its joints, which kinematics knows. The same as
// crux_contracts.transmissions; msgs/golden/transmissions.json holds both to it.
#pragma once

#include <Eigen/LU>

#include <array>
#include <optional>
#include <string>

#include "core/robot/five_bar.hpp"
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

/// Actuators at matrix * joints + offset; where there is a five-bar, its crank's angle stands in place of its next
/// joint's. Slots without a joint are actuators of their own. Where `direct()`, each actuator is its joint and
/// everything comes back to the bit. What works on vectors does not allocate. Ways are speeds or small ways; they and
/// torques are those of joints at `q_rad`.
class Transmission {
 public:
  Transmission() = default;
  /// @throws std::runtime_error naming the key of robot.yaml at `path` that is wrong
  Transmission(const crux_msgs::robot::Transmissions& section, int joints, const std::string& path,
               const std::optional<FiveBar>& five_bar = std::nullopt);

  [[nodiscard]] bool direct() const noexcept { return direct_; }

  [[nodiscard]] JointVector actuators_rad(const JointVector& joints_rad) const noexcept {
    return direct_ ? joints_rad : JointVector(matrix_ * turned(joints_rad) + offset_rad_);
  }
  [[nodiscard]] JointVector joints_rad(const JointVector& actuators_rad) const noexcept {
    return direct_ ? actuators_rad : turned_back(inverse_ * (actuators_rad - offset_rad_));
  }
  [[nodiscard]] JointVector actuator_ways(const JointVector& joints, const JointVector& q_rad) const noexcept {
    return direct_ ? joints : JointVector(slope(q_rad) * joints);
  }
  [[nodiscard]] JointVector joint_ways(const JointVector& actuators, const JointVector& q_rad) const noexcept {
    return direct_ ? actuators : JointVector(slope_back(q_rad) * actuators);
  }
  [[nodiscard]] JointVector joint_torque_Nm(const JointVector& actuators_Nm, const JointVector& q_rad) const noexcept {
    return direct_ ? actuators_Nm : JointVector(slope(q_rad).transpose() * actuators_Nm);
  }
  [[nodiscard]] JointVector actuator_torque_Nm(const JointVector& joints_Nm, const JointVector& q_rad) const noexcept {
    return direct_ ? joints_Nm : JointVector(slope_back(q_rad).transpose() * joints_Nm);
  }
  /// Of the joints, as the actuators feel it.
  [[nodiscard]] JointMatrix at_actuators(const JointMatrix& inertia_kg_m2, const JointVector& q_rad) const {
    const JointMatrix back = slope_back(q_rad);
    return direct_ ? inertia_kg_m2 : JointMatrix(back.transpose() * inertia_kg_m2 * back);
  }

  /// Torques of the joints, shrunk until the actuators need at most `most_Nm`.
  [[nodiscard]] JointVector within_torques(const JointVector& joints_Nm, const JointVector& most_Nm,
                                           const JointVector& q_rad) const noexcept;

  /// Limits of the joints, narrowed until the actuators keep their own whatever the joints do within.
  [[nodiscard]] LimbLimits within(const LimbLimits& joints, const LimbLimits& actuators) const;

  /// What the actuators come to as the joints do all that is `left` of their limits; those of a five-bar have their own
  /// `actuators`, as far as its joints' own `joints` let them.
  [[nodiscard]] LimbLimits reached(const LimbLimits& left, const LimbLimits& joints, const LimbLimits& actuators) const;

  [[nodiscard]] const std::optional<FiveBar>& five_bar() const noexcept { return five_bar_; }

  /// Of the five-bar's crank, by its actuator's.
  [[nodiscard]] Range crank_limits(const LimbLimits& actuators) const;

 private:
  [[nodiscard]] JointVector turned(JointVector q_rad) const noexcept {
    if (five_bar_) q_rad[five_bar_->first() + 1] = five_bar_->crank_rad(q_rad.segment<2>(five_bar_->first()));
    return q_rad;
  }
  [[nodiscard]] JointVector turned_back(JointVector rad) const noexcept {
    if (!five_bar_) return rad;
    const int first = five_bar_->first();
    rad[first + 1] = five_bar_->next_rad(rad[first], rad[first + 1]);
    return rad;
  }
  /// Speeds of the actuators by those of the joints, and the other way round.
  [[nodiscard]] JointMatrix slope(const JointVector& q_rad) const noexcept;
  [[nodiscard]] JointMatrix slope_back(const JointVector& q_rad) const noexcept;

  int joints_ = 0;
  bool direct_ = true;
  JointMatrix matrix_ = JointMatrix::Identity(), inverse_ = JointMatrix::Identity();
  JointVector offset_rad_ = JointVector::Zero();
  std::optional<FiveBar> five_bar_;
};

/// What the section says of the actuators themselves.
LimbLimits own_limits(const crux_msgs::robot::Transmissions& section);

}  // namespace crux
