// A plan made ready for the real-time thread: validated, with slopes and gripper wrenches worked out. Immutable.
#pragma once

#include <array>
#include <crux_msgs/plan_t.hpp>
#include <memory>
#include <string>
#include <vector>

#include "core/robot/geometry.hpp"

namespace crux {

/// One limb at one knot.
struct LimbKnot {
  bool air = false;
  bool foot = false;           ///< stands on a foothold: pushes, and grips nothing
  double foot_radius_m = 0.0;  ///< from its foot point to the gripper, along the gripper's z
  Vector3 gripper_position_W_m = Vector3::Zero();
  double gripper_yaw_W_rad = 0.0;
  Eigen::Vector2d gripper_tilt_W_rad = Eigen::Vector2d::Zero();  ///< see gripper_rotation()
  double finger_opening_m = 0.0;                                 ///< pad face to gripper centre
  double friction = 0.0;
  std::array<double, 2> lean_rad{};  ///< of the faces under fingers 1 and 2
  double hold_top_m = 0.0;           ///< of the hold gripped, off the wall
  double alone_m = 0.0;  ///< from the gripper, along the wall, to the next thing that stands on it; 0 in the air
  // On the robot about the gripper centre, a foot's about its foot point, piecewise constant over the interval that
  // begins here.
  Wrench wrench_W;
  double squeeze_N = 0.0;  ///< mean of what both fingers press along the axis through them
};

using FootPose = Eigen::Vector4d;  ///< x, y, z, yaw

/// Instants of PLAN.md in a swing's first and last interval, as shares of it.
struct SwingShares {
  double lift = 0.5;          ///< the gripper lifts
  double arrive = 0.55;       ///< it stands at the hold
  double close = 0.6;         ///< fingers close until they press
  bool fingers_move = false;  ///< over the whole interval; else they have opened at `lift`, and close from `close` on
};
inline constexpr SwingShares kMovingFingers = {.lift = 0.4, .arrive = 0.6, .close = 0.6, .fingers_move = true};

struct PreparedPlan {
  std::string plan_id;
  std::string follows;  ///< id of the plan that this one goes on from, empty where it stands for itself
  int shared = 0;       ///< intervals from the first that it has of that plan
  SwingShares swing;
  bool point_feet = false;  ///< a walk: limbs in stance stand on the wall itself
  bool footholds = false;   ///< some limb stands on a foothold, as a point foot among grips
  Vector3 gravity_W_m_s2 = Vector3::Zero();
  double patch_k_m = 0.0;
  double max_normal_N = 0.0;
  std::vector<double> time_s;       ///< of the knots
  std::vector<double> step_s;       ///< from knot k to k + 1
  std::vector<Vector6> body;        ///< position, roll-pitch-yaw at the knots
  std::vector<Vector6> body_slope;  ///< their PCHIP derivatives [1/s]
  std::vector<PerLimb<LimbKnot>> limbs;
  std::vector<PerLimb<FootPose>> foot_slope;  ///< PCHIP derivatives of the gripper poses [1/s]; point feet only
  std::vector<char> release;                  ///< 1: a limb releases its hold at this knot (k0 of PLAN.md)

  int intervals() const { return static_cast<int>(limbs.size()) - 1; }
  double end_s() const { return time_s.back(); }
  /// Limb l releases at knot k, or is in the air where the plan begins: the first knot of a swing.
  bool lets_go(int k, int l) const { return k <= intervals() && limbs[k][l].air && (k == 0 || !limbs[k - 1][l].air); }
  /// Limb l takes hold at knot k: the first knot after a swing.
  bool takes_hold(int k, int l) const { return k > 0 && k <= intervals() && !limbs[k][l].air && limbs[k - 1][l].air; }
};

/// Every limb in stance stands on the wall itself, none on a foothold.
bool is_walk(const crux_msgs::plan_t& plan);

/// The tables of a plan, without asking whether it makes sense. Point feet of a walk are at their foot points.
std::unique_ptr<PreparedPlan> tabulate(const crux_msgs::plan_t& plan);

/// Slopes of the monotone piecewise cubic through values that stand step_s[i] apart (Fritsch & Carlson 1980; one-sided
/// three-point ends).
std::vector<double> pchip_slopes(const std::vector<double>& values, const std::vector<double>& step_s);

}  // namespace crux
