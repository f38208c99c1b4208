#include "core/plan/plan_join.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/robot/hash.hpp"

namespace crux {
namespace {

using crux_msgs::hold_t;
using crux_msgs::limb_knot_t;
using crux_msgs::plan_knot_t;
using crux_msgs::plan_t;

constexpr double kTolerance = 1e-6;  // between the end of a part and the start of the next [m, rad, m/s²]

double off(const double* one, const double* other, int n) {
  double most = 0.0;
  for (int i = 0; i < n; ++i) most = std::max(most, std::abs(one[i] - other[i]));
  return most;
}

double off(const limb_knot_t& one, const limb_knot_t& other) {
  return std::max(off(one.gripper_position_w_m, other.gripper_position_w_m, 3),
                  std::abs(one.gripper_yaw_w_rad - other.gripper_yaw_w_rad));
}

/// The same values, but for those that act over the interval after a knot.
bool same_pose(const PerLimb<LimbKnot>& one, const PerLimb<LimbKnot>& other) noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    const bool same =
        one[l].air == other[l].air &&
        (one[l].gripper_position_W_m - other[l].gripper_position_W_m).cwiseAbs().maxCoeff() <= kTolerance &&
        std::abs(one[l].gripper_yaw_W_rad - other[l].gripper_yaw_W_rad) <= kTolerance;
    if (!same) return false;
  }
  return true;
}

bool same_knot(const PerLimb<LimbKnot>& one, const PerLimb<LimbKnot>& other) noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    const LimbKnot &a = one[l], &b = other[l];
    const bool same = a.air == b.air && a.gripper_position_W_m == b.gripper_position_W_m &&
                      a.gripper_yaw_W_rad == b.gripper_yaw_W_rad && a.finger_opening_m == b.finger_opening_m &&
                      a.friction == b.friction && a.wrench_W.force_N == b.wrench_W.force_N &&
                      a.wrench_W.moment_Nm == b.wrench_W.moment_Nm && a.squeeze_N == b.squeeze_N;
    if (!same) return false;
  }
  return true;
}

}  // namespace

std::string join_defect(const plan_t& before, const plan_t& part) {
  std::ostringstream defect;
  if (before.knots.empty() || part.knots.empty()) {
    defect << "a plan has no knots";
  } else if (is_walk(before) || is_walk(part)) {
    defect << "a walk has no parts";
  } else if (part.format != before.format) {
    defect << "its format is " << part.format << ", the loaded plan's is " << before.format;
  } else if (part.patch_k_m != before.patch_k_m || part.max_normal_n != before.max_normal_n ||
             off(part.gravity_w_m_s2, before.gravity_w_m_s2, 3) > kTolerance) {
    defect << "its patch_k_m, max_normal_n or gravity_w_m_s2 is another";
  } else {
    const plan_knot_t &end = before.knots.back(), &begin = part.knots.front();
    const double body =
        std::max(off(end.body_position_w_m, begin.body_position_w_m, 3), off(end.body_rpy_rad, begin.body_rpy_rad, 3));
    if (!(body <= kTolerance)) defect << "its body begins " << body << " m or rad off the loaded plan's end";
    for (int l = 0; l < kLimbs && defect.str().empty(); ++l) {
      const double limb = off(end.limbs[l], begin.limbs[l]);
      if (begin.limbs[l].phase != limb_knot_t::STANCE) defect << "limb " << l << " begins in the air";
      if (!(limb <= kTolerance)) defect << "limb " << l << " begins " << limb << " m or rad off the loaded plan's end";
    }
  }
  return defect.str();
}

plan_t joined(const plan_t& before, const plan_t& part) {
  plan_t whole = part;
  whole.cost = before.cost + part.cost;
  whole.holds = before.holds;
  std::vector<std::int32_t> number;  // of the part's holds in the whole plan
  for (const hold_t& hold : part.holds) {
    const auto known = std::ranges::find_if(whole.holds, [&](const hold_t& other) {
      return other.name == hold.name && std::ranges::equal(other.position_w_m, hold.position_w_m);
    });
    number.push_back(static_cast<std::int32_t>(known - whole.holds.begin()));
    if (known == whole.holds.end()) whole.holds.push_back(hold);
  }
  const double end_s = before.knots.back().time_s;
  whole.knots.assign(before.knots.begin(), before.knots.end() - 1);
  for (plan_knot_t knot : part.knots) {
    knot.time_s += end_s;
    for (limb_knot_t& limb : knot.limbs) {
      if (limb.hold >= 0) limb.hold = number[static_cast<std::size_t>(limb.hold)];
    }
    whole.knots.push_back(knot);
  }
  whole.n_knots = static_cast<std::int32_t>(whole.knots.size());
  whole.n_holds = static_cast<std::int32_t>(whole.holds.size());
  whole.plan_id.clear();
  std::string bytes(static_cast<std::size_t>(whole.getEncodedSize()), '\0');
  whole.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  whole.plan_id = sha256_hex(bytes);
  return whole;
}

std::unique_ptr<const PreparedPlan> prepare_joined(const plan_t& before, const plan_t& whole) {
  std::unique_ptr<PreparedPlan> tables = tabulate(whole);
  tables->follows = before.plan_id;
  return tables;
}

bool extends(const PreparedPlan& longer, const PreparedPlan& running) noexcept {
  const int n = running.intervals();
  if (longer.intervals() <= n || longer.point_feet || running.point_feet ||
      longer.swing.fingers_move != running.swing.fingers_move || longer.swing.lift != running.swing.lift) {
    return false;
  }
  for (int k = 0; k < n; ++k) {
    const bool last = k + 1 == n;
    if (longer.time_s[k] != running.time_s[k] || longer.body[k] != running.body[k] ||
        (!last && longer.step_s[k] != running.step_s[k]) || !same_knot(longer.limbs[k], running.limbs[k])) {
      return false;
    }
  }
  return (longer.body[n] - running.body[n]).cwiseAbs().maxCoeff() <= kTolerance &&
         same_pose(longer.limbs[n], running.limbs[n]);
}

}  // namespace crux
