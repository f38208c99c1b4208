// How a plan is read between its knots: msgs/PLAN.md, pure.
#pragma once

#include <array>

#include "core/plan/prepared_plan.hpp"

namespace crux {

/// limb_reference_t.phase
enum class LimbPhase : int {
  kStance = 0,
  kUnload = 1,
  kOpen = 2,
  kLift = 3,
  kSwing = 4,
  kDescend = 5,
  kClose = 6,
  kLoad = 7
};

// Instants of PLAN.md as shares of an interval.
inline constexpr double kLoadBegin = 0.02, kLoadSpan = 0.4;      ///< blend from the last interval's wrench
inline constexpr double kUnloadBegin = 0.5, kUnloadSpan = 0.45;  ///< blend towards the next one's

/// A point of plan time: the interval [k, k + 1) and the time in it. An interval's end and the next one's beginning are
/// two different points: at the end a limb about to release is unloaded but still gripped. `back`: the plan is played
/// in reverse, so fingers close where a swing begins and open where it ends.
struct PlanTime {
  int interval = 0;
  double elapsed_s = 0.0;
  bool back = false;

  double seconds(const PreparedPlan& plan) const { return plan.time_s[interval] + elapsed_s; }
};

struct LimbReference {
  LimbPhase phase = LimbPhase::kStance;
  double load = 1.0;  ///< share of the planned wrench this limb bears
  Vector3 gripper_position_W_m = Vector3::Zero();
  double gripper_yaw_W_rad = 0.0;
  Eigen::Vector2d gripper_tilt_W_rad = Eigen::Vector2d::Zero();
  double finger_opening_m = 0.0;
  double open_m = 0.0;      ///< the same, at either end of a swing, where the fingers are open for the way
  double opens_m = 0.0;     ///< while it leaves a hold: how much further open than on it
  double may_lack_m = 0.0;  ///< of that, as it lifts
  Wrench wrench_W;          ///< on the robot about the gripper centre, of one on a foothold about its foot point
  double squeeze_N = 0.0;   ///< of each finger, as planned
  double friction = 0.0;    ///< of the hold gripped or about to be gripped
  std::array<double, 2> lean_rad{};  ///< of its faces under fingers 1 and 2, off the upright
  bool back = false;                 ///< in reverse: a swing leads to the hold that it began at
  bool point_foot = false;     ///< stands or steps on the wall itself: no fingers to open or close, nothing to wait for
  bool on_foothold = false;    ///< among grips it stands on a foothold, or comes down on one: no fingers that press
  double foot_radius_m = 0.0;  ///< there, from the foot point to the gripper, along off_W()

  /// It pushes, and grips nothing.
  bool foot() const { return point_foot || on_foothold; }
  /// On a foothold: from the gripper to the foot point, at which its force acts.
  Vector3 to_foot_W_m() const { return -foot_radius_m * off_W(); }

  bool gripping() const {
    return phase == LimbPhase::kStance || phase == LimbPhase::kUnload || phase == LimbPhase::kLoad;
  }
  bool closing() const { return phase == LimbPhase::kClose; }
  /// The gripper is on its way, and not yet down to its hold.
  bool passing() const { return !point_foot && (phase == LimbPhase::kLift || phase == LimbPhase::kSwing); }
  Matrix3 gripper_rotation_W() const { return gripper_rotation(gripper_yaw_W_rad, gripper_tilt_W_rad); }
  bool upright() const { return gripper_tilt_W_rad.isZero(0.0); }
  /// Unit vector through both pads, towards finger 1.
  Vector3 finger_axis_W() const { return gripper_rotation_W().col(0); }
  /// Unit vector from the pads to the palm: the way off the hold.
  Vector3 off_W() const { return gripper_rotation_W().col(2); }
};

struct PlanReference {
  Pose body_W;
  PerLimb<LimbReference> limbs;
};

/// The reference at `at`. Allocates nothing.
PlanReference play(const PreparedPlan& plan, const PlanTime& at) noexcept;

/// Where in the interval that begins at knot k all limbs bear their loads [s]: at the knot, or, where one takes hold
/// there, when it bears its whole load. Negative where a limb is in the air at the knot: no stance of the plan.
double stance_s(const PreparedPlan& plan, int k) noexcept;

/// `at` moved on its way by `ahead_s` without waiting for events, at most to the plan's end or, in reverse, beginning.
PlanTime later(const PreparedPlan& plan, const PlanTime& at, double ahead_s) noexcept;

}  // namespace crux
