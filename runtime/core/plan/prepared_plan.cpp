#include "core/plan/prepared_plan.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

namespace crux {
namespace {

/// Opening axis of the gripper.
Vector3 axis_W(const crux_msgs::limb_knot_t& knot) {
  return gripper_rotation(knot.gripper_yaw_w_rad, Eigen::Vector2d(knot.gripper_tilt_w_rad)).col(0);
}

/// A foot's position is its foot point, `radius_m` under the gripper.
Vector3 gripper_W_m(const crux_msgs::limb_knot_t& knot, double radius_m) {
  Vector3 place_W_m(knot.gripper_position_w_m);
  if (radius_m == 0.0) return place_W_m;
  const Matrix3 rotation = gripper_rotation(knot.gripper_yaw_w_rad, Eigen::Vector2d(knot.gripper_tilt_w_rad));
  return place_W_m + radius_m * rotation.col(2);
}

/// F = f₁ + f₂, M = Σ (pᵢ − c) × fᵢ + mᵢ with the fingers at ± half the separation along the opening axis.
Wrench gripper_wrench(const crux_msgs::limb_knot_t& knot) {
  const Vector3 axis = axis_W(knot);
  Wrench sum;
  for (int finger = 0; finger < 2; ++finger) {
    const Vector3 arm = (finger == 0 ? 0.5 : -0.5) * knot.finger_separation_m * axis;
    const Vector3 force(Eigen::Map<const Vector3>(knot.finger_force_w_n + 3 * finger));
    const Vector3 moment(Eigen::Map<const Vector3>(knot.finger_moment_w_nm + 3 * finger));
    sum = sum + Wrench{force, arm.cross(force) + moment};
  }
  return sum;
}

/// The finger at the positive end of the axis is pressed towards it, the other one away.
double squeeze_N(const crux_msgs::limb_knot_t& knot) {
  const Vector3 axis = axis_W(knot);
  return 0.5 * axis.dot(Vector3(knot.finger_force_w_n) - Vector3(knot.finger_force_w_n + 3));
}

bool on_hold(const crux_msgs::plan_t& plan, const crux_msgs::limb_knot_t& knot) {
  return knot.phase == crux_msgs::limb_knot_t::STANCE && knot.hold >= 0 && knot.hold < plan.n_holds;
}

bool on_foothold(const crux_msgs::plan_t& plan, const crux_msgs::limb_knot_t& knot) {
  return on_hold(plan, knot) && knot.finger1_face == crux_msgs::limb_knot_t::FACE_WALL;
}

/// Of the faces under both fingers; finger 2 touches the one opposite.
std::array<double, 2> leans_rad(const crux_msgs::plan_t& plan, const crux_msgs::limb_knot_t& knot) {
  if (!on_hold(plan, knot) || knot.finger1_face < 0 || knot.finger1_face >= crux_msgs::limb_knot_t::FACE_WALL)
    return {};
  const auto face = static_cast<std::uint8_t>(knot.finger1_face);
  const double* lean_rad = plan.holds[knot.hold].lean_rad;
  return {lean_rad[face], lean_rad[face ^ 1U]};
}

/// From a gripper on a hold to the circle about the foot of the nearest other hold or obstacle.
double alone_m(const crux_msgs::plan_t& plan, const crux_msgs::limb_knot_t& knot) {
  double least_m = std::numeric_limits<double>::infinity();
  for (int i = 0; i < plan.n_holds; ++i) {
    const crux_msgs::hold_t& other = plan.holds[i];
    if (i == knot.hold || other.graspable == crux_msgs::hold_t::FOOTHOLD) continue;
    const double away_m = std::hypot(other.position_w_m[0] - knot.gripper_position_w_m[0],
                                     other.position_w_m[1] - knot.gripper_position_w_m[1]);
    const bool upright = other.tilt_rad[0] == 0.0 && other.tilt_rad[1] == 0.0;
    const double size_m = std::hypot(other.size_m[0], other.size_m[1]);
    least_m = std::min(least_m, away_m - (upright ? 0.5 * size_m : std::hypot(size_m, 2.0 * other.size_m[2])));
  }
  return least_m;
}

/// How far a hold reaches off the wall.
double top_m(const crux_msgs::hold_t& hold) {
  const Matrix3 rotation = rotation_from_rpy({hold.tilt_rad[0], hold.tilt_rad[1], hold.yaw_rad});
  const Vector3 size_m(hold.size_m);
  const double across_m = 0.5 * (std::abs(rotation(2, 0)) * size_m[0] + std::abs(rotation(2, 1)) * size_m[1]);
  return hold.position_w_m[2] + across_m + std::max(rotation(2, 2) * size_m[2], 0.0);
}

/// Slopes of `dimensions` coordinates over all knots: `value(k, i)` in, `slope(k, i)` out.
template <class Value, class Slope>
void fill_slopes(const std::vector<double>& step_s, int dimensions, Value value, Slope slope) {
  const std::size_t knots = step_s.size() + 1;
  std::vector<double> values(knots);
  for (int i = 0; i < dimensions; ++i) {
    for (std::size_t k = 0; k < knots; ++k) values[k] = value(k, i);
    const std::vector<double> slopes = pchip_slopes(values, step_s);
    for (std::size_t k = 0; k < knots; ++k) slope(k, i) = slopes[k];
  }
}

/// Knots stand evenly, but in a plan in which each has its own time.
void fill_times(const crux_msgs::plan_t& plan, PreparedPlan& prepared) {
  const bool own = plan.format >= crux_msgs::plan_t::FORMAT_OWN_TIMES;
  for (std::size_t k = 0; k < plan.knots.size(); ++k) {
    prepared.time_s.push_back(own ? plan.knots[k].time_s : static_cast<double>(k) * plan.dt_s);
    if (k > 0) prepared.step_s.push_back(own ? prepared.time_s[k] - prepared.time_s[k - 1] : plan.dt_s);
  }
}

void tabulate_feet(PreparedPlan& plan) {
  const std::size_t n = plan.limbs.size();
  plan.foot_slope.resize(n);
  for (int l = 0; l < kLimbs; ++l) {
    const auto pose = [&](std::size_t k, int i) {
      const LimbKnot& knot = plan.limbs[k][l];
      return i < 3 ? knot.gripper_position_W_m[i] : knot.gripper_yaw_W_rad;
    };
    fill_slopes(plan.step_s, 4, pose, [&](std::size_t k, int i) -> double& { return plan.foot_slope[k][l][i]; });
  }
}

/// Three-point derivative at an end, kept from overshooting; secants and lengths of the two intervals there.
double end_slope(double first, double second, double first_s, double second_s) {
  const double share = first_s / (first_s + second_s);
  const double slope = (1.0 + share) * first - share * second;
  if (slope * first <= 0.0) return 0.0;
  if (first * second <= 0.0 && std::abs(slope) > 3.0 * std::abs(first)) return 3.0 * first;
  return slope;
}

}  // namespace

std::vector<double> pchip_slopes(const std::vector<double>& values, const std::vector<double>& step_s) {
  const std::size_t n = values.size();
  std::vector<double> secant(n - 1);
  for (std::size_t i = 0; i + 1 < n; ++i) secant[i] = (values[i + 1] - values[i]) / step_s[i];
  if (n == 2) return {secant[0], secant[0]};
  std::vector<double> slopes(n, 0.0);
  for (std::size_t i = 1; i + 1 < n; ++i) {
    const double a = secant[i - 1], b = secant[i];
    const double before_s = step_s[i - 1], after_s = step_s[i];
    const double share = (2.0 * after_s + before_s) / (3.0 * (before_s + after_s));
    // Weighted harmonic mean; flat where the data turns.
    if (a * b > 0.0) slopes[i] = 1.0 / (share / a + (1.0 - share) / b);
  }
  slopes.front() = end_slope(secant[0], secant[1], step_s[0], step_s[1]);
  slopes.back() = end_slope(secant[n - 2], secant[n - 3], step_s[n - 2], step_s[n - 3]);
  return slopes;
}

bool is_walk(const crux_msgs::plan_t& plan) {
  using crux_msgs::limb_knot_t;
  for (const crux_msgs::plan_knot_t& knot : plan.knots) {
    for (const limb_knot_t& limb : knot.limbs) {
      if (limb.phase == limb_knot_t::STANCE && (limb.finger1_face != limb_knot_t::FACE_WALL || limb.hold >= 0))
        return false;
    }
  }
  return true;
}

std::unique_ptr<PreparedPlan> tabulate(const crux_msgs::plan_t& plan) {
  auto prepared = std::make_unique<PreparedPlan>();
  prepared->plan_id = plan.plan_id;
  prepared->point_feet = is_walk(plan);
  prepared->gravity_W_m_s2 = Vector3(plan.gravity_w_m_s2);
  prepared->patch_k_m = plan.patch_k_m;
  prepared->max_normal_N = plan.max_normal_n;
  const std::size_t n = plan.knots.size();
  fill_times(plan, *prepared);
  if (plan.format == crux_msgs::plan_t::FORMAT_MOVING_FINGERS) prepared->swing = kMovingFingers;
  prepared->body.resize(n);
  prepared->body_slope.resize(n);
  prepared->limbs.resize(n);
  prepared->release.assign(n, 0);
  for (std::size_t k = 0; k < n; ++k) {
    const crux_msgs::plan_knot_t& knot = plan.knots[k];
    prepared->body[k] << Vector3(knot.body_position_w_m), Vector3(knot.body_rpy_rad);
    for (int l = 0; l < kLimbs; ++l) {
      const crux_msgs::limb_knot_t& from = knot.limbs[l];
      const bool foot = on_foothold(plan, from);
      const double radius_m = foot ? 0.5 * plan.holds[from.hold].size_m[0] : 0.0;
      prepared->footholds = prepared->footholds || foot;
      prepared->limbs[k][l] = {.air = from.phase == crux_msgs::limb_knot_t::AIR,
                               .foot = foot,
                               .foot_radius_m = radius_m,
                               .gripper_position_W_m = gripper_W_m(from, radius_m),
                               .gripper_yaw_W_rad = from.gripper_yaw_w_rad,
                               .gripper_tilt_W_rad = Eigen::Vector2d(from.gripper_tilt_w_rad),
                               .finger_opening_m = 0.5 * from.finger_separation_m,
                               .friction = from.friction,
                               .lean_rad = leans_rad(plan, from),
                               .hold_top_m = on_hold(plan, from) ? top_m(plan.holds[from.hold]) : 0.0,
                               .alone_m = on_hold(plan, from) ? alone_m(plan, from) : 0.0,
                               .wrench_W = gripper_wrench(from),
                               .squeeze_N = squeeze_N(from)};
    }
  }
  // Forces act over the interval that begins at a knot: the last knot has none of its own.
  for (int l = 0; l < kLimbs; ++l) {
    prepared->limbs[n - 1][l].wrench_W = prepared->limbs[n - 2][l].wrench_W;
    prepared->limbs[n - 1][l].squeeze_N = prepared->limbs[n - 2][l].squeeze_N;
  }
  for (int k = 0; k < static_cast<int>(n); ++k) {
    for (int l = 0; l < kLimbs; ++l) {
      if (prepared->lets_go(k, l)) prepared->release[k] = 1;
    }
  }
  fill_slopes(
      prepared->step_s, 6, [&](std::size_t k, int i) { return prepared->body[k][i]; },
      [&](std::size_t k, int i) -> double& { return prepared->body_slope[k][i]; });
  if (prepared->point_feet) tabulate_feet(*prepared);
  return prepared;
}

}  // namespace crux
