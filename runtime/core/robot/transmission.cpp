#include "core/robot/transmission.hpp"

#include <algorithm>
#include <cmath>

#include "core/robot/description_problem.hpp"

namespace crux {
namespace {

constexpr double kLeastDeterminant = 1e-6;  // of actuators that move every joint
constexpr double kRounding = 1e-9;          // of what does not move at all

JointVector sizes(const LimbLimits& limits, double JointLimits::* which) {
  JointVector all;
  for (int j = 0; j < kJoints; ++j) all[j] = limits[j].*which;
  return all;
}

/// `sizes`, shrunk until |matrix| * sizes is at most `most`.
JointVector shrunk(JointVector sizes, const JointMatrix& matrix, const JointVector& most, int joints) noexcept {
  for (int i = 0; i < joints; ++i) {
    const JointVector row = matrix.row(i).cwiseAbs();
    const double share = std::min(1.0, most[i] / row.dot(sizes));
    for (int j = 0; j < kJoints; ++j)
      if (row[j] > kRounding) sizes[j] *= share;
  }
  return sizes;
}

/// Angles of the joints that move an actuator; see Transmission::within.
void narrow(LimbLimits& joints, const JointVector& row, double offset_rad, const JointLimits& actuator) {
  if ((row.array() != 0.0).count() == 1) {
    int j = 0;
    row.cwiseAbs().maxCoeff(&j);
    const double one = (actuator.lower_rad - offset_rad) / row[j], other = (actuator.upper_rad - offset_rad) / row[j];
    joints[j].lower_rad = std::max(joints[j].lower_rad, std::min(one, other));
    joints[j].upper_rad = std::min(joints[j].upper_rad, std::max(one, other));
    return;
  }
  const JointVector low = sizes(joints, &JointLimits::lower_rad), high = sizes(joints, &JointLimits::upper_rad);
  const JointVector middle = (low + high) / 2.0;
  const double off_rad = row.dot(middle) + offset_rad - (actuator.lower_rad + actuator.upper_rad) / 2.0;
  const double room_rad = (actuator.upper_rad - actuator.lower_rad) / 2.0 - std::abs(off_rad);
  const JointVector half = std::min(1.0, room_rad / row.cwiseAbs().dot((high - low) / 2.0)) * (high - low) / 2.0;
  for (int j = 0; j < kJoints; ++j) {
    if (row[j] == 0.0) continue;
    joints[j].lower_rad = middle[j] - half[j];
    joints[j].upper_rad = middle[j] + half[j];
  }
}

}  // namespace

Transmission::Transmission(const crux_msgs::robot::Transmissions& section, int joints, const std::string& path)
    : joints_(joints) {
  for (int j = 0; j < joints; ++j) {
    const double number = section.coupled_to[j];
    if (number != std::floor(number) || number > joints || number == j + 1)
      refuse(path, "transmissions.coupled_to[" + std::to_string(j) + "]", shown(number),
             "expected 0 or the number of another joint, at most " + std::to_string(joints));
    matrix_(j, j) = section.ratio[j];
    offset_rad_[j] = section.offset_rad[j];
  }
  for (int j = 0; j < joints; ++j)
    if (section.coupled_to[j] > 0) matrix_(j, static_cast<int>(section.coupled_to[j]) - 1) += section.coupling[j];
  if (std::abs(matrix_.determinant()) < kLeastDeterminant)
    refuse(path, "transmissions.ratio", "", "expected actuators that move every joint");
  inverse_ = matrix_.inverse();
  direct_ = matrix_ == JointMatrix::Identity() && offset_rad_.isZero(0.0);
}

JointVector Transmission::within_torques(const JointVector& joints_Nm, const JointVector& most_Nm) const noexcept {
  return shrunk(joints_Nm, inverse_.transpose(), most_Nm, joints_);
}

LimbLimits Transmission::within(const LimbLimits& joints, const LimbLimits& actuators) const {
  LimbLimits found = joints;
  for (int i = 0; i < joints_; ++i) narrow(found, matrix_.row(i), offset_rad_[i], actuators[i]);
  const JointVector speed = shrunk(sizes(joints, &JointLimits::velocity_rad_s), matrix_,
                                   sizes(actuators, &JointLimits::velocity_rad_s), joints_);
  const JointVector torque =
      within_torques(sizes(joints, &JointLimits::effort_Nm), sizes(actuators, &JointLimits::effort_Nm));
  for (int j = 0; j < kJoints; ++j) {
    found[j].velocity_rad_s = speed[j];
    found[j].effort_Nm = torque[j];
  }
  return found;
}

LimbLimits Transmission::reached(const LimbLimits& joints) const {
  if (direct_) return joints;
  const JointVector low = sizes(joints, &JointLimits::lower_rad), high = sizes(joints, &JointLimits::upper_rad);
  const JointVector middle = actuators_rad((low + high) / 2.0), half = matrix_.cwiseAbs() * ((high - low) / 2.0);
  const JointVector speed = matrix_.cwiseAbs() * sizes(joints, &JointLimits::velocity_rad_s);
  const JointVector torque = inverse_.transpose().cwiseAbs() * sizes(joints, &JointLimits::effort_Nm);
  LimbLimits found;
  for (int i = 0; i < kJoints; ++i) found[i] = {middle[i] - half[i], middle[i] + half[i], speed[i], torque[i]};
  return found;
}

LimbLimits own_limits(const crux_msgs::robot::Transmissions& section) {
  LimbLimits found;
  for (std::size_t i = 0; i < found.size(); ++i)
    found[i] = {section.low_rad[i], section.high_rad[i], section.speed_rad_s[i], section.torque_Nm[i]};
  return found;
}

}  // namespace crux
