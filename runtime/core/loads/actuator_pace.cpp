#include "core/loads/actuator_pace.hpp"

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

constexpr double kOnset_s = 0.010;   // from a command to the motion it makes, as it is seen: buses and current loop
constexpr double kWindow_s = 0.025;  // long enough to tell a speed from opening and force
constexpr double kLead_s = 0.010;    // that commands may be ahead by: what buses need
constexpr double kLeast = 0.1;       // of the described speed: a setpoint that is slower stands still
constexpr double kAlike = 0.25;      // two windows that show speeds as close as this show the same one
constexpr double kFaster = 1.1;      // a limit that is kept up with grows by so much in a window

}  // namespace

void ActuatorPace::stand_at(double setpoint_m) noexcept {
  command_m_ = setpoint_m_ = setpoint_m;
  direction_ = 0.0;
}

void ActuatorPace::begin_motion(double direction) noexcept {
  direction_ = direction;
  from_m_ = setpoint_m_;
  motion_s_ = slower_m_s_ = 0.0;
  window_s_ = -kOnset_s;
}

void ActuatorPace::begin_window(double seen_m) noexcept {
  window_s_ = 0.0;
  window_command_m_ = command_m_;
  window_seen_m_ = seen_m;
}

double ActuatorPace::follow(double command_m, double seen_m, double dt_s) noexcept {
  const double wanted_m_s = (command_m - command_m_) / dt_s;
  const bool moves = std::abs(wanted_m_s) > kLeast * gripper_.max_finger_speed_m_s;
  const double direction = moves ? std::copysign(1.0, wanted_m_s) : 0.0;
  if (direction != direction_) begin_motion(direction);
  command_m_ = command_m;
  const double reach_m = limit_m_s_ * dt_s;
  setpoint_m_ += std::clamp(command_m_ - setpoint_m_, -reach_m, reach_m);
  motion_s_ += dt_s;
  if (direction_ != 0.0) {
    window_s_ += dt_s;
    if (window_s_ < 0.5 * dt_s && window_s_ > -0.5 * dt_s) begin_window(seen_m);
    if (window_s_ >= kWindow_s) judge(command_m_, seen_m);
  }
  if (limit_m_s_ < gripper_.max_finger_speed_m_s) {
    const double lead_m = kLead_s * limit_m_s_;
    command_m_ = std::clamp(command_m_, setpoint_m_ - lead_m, setpoint_m_ + lead_m);
  }
  return command_m_;
}

/// At the end of a window.
void ActuatorPace::judge(double command_m, double seen_m) noexcept {
  const double commanded_m_s = direction_ * (command_m - window_command_m_) / window_s_;
  const double seen_m_s = direction_ * (seen_m - window_seen_m_) / window_s_;
  const double behind_m = direction_ * (command_m - seen_m);
  const bool falls_behind = behind_m > kLead_s * commanded_m_s && seen_m_s < commanded_m_s;
  const bool moves = seen_m_s > kLeast * gripper_.max_finger_speed_m_s;
  if (falls_behind && moves && std::abs(seen_m_s - slower_m_s_) < kAlike * seen_m_s) {
    limit_m_s_ = std::min(std::max(seen_m_s, slower_m_s_), limit_m_s_);
    // It has been as slow from the beginning of this motion on.
    const double way_m = std::min(direction_ * (setpoint_m_ - from_m_), limit_m_s_ * motion_s_);
    setpoint_m_ = from_m_ + direction_ * way_m;
    slower_m_s_ = 0.0;
  } else {
    slower_m_s_ = falls_behind && moves ? seen_m_s : 0.0;
    if (!falls_behind && moves) limit_m_s_ = std::min(kFaster * limit_m_s_, gripper_.max_finger_speed_m_s);
  }
  begin_window(seen_m);
}

}  // namespace crux
