// Joints of a limb that oscillate: a position loop that is answered too late, or a limb that yields to its own shaking.
#pragma once

#include "core/robot/fault_list.hpp"
#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Counts a joint's turns. Plans, pulls and pushes turn it a few times a second at most; a loop that is not stable
/// turns it near where it crosses over, ten to fifty times, and swings as wide each time or wider.
class OscillationWatch {
 public:
  OscillationWatch(const RobotDescription& robot, int limb) noexcept;

  /// Takes the joints' angles, once a cycle.
  void look(const JointVector& q_rad, double dt_s) noexcept;

  /// The joint that swings widest of those that oscillate; `value` is from turn to turn.
  const FaultEvent& fault() const noexcept { return fault_; }

  /// Control begins: what was before says nothing.
  void restart() noexcept;

 private:
  static constexpr int kTurns = 6;  ///< in a row: within 0.3 s from 10 Hz on

  struct Swing {
    bool begun = false;
    double way = 0.0;          ///< 1: the angle grows, -1: it falls, 0: not known yet
    double from_rad = 0.0;     ///< the last turn
    double extreme_rad = 0.0;  ///< reached since
    double since_turn_s = 0.0, since_extreme_s = 0.0;
    int turns = 0;                            ///< in a row
    std::array<double, kTurns> widths_rad{};  ///< of the last swings, the newest first
  };

  bool oscillates(Swing& swing, double q_rad, double dt_s) const noexcept;

  int limb_;
  double least_rad_;
  std::array<int, kJoints> nodes_;
  std::array<Swing, kJoints> swings_{};
  FaultEvent fault_;
};

}  // namespace crux
