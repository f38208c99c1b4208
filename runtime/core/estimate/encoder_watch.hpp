// Encoders of a limb's actuators that freeze or jump.
//
// A joint that stands still against its friction reads the same for a while, too, and its drive makes the same torque
// on it. Two things tell a frozen encoder from it: readings of a sound one hover about a standing joint by its noise;
// and where an encoder has no noise to speak of, no friction bears more than `max_ft_residual_Nm`.
#pragma once

#include "core/robot/fault_list.hpp"
#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

class EncoderWatch {
 public:
  EncoderWatch(const RobotDescription& robot, int limb) noexcept;

  /// Takes a joint's reading with its command of the cycle before; returns the angle to go by. A jump is taken for the
  /// encoder's, not the joint's: the angles go on from where they were.
  double look(int joint, double raw_rad, double command_rad, double dt_s) noexcept;

  /// Commands begin anew: what was commanded before says nothing.
  void restart() noexcept {
    seen_.fill(false);
    frozen_ = false;
  }

  /// One of them has frozen since then: where the limb is, nobody knows.
  bool frozen() const noexcept { return frozen_; }

  /// No reading came in this cycle.
  void skip(int joint, double dt_s) noexcept { silent_s_[joint] += dt_s; }

  /// What an encoder reads where the joint has `angle_rad`.
  double raw_rad(int joint, double angle_rad) const noexcept { return angle_rad + shift_rad_[joint]; }

  /// The first fault since the last call of begin_cycle.
  const FaultEvent& fault() const noexcept { return fault_; }
  void begin_cycle() noexcept { fault_ = {}; }

 private:
  /// Counts how long the joint's readings have been the same, and how often they turn back while it is to stand.
  void hover(int joint, double moved_rad, double commanded_rad) noexcept;
  /// The encoder has frozen rather than the joint, whose command has moved on by `commanded_rad` meanwhile.
  bool stands_by_itself(int joint, double commanded_rad) const noexcept;

  int limb_;
  double standstill_rad_;
  double most_friction_Nm_;
  std::array<double, kJoints> gain_Nm_rad_;
  LimbLimits actuators_;
  std::array<int, kJoints> nodes_;
  JointVector last_rad_ = JointVector::Zero();      ///< raw
  JointVector still_at_rad_ = JointVector::Zero();  ///< command when the reading changed last
  JointVector silent_s_ = JointVector::Zero();      ///< since the last reading
  JointVector shift_rad_ = JointVector::Zero();
  JointVector last_step_rad_ = JointVector::Zero();  ///< the last one that was any
  JointVector last_command_rad_ = JointVector::Zero();
  JointVector hovers_ = JointVector::Zero();  ///< share of the readings that turn back while the joint is to stand
  std::array<int, kJoints> same_{};           ///< cycles with the same reading
  std::array<bool, kJoints> seen_{};
  bool frozen_ = false;
  FaultEvent fault_;
};

}  // namespace crux
