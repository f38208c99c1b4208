// How fast a gripper's actuator follows its command, measured in service, and where its setpoint is.
#pragma once

#include "core/robot/robot_description.hpp"

namespace crux {

/// The position loop of the actuator moves its setpoint towards the command no faster than its own limit, which may be
/// less than the description says. The setpoint shows in opening and finger force, s = opening − (F − d·ẋ)/k. Where it
/// falls behind a command that moves on, in two windows running by about the same speed, that speed is the limit.
/// A setpoint that stands still is no slow actuator: a finger force that reads the same for ever looks like that.
class ActuatorPace {
 public:
  explicit ActuatorPace(const GripperDescription& gripper) noexcept
      : gripper_(gripper), limit_m_s_(gripper.max_finger_speed_m_s) {}

  /// The actuator stands, its setpoint at `setpoint_m`. What was learnt of its speed stays.
  void stand_at(double setpoint_m) noexcept;

  /// One period, in which the command is to become `command_m` and the sensors show a setpoint of `seen_m`. Returns the
  /// command to give: no further ahead of the setpoint than kLead_s of motion, so that it does not run away from a slow
  /// actuator.
  double follow(double command_m, double seen_m, double dt_s) noexcept;

  /// Setpoint [m] by the commands given and the limit.
  double setpoint_m() const { return setpoint_m_; }
  double limit_m_s() const { return limit_m_s_; }

 private:
  void begin_motion(double direction) noexcept;
  void begin_window(double seen_m) noexcept;
  void judge(double command_m, double seen_m) noexcept;

  GripperDescription gripper_;
  double limit_m_s_;
  double command_m_ = 0.0, setpoint_m_ = 0.0;
  double direction_ = 0.0;                               ///< of a motion that goes on; 0: the command stands
  double from_m_ = 0.0;                                  ///< setpoint at its beginning
  double motion_s_ = 0.0;                                ///< since then
  double window_s_ = 0.0;                                ///< since its present window began,
  double window_command_m_ = 0.0, window_seen_m_ = 0.0;  ///< and where these were then
  double slower_m_s_ = 0.0;                              ///< what the window before showed; 0: no limit
};

}  // namespace crux
