#include "core/estimate/oscillation_watch.hpp"

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

constexpr double kLongest_s = 0.05;  // from turn to turn: 10 Hz
constexpr double kSustained = 0.8;   // of the oldest swings: shaking that dies down is none

}  // namespace

OscillationWatch::OscillationWatch(const RobotDescription& robot, int limb) noexcept
    : limb_(limb), least_rad_(robot.supervisor.oscillation_rad), nodes_(robot.can.nodes.joints) {}

void OscillationWatch::restart() noexcept {
  swings_.fill({});
  fault_ = {};
}

/// Takes a joint's angle. It has turned once it has come back by a part of what counts.
bool OscillationWatch::oscillates(Swing& swing, double q_rad, double dt_s) const noexcept {
  if (!swing.begun) {
    swing = {};
    swing.begun = true;
    swing.from_rad = swing.extreme_rad = q_rad;
  }
  swing.since_turn_s += dt_s;
  swing.since_extreme_s += dt_s;
  if (swing.way == 0.0 && std::abs(q_rad - swing.from_rad) >= least_rad_)
    swing.way = q_rad > swing.from_rad ? 1.0 : -1.0;
  if (swing.since_turn_s > 2.0 * kLongest_s) swing.turns = 0;
  if ((q_rad - swing.extreme_rad) * swing.way > 0.0) {
    swing.extreme_rad = q_rad;
    swing.since_extreme_s = 0.0;
  }
  if ((swing.extreme_rad - q_rad) * swing.way < least_rad_) return false;
  const double lasted_s = swing.since_turn_s - swing.since_extreme_s;
  std::shift_right(swing.widths_rad.begin(), swing.widths_rad.end(), 1);
  swing.widths_rad[0] = std::abs(swing.extreme_rad - swing.from_rad);
  swing.turns = lasted_s <= kLongest_s ? swing.turns + 1 : 0;
  swing.from_rad = swing.extreme_rad;
  swing.since_turn_s = swing.since_extreme_s;
  swing.way = -swing.way;
  swing.extreme_rad = q_rad;
  swing.since_extreme_s = 0.0;
  const auto& widths = swing.widths_rad;
  return swing.turns >= kTurns && widths[0] + widths[1] >= kSustained * (widths[kTurns - 2] + widths[kTurns - 1]);
}

void OscillationWatch::look(const JointVector& q_rad, double dt_s) noexcept {
  fault_ = {};
  for (int j = 0; j < kJoints; ++j) {
    Swing& swing = swings_[j];
    if (!oscillates(swing, q_rad[j], dt_s)) continue;
    if (swing.widths_rad[0] > fault_.value)
      fault_ = {FaultCode::kJointOscillates, limb_, nodes_[j], swing.widths_rad[0], least_rad_};
  }
}

}  // namespace crux
