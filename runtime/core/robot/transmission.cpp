#include "core/robot/transmission.hpp"

#include <algorithm>
#include <cmath>

#include "core/robot/description_problem.hpp"

namespace crux {
namespace {

constexpr double kLeastDeterminant = 1e-6;  // of actuators that move every joint
constexpr double kRounding = 1e-9;          // of what does not move at all
constexpr double kUnlimited = 1e9;          // the default of speeds and torques

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

/// Of section five_bar and the one behind it.
void check(const FiveBar& five_bar, const crux_msgs::robot::Transmissions& section, const std::string& path) {
  const auto first = static_cast<std::size_t>(five_bar.first());
  for (std::size_t j = 0; j < section.coupled_to.size(); ++j) {
    const double number = section.coupled_to[j];
    if (number != 0.0 && (j == first || j == first + 1 || number == static_cast<double>(first + 2)))
      refuse(path, "transmissions.coupled_to[" + std::to_string(j) + "]", crux::shown(number),
             "expected no coupling of the five-bar's actuators, and none to its crank");
  }
  for (const auto& [key, values] : {std::pair{"speed_rad_s", section.speed_rad_s}, {"torque_Nm", section.torque_Nm}})
    if (std::max(values[first], values[first + 1]) >= kUnlimited)
      refuse(path, std::string("transmissions.") + key, "",
             "expected those of the five-bar's actuators, number " + std::to_string(first + 1) + " and " +
                 std::to_string(first + 2));
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

Transmission::Transmission(const crux_msgs::robot::Transmissions& section, int joints, const std::string& path,
                           const std::optional<FiveBar>& five_bar)
    : joints_(joints), five_bar_(five_bar) {
  for (int j = 0; j < joints; ++j) {
    const double number = section.coupled_to[j];
    if (number != std::floor(number) || number > joints || number == j + 1)
      refuse(path, "transmissions.coupled_to[" + std::to_string(j) + "]", crux::shown(number),
             "expected 0 or the number of another joint, at most " + std::to_string(joints));
    matrix_(j, j) = section.ratio[j];
    offset_rad_[j] = section.offset_rad[j];
  }
  for (int j = 0; j < joints; ++j)
    if (section.coupled_to[j] > 0) matrix_(j, static_cast<int>(section.coupled_to[j]) - 1) += section.coupling[j];
  if (std::abs(matrix_.determinant()) < kLeastDeterminant)
    refuse(path, "transmissions.ratio", "", "expected actuators that move every joint");
  if (five_bar_) check(*five_bar_, section, path);
  inverse_ = matrix_.inverse();
  direct_ = matrix_ == JointMatrix::Identity() && offset_rad_.isZero(0.0) && !five_bar_;
}

JointMatrix Transmission::slope(const JointVector& q_rad) const noexcept {
  if (!five_bar_) return matrix_;
  const int first = five_bar_->first(), crank = first + 1;
  const FiveBar::Slopes slopes = five_bar_->slopes(q_rad.segment<2>(first));
  JointMatrix all = matrix_;  // whose column of the crank has the crank's actuator alone
  all(crank, first) = matrix_(crank, crank) * slopes.first;
  all(crank, crank) = matrix_(crank, crank) * slopes.next;
  return all;
}

JointMatrix Transmission::slope_back(const JointVector& q_rad) const noexcept {
  if (!five_bar_) return inverse_;
  const int first = five_bar_->first(), crank = first + 1;
  const FiveBar::Slopes slopes = five_bar_->slopes(q_rad.segment<2>(first));
  JointMatrix all = inverse_;
  all.row(crank) = (inverse_.row(crank) - slopes.first * inverse_.row(first)) / slopes.next;
  return all;
}

JointVector Transmission::within_torques(const JointVector& joints_Nm, const JointVector& most_Nm,
                                         const JointVector& q_rad) const noexcept {
  return shrunk(joints_Nm, slope_back(q_rad).transpose(), most_Nm, joints_);
}

Range Transmission::crank_limits(const LimbLimits& actuators) const {
  const int crank = five_bar_->first() + 1;
  const double ratio = matrix_(crank, crank), offset_rad = offset_rad_[crank];
  const JointLimits& own = actuators[crank];
  const double one = (own.lower_rad - offset_rad) / ratio, other = (own.upper_rad - offset_rad) / ratio;
  return {std::min(one, other), std::max(one, other)};
}

LimbLimits Transmission::within(const LimbLimits& joints, const LimbLimits& actuators) const {
  LimbLimits found = joints;
  for (int i = 0; i < joints_; ++i)
    if (!five_bar_ || i != five_bar_->first() + 1) narrow(found, matrix_.row(i), offset_rad_[i], actuators[i]);
  JointMatrix speeds = matrix_, torques = inverse_.transpose();
  if (five_bar_) {
    const int first = five_bar_->first(), next = first + 1;
    const auto range = [&](int j) { return Range{found[j].lower_rad, found[j].upper_rad}; };
    const FiveBar::Ranges box = five_bar_->box({range(first), range(next)}, crank_limits(actuators));
    for (const int i : {0, 1})
      found[first + i].lower_rad = box[i].low_rad, found[first + i].upper_rad = box[i].high_rad;
    if (box[0].low_rad > box[0].high_rad) return found;
    const FiveBar::Steepest most = five_bar_->steepest(box);
    JointMatrix by_speed = JointMatrix::Identity(), by_torque = JointMatrix::Identity();
    by_speed(next, first) = most.speeds.first, by_speed(next, next) = most.speeds.next;
    by_torque(first, next) = most.first_by_next, by_torque(next, next) = most.crank_by_next;
    speeds = speeds.cwiseAbs() * by_speed;
    torques = torques.cwiseAbs() * by_torque;
  }
  const JointVector speed = shrunk(sizes(joints, &JointLimits::velocity_rad_s), speeds,
                                   sizes(actuators, &JointLimits::velocity_rad_s), joints_);
  const JointVector torque =
      shrunk(sizes(joints, &JointLimits::effort_Nm), torques, sizes(actuators, &JointLimits::effort_Nm), joints_);
  for (int j = 0; j < kJoints; ++j) {
    found[j].velocity_rad_s = speed[j];
    found[j].effort_Nm = torque[j];
  }
  return found;
}

LimbLimits Transmission::reached(const LimbLimits& left, const LimbLimits& joints, const LimbLimits& actuators) const {
  if (direct_) return left;
  const JointVector low = sizes(left, &JointLimits::lower_rad), high = sizes(left, &JointLimits::upper_rad);
  const JointVector middle = matrix_ * ((low + high) / 2.0) + offset_rad_;
  const JointVector half = matrix_.cwiseAbs() * ((high - low) / 2.0);
  const JointVector speed = matrix_.cwiseAbs() * sizes(left, &JointLimits::velocity_rad_s);
  const JointVector torque = inverse_.transpose().cwiseAbs() * sizes(left, &JointLimits::effort_Nm);
  LimbLimits found;
  for (int i = 0; i < kJoints; ++i) found[i] = {middle[i] - half[i], middle[i] + half[i], speed[i], torque[i]};
  if (!five_bar_) return found;
  const int first = five_bar_->first();
  const std::array<Range, 2> turns{Range{joints[first].lower_rad, joints[first].upper_rad},
                                   five_bar_->crank_range(crank_limits(actuators))};
  for (const int i : {0, 1}) {
    const double ratio = matrix_(first + i, first + i), offset_rad = offset_rad_[first + i];
    const double one = ratio * turns[i].low_rad + offset_rad, other = ratio * turns[i].high_rad + offset_rad;
    const JointLimits& own = actuators[first + i];
    found[first + i] = {std::max(std::min(one, other), own.lower_rad), std::min(std::max(one, other), own.upper_rad),
                        own.velocity_rad_s, own.effort_Nm};
  }
  return found;
}

LimbLimits own_limits(const crux_msgs::robot::Transmissions& section) {
  LimbLimits found;
  for (std::size_t i = 0; i < found.size(); ++i)
    found[i] = {section.low_rad[i], section.high_rad[i], section.speed_rad_s[i], section.torque_Nm[i]};
  return found;
}

}  // namespace crux
