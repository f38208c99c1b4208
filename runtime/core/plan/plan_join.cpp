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

constexpr double kTolerance = 1e-6;  // between a plan's stance and the start of what goes on there [m, rad, m/s²]
// A grip that is found farther off than this is another one.
constexpr double kFound_m = 0.05, kFound_rad = 0.2;

double off(const double* one, const double* other, int n) {
  double most = 0.0;
  for (int i = 0; i < n; ++i) most = std::max(most, std::abs(one[i] - other[i]));
  return most;
}

double body_off(const plan_knot_t& one, const plan_knot_t& other) {
  return std::max(off(one.body_position_w_m, other.body_position_w_m, 3), off(one.body_rpy_rad, other.body_rpy_rad, 3));
}

bool same_place(const LimbKnot& a, const LimbKnot& b) noexcept {
  return a.gripper_position_W_m == b.gripper_position_W_m && a.gripper_yaw_W_rad == b.gripper_yaw_W_rad &&
         a.gripper_tilt_W_rad == b.gripper_tilt_W_rad;
}

bool found_near(const LimbKnot& a, const LimbKnot& b) noexcept {
  return (a.gripper_position_W_m - b.gripper_position_W_m).cwiseAbs().maxCoeff() <= kFound_m &&
         std::abs(a.gripper_yaw_W_rad - b.gripper_yaw_W_rad) <= kFound_rad &&
         (a.gripper_tilt_W_rad - b.gripper_tilt_W_rad).cwiseAbs().maxCoeff() <= kFound_rad;
}

/// The same limbs hold on, as near as grips are found.
bool same_stance(const PerLimb<LimbKnot>& one, const PerLimb<LimbKnot>& other) noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    if (one[l].air != other[l].air || !found_near(one[l], other[l])) return false;
  }
  return true;
}

/// The same values, but that a grip which was found elsewhere has turned what it bears.
bool same_knot(const PerLimb<LimbKnot>& one, const PerLimb<LimbKnot>& other) noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    const LimbKnot &a = one[l], &b = other[l];
    if (a.air != b.air || a.finger_opening_m != b.finger_opening_m || a.friction != b.friction) return false;
    const bool same = same_place(a, b) ? a.wrench_W.force_N == b.wrench_W.force_N &&
                                             a.wrench_W.moment_Nm == b.wrench_W.moment_Nm && a.squeeze_N == b.squeeze_N
                                       : !a.air && found_near(a, b);
    if (!same) return false;
  }
  return true;
}

/// The same hold, wherever it was found.
bool same_hold(const hold_t& one, const hold_t& other) {
  return one.name == other.name && off(one.position_w_m, other.position_w_m, 3) <= kFound_m;
}

bool same_grip(const plan_t& before, const limb_knot_t& held, const plan_t& part, const limb_knot_t& holds) {
  const auto is_hold = [](const plan_t& plan, int hold) {
    return hold >= 0 && hold < static_cast<int>(plan.holds.size());
  };
  return held.phase == limb_knot_t::STANCE && holds.phase == limb_knot_t::STANCE &&
         held.finger1_face == holds.finger1_face && is_hold(before, held.hold) && is_hold(part, holds.hold) &&
         same_hold(before.holds[held.hold], part.holds[holds.hold]) &&
         off(held.gripper_position_w_m, holds.gripper_position_w_m, 3) <= kFound_m &&
         std::abs(held.gripper_yaw_w_rad - holds.gripper_yaw_w_rad) <= kFound_rad &&
         off(held.gripper_tilt_w_rad, holds.gripper_tilt_w_rad, 2) <= kFound_rad;
}

/// The grip is where `found` has it, and what its fingers bear turns with it.
void take_to(limb_knot_t& grip, const limb_knot_t& found) {
  const double turned_rad = found.gripper_yaw_w_rad - grip.gripper_yaw_w_rad;
  if (std::max(off(grip.gripper_position_w_m, found.gripper_position_w_m, 3), std::abs(turned_rad)) <= kTolerance)
    return;
  const double c = std::cos(turned_rad), s = std::sin(turned_rad);
  for (double* const vectors : {grip.finger_force_w_n, grip.finger_moment_w_nm}) {
    for (double* v : {vectors, vectors + 3}) {
      const double x = c * v[0] - s * v[1], y = s * v[0] + c * v[1];
      v[0] = x;
      v[1] = y;
    }
  }
  std::ranges::copy(found.gripper_position_w_m, grip.gripper_position_w_m);
  grip.gripper_yaw_w_rad = found.gripper_yaw_w_rad;
  std::ranges::copy(found.gripper_tilt_w_rad, grip.gripper_tilt_w_rad);
}

