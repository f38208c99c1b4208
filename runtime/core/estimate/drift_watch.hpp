// Holds that creep and encoders that drift: what is suspected while the robot climbs, and what is told.
#pragma once

#include "core/estimate/stance_fit.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// A gripper that moves slowly against the others is told where the robot stands under a steady load: there neither
/// joints that were homed wrongly nor soft holds move it. One that seems to move while the robot climbs is suspected:
/// the plan's clock waits, and what was suspected shows again, or was none.
class DriftWatch {
 public:
  explicit DriftWatch(const StanceParameters& parameters) : parameters_(parameters) {}

  /// Once a cycle, after `stance`. `compliance_m_N`: of each hold, as known. `counts`: otherwise something else moves a
  /// gripper. `climbs`: the clock may wait.
  void update(StanceFit& stance, const PerLimb<double>& compliance_m_N, bool counts, bool climbs, double dt_s) noexcept;

  /// The limb for which the clock waits; -1: none.
  int suspected() const { return suspected_; }

  struct Told {
    int limb = -1;          ///< -1: none
    int joint = -1;         ///< whose encoder drifts; -1: the hold creeps
    double moved = 0.0;     ///< the gripper [m], or the joint [rad],
    double within_s = 0.0;  ///< in this time
  };
  /// The first since the operator has looked.
  const Told& told() const { return told_; }

 private:
  void look(const StanceFit& stance, const PerLimb<double>& compliance_m_N, bool climbs, double dt_s) noexcept;

  StanceParameters parameters_;
  Told told_;
  int suspected_ = -1;
  int looks_ = 0;          ///< at what moved, in a row
  bool moves_ = false;     ///< what is suspected, in the last second
  double waited_s_ = 0.0;  ///< for it
  int cleared_ = 0;        ///< suspicions that were none
};

}  // namespace crux
