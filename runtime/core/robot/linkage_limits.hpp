// What a five-bar leaves the two joints that it moves, which is no range of each: for inverse kinematics.
#pragma once

#include "core/robot/robot_description.hpp"

namespace crux {

/// Of a limb without a five-bar everything holds. Nothing allocates.
class LinkageLimits {
 public:
  explicit LinkageLimits(const LimbDescription& limb);

  /// Ranges of the joints, outside of which nothing holds: those of a five-bar's joints are the joints' own.
  JointVector lower_rad, upper_rad, velocity_rad_s;

  [[nodiscard]] bool holds(const JointVector& q_rad) const noexcept {
    return !bar_ || bar_->holds(q_rad.segment<2>(bar_->first()), crank_);
  }

  /// A joint is at an end of its range, or the five-bar at the edge of what holds.
  [[nodiscard]] bool at_an_end(const JointVector& q_rad) const noexcept;

  /// `q_rad` within the ranges, with the five-bar's joints drawn towards their middle as far as must be.
  [[nodiscard]] JointVector inside(const JointVector& q_rad) const noexcept;

  /// The ranges, with that of the next joint as the five-bar has it for the first where it is at `q_rad`, which holds.
  void edges(const JointVector& q_rad, JointVector& lower, JointVector& upper) const noexcept;

  /// As far as it holds on the way from `q_rad`, which holds, to `there_rad`.
  [[nodiscard]] JointVector as_far(const JointVector& q_rad, const JointVector& there_rad) const noexcept;

  /// Share of small ways `dq` of the joints that they and the five-bar's actuators can go in a time.
  [[nodiscard]] double speed_share(const JointVector& dq, const JointVector& q_rad, double dt_s) const noexcept;

 private:
  std::optional<FiveBar> bar_;
  Range crank_;
  Transmission transmission_;
  JointVector middle_rad_, actuators_rad_s_;
  int turns_;
};

}  // namespace crux