/// Of the part's holds in the whole plan, in which they come to be where the part has them.
std::vector<std::int32_t> add_holds(plan_t& whole, const plan_t& part) {
  std::vector<std::int32_t> number;
  for (const hold_t& hold : part.holds) {
    const auto known = std::ranges::find_if(whole.holds, [&](const hold_t& other) { return same_hold(hold, other); });
    number.push_back(static_cast<std::int32_t>(known - whole.holds.begin()));
    if (known == whole.holds.end()) {
      whole.holds.push_back(hold);
    } else {
      const auto graspable = std::max(known->graspable, hold.graspable);
      *known = hold;
      known->graspable = graspable;
    }
  }
  return number;
}

}  // namespace

int join_knot(const plan_t& before, const plan_t& part) {
  for (int k = static_cast<int>(before.knots.size()) - 1; k > 0; --k) {
    const plan_knot_t &here = before.knots[k], &begin = part.knots.front();
    bool same = body_off(here, begin) <= kTolerance;
    for (int l = 0; l < kLimbs && same; ++l) same = same_grip(before, here.limbs[l], part, begin.limbs[l]);
    if (same) return k;
  }
  return -1;
}

std::string join_defect(const plan_t& before, const plan_t& part) {
  std::ostringstream defect;
  if (before.knots.empty() || part.knots.empty()) {
    defect << "a plan has no knots";
  } else if (is_walk(before) || is_walk(part)) {
    defect << "a walk has no parts";
  } else if (before.format == plan_t::FORMAT_FEET || part.format == plan_t::FORMAT_FEET) {
    defect << "a plan with footholds has no parts";
  } else if (part.format != before.format) {
    defect << "its format is " << part.format << ", the loaded plan's is " << before.format;
  } else if (part.patch_k_m != before.patch_k_m || part.max_normal_n != before.max_normal_n ||
             off(part.gravity_w_m_s2, before.gravity_w_m_s2, 3) > kTolerance) {
    defect << "its patch_k_m, max_normal_n or gravity_w_m_s2 is another";
  } else if (join_knot(before, part) < 0) {
    const plan_knot_t &end = before.knots.back(), &begin = part.knots.front();
    const double body = body_off(end, begin);
    defect << "it begins in no stance of the loaded plan";
    if (!(body <= kTolerance)) defect << "; its body begins " << body << " m or rad off that plan's end";
    for (int l = 0; l < kLimbs; ++l) {
      if (begin.limbs[l].phase != limb_knot_t::STANCE) defect << "; limb " << l << " begins in the air";
    }
  }
  return defect.str();
}

plan_t joined(const plan_t& before, const plan_t& part) {
  const int at = join_knot(before, part);
  plan_t whole = part;
  whole.cost = before.cost + part.cost;
  whole.holds = before.holds;
  const std::vector<std::int32_t> number = add_holds(whole, part);
  const double begin_s = before.knots[at].time_s;
  whole.knots.assign(before.knots.begin(), before.knots.begin() + at);
  for (int l = 0; l < kLimbs; ++l) {
    for (int k = at - 1; k >= 0 && whole.knots[k].limbs[l].phase == limb_knot_t::STANCE; --k)
      take_to(whole.knots[k].limbs[l], part.knots.front().limbs[l]);
  }
  for (plan_knot_t knot : part.knots) {
    knot.time_s += begin_s;
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
  tables->shared = shared_intervals(*tables, *tabulate(before));
  return tables;
}

int shared_intervals(const PreparedPlan& one, const PreparedPlan& other) noexcept {
  if (one.point_feet || other.point_feet || one.footholds || other.footholds ||
      one.swing.fingers_move != other.swing.fingers_move || one.swing.lift != other.swing.lift) {
    return 0;
  }
  const int most = std::min(one.intervals(), other.intervals());
  for (int k = 0; k <= most; ++k) {
    const bool here = std::abs(one.time_s[k] - other.time_s[k]) <= kTolerance &&
                      (one.body[k] - other.body[k]).cwiseAbs().maxCoeff() <= kTolerance;
    if (!here || !same_stance(one.limbs[k], other.limbs[k])) return std::max(k - 1, 0);
    // What acts from this knot on is another.
    if (one.time_s[k] != other.time_s[k] || one.body[k] != other.body[k] || !same_knot(one.limbs[k], other.limbs[k]))
      return k;
  }
  return most;
}

bool grips_elsewhere(const PreparedPlan& one, const PreparedPlan& other, int k, int limb) noexcept {
  return !one.limbs[k][limb].air && !same_place(one.limbs[k][limb], other.limbs[k][limb]);
}

}  // namespace crux
