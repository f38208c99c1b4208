#include "core/plan/plan_validation.hpp"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <sstream>
#include <vector>

#include "core/plan/reference_player.hpp"
#include "core/robot/hash.hpp"
#include "core/robot/inverse_kinematics.hpp"

namespace crux {
namespace {

using crux_msgs::hold_t;
using crux_msgs::limb_knot_t;
using crux_msgs::plan_knot_t;
using crux_msgs::plan_t;

constexpr double kTimeTolerance_s = 1e-6;
constexpr double kMinStep_s = 1e-3, kMaxStep_s = 3600.0;  // between knots with times of their own
constexpr double kPoseTolerance = 1e-6;                   // of a gripper that must not have moved [m, rad]
constexpr double kForceTolerance_N = 1e-3;
constexpr double kMomentTolerance_Nm = 1e-4;  // of a foot, which bears none
constexpr double kRightAngle_rad = std::numbers::pi / 2.0;
constexpr double kNormalTolerance = 1e-6;  // between unit vectors
// What the runtime's own loop could follow without anyone noticing.
constexpr double kReachTolerance_m = 1e-3;
constexpr double kReachTolerance_rad = 1e-2;
constexpr int kSamplesPerInterval = 20;
constexpr int kStartSeeds = 64;
constexpr int kStartIterations = 100;
constexpr int kFollowIterations = 20;

/// Sentences such as "knot 3, limb RF: finger_separation_m is 0.2; …".
class Sentence {
 public:
  template <class T>
  Sentence& operator<<(const T& part) {
    text_ << part;
    return *this;
  }
  operator std::string() const { return text_.str(); }  // NOLINT: converting on purpose

 private:
  std::ostringstream text_;
};

std::string place(const RobotDescription& robot, std::size_t knot, int limb) {
  return Sentence() << "knot " << knot << ", limb " << robot.limbs[limb].name << ": ";
}

bool all_finite(const double* values, int n) {
  for (int i = 0; i < n; ++i) {
    if (!std::isfinite(values[i])) return false;
  }
  return true;
}

std::string identity_defect(const RobotDescription& robot, const plan_t& plan) {
  if (plan.format < plan_t::FORMAT || plan.format > plan_t::FORMAT_FEET) {
    return Sentence() << "plan format is " << plan.format << "; this runtime reads formats " << plan_t::FORMAT << " to "
                      << plan_t::FORMAT_FEET;
  }
  if (plan.robot_name != robot.name) {
    return Sentence() << "the plan is for robot '" << plan.robot_name << "', this is '" << robot.name << "'";
  }
  if (plan.robot_sha256 != robot.sha256) {
    return Sentence() << "the plan was made for another description of robot '" << robot.name
                      << "' or by an older crux (robot_sha256 " << plan.robot_sha256.substr(0, 12) << "..., here "
                      << robot.sha256.substr(0, 12) << "...): plan again";
  }
  plan_t unnamed = plan;
  unnamed.plan_id.clear();
  std::string bytes(static_cast<std::size_t>(unnamed.getEncodedSize()), '\0');
  unnamed.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  if (sha256_hex(bytes) != plan.plan_id) return "plan_id is not the hash of the plan: it was changed or damaged";
  return {};
}

std::string size_defect(const plan_t& plan) {
  if (plan.n_knots < 2 || plan.knots.size() != static_cast<std::size_t>(plan.n_knots)) {
    return Sentence() << "the plan has " << plan.n_knots << " knots; it needs 2 at least";
  }
  if (plan.n_holds < 0 || plan.holds.size() != static_cast<std::size_t>(plan.n_holds)) {
    return Sentence() << "n_holds is " << plan.n_holds << " and there are " << plan.holds.size() << " holds";
  }
  if (!std::isfinite(plan.dt_s) || plan.dt_s <= 0.0)
    return Sentence() << "dt_s is " << plan.dt_s << "; it must be above 0";
  if (!all_finite(plan.gravity_w_m_s2, 3)) return "gravity_w_m_s2 is not finite";
  if (is_walk(plan) ? plan.patch_k_m != 0.0 : !std::isfinite(plan.patch_k_m) || plan.patch_k_m <= 0.0) {
    return Sentence() << "patch_k_m is " << plan.patch_k_m
                      << "; it must be above 0 for grippers on holds, 0 for feet on the wall itself";
  }
  if (!std::isfinite(plan.max_normal_n) || plan.max_normal_n <= 0.0) {
    return Sentence() << "max_normal_n is " << plan.max_normal_n << "; it must be above 0";
  }
  return {};
}

std::string knot_defect(const plan_t& plan, std::size_t k) {
  const plan_knot_t& knot = plan.knots[k];
  if (plan.format >= plan_t::FORMAT_OWN_TIMES) {
    const double before_s = k > 0 ? plan.knots[k - 1].time_s : 0.0, step_s = knot.time_s - before_s;
    if (!(k > 0 ? step_s >= kMinStep_s && step_s <= kMaxStep_s : knot.time_s == 0.0)) {
      return Sentence() << "knot " << k << ": time_s is " << knot.time_s
                        << "; the first knot stands at 0 s, the others " << kMinStep_s << " to " << kMaxStep_s
                        << " s after the one before, at " << before_s << " s";
    }
  } else if (!(std::abs(knot.time_s - static_cast<double>(k) * plan.dt_s) <= kTimeTolerance_s)) {
    return Sentence() << "knot " << k << ": time_s is " << knot.time_s << "; knots stand every dt_s = " << plan.dt_s
                      << " s";
  }
  if (!all_finite(knot.body_position_w_m, 3) || !all_finite(knot.body_rpy_rad, 3)) {
    return Sentence() << "knot " << k << ": the body pose is not finite";
  }
  return {};
}

/// Normal force [N] with which a finger presses on its face: finger 1 sits at +e and is pushed back along +e.
double finger_normal_N(const limb_knot_t& limb, int finger) {
  const double sign = finger == 0 ? 1.0 : -1.0;
  const Eigen::Vector2d tilt_rad(limb.gripper_tilt_w_rad);
  return sign *
         Vector3(limb.finger_force_w_n + 3 * finger).dot(gripper_rotation(limb.gripper_yaw_w_rad, tilt_rad).col(0));
}

/// A foot stands on the wall and presses on it.
std::string foot_defect(const RobotDescription& robot, const plan_t& plan, std::size_t k, int l) {
  const limb_knot_t& limb = plan.knots[k].limbs[l];
  const std::string where = place(robot, k, l);
  if (limb.hold != -1) return Sentence() << where << "hold is " << limb.hold << "; a foot on the wall has -1";
  if (!(std::abs(limb.gripper_position_w_m[2]) <= kPoseTolerance)) {
    return Sentence() << where << "the foot stands " << limb.gripper_position_w_m[2] << " m off the wall";
  }
  if (limb.gripper_tilt_w_rad[0] != 0.0 || limb.gripper_tilt_w_rad[1] != 0.0)
    return Sentence() << where << "the foot is tilted; possible is upright";
  const double normal_N = limb.finger_force_w_n[2] + limb.finger_force_w_n[5];
  if (normal_N < -kForceTolerance_N || normal_N > plan.max_normal_n + kForceTolerance_N) {
    return Sentence() << where << "the foot presses with " << normal_N << " N; possible is 0.." << plan.max_normal_n
                      << " N";
  }
  return {};
}

/// What a foot on a foothold with normal `normal_W` bears: a push within friction, half by each finger, at its point.
std::string push_defect(const std::string& where, const plan_t& plan, const limb_knot_t& limb,
                        const Vector3& normal_W) {
  const Vector3 first_N(limb.finger_force_w_n), second_N(limb.finger_force_w_n + 3), force_N = first_N + second_N;
  const double normal_N = force_N.dot(normal_W), along_N = (force_N - normal_N * normal_W).norm();
  if (!(normal_N >= -kForceTolerance_N && normal_N <= plan.max_normal_n + kForceTolerance_N)) {
    return Sentence() << where << "the foot presses with " << normal_N << " N; possible is 0.." << plan.max_normal_n
                      << " N";
  }
  if (!(along_N <= limb.friction * normal_N + kForceTolerance_N)) {
    return Sentence() << where << "the foot bears " << along_N << " N along its surface; friction holds "
                      << limb.friction * normal_N << " N";
  }
  if (!((first_N - second_N).norm() <= kForceTolerance_N))
    return Sentence() << where << "the fingers of a foot bear half of its force each";
  for (const double moment_Nm : limb.finger_moment_w_nm) {
    if (!(std::abs(moment_Nm) <= kMomentTolerance_Nm))
      return Sentence() << where << "the foot bears a moment of " << moment_Nm << " Nm; possible is none";
  }
  return {};
}

/// A foot stands at a foothold, along its normal.
std::string foothold_defect(const std::string& where, const plan_t& plan, const limb_knot_t& limb) {
  if (limb.hold >= plan.n_holds || plan.holds[limb.hold].graspable != hold_t::FOOTHOLD)
    return Sentence() << where << "the foot stands on hold " << limb.hold << ", which is no foothold";
  const hold_t& foothold = plan.holds[limb.hold];
  const Vector3 place_W_m(foothold.position_w_m), off_m = Vector3(limb.gripper_position_w_m) - place_W_m;
  if (!(off_m.norm() <= kPoseTolerance))
    return Sentence() << where << "the foot stands " << off_m.norm() << " m from its foothold";
  if (!(foothold.size_m[0] > 0.0 && std::isfinite(foothold.size_m[0])))
    return Sentence() << where << "the foothold is " << foothold.size_m[0] << " m wide; it must be above 0";
  const Vector3 normal_W = rotation_from_rpy({foothold.tilt_rad[0], foothold.tilt_rad[1], foothold.yaw_rad}).col(2);
  const Vector3 up_W = gripper_rotation(limb.gripper_yaw_w_rad, Eigen::Vector2d(limb.gripper_tilt_w_rad)).col(2);
  if (!((up_W - normal_W).norm() <= kNormalTolerance))
    return Sentence() << where << "the foot is tilted by " << (up_W - normal_W).norm() << " off its surface's normal";
  return push_defect(where, plan, limb, normal_W);
}

std::string grasp_defect(const RobotDescription& robot, const plan_t& plan, std::size_t k, int l) {
  const limb_knot_t& limb = plan.knots[k].limbs[l];
  const std::string where = place(robot, k, l);
  if (limb.hold < 0 || limb.hold >= plan.n_holds) {
    return Sentence() << where << "hold is " << limb.hold << "; the plan has holds 0.." << plan.n_holds - 1;
  }
  if (!all_finite(plan.holds[limb.hold].tilt_rad, 2)) {
    return Sentence() << where << "the roll or pitch of hold " << limb.hold << " is not finite";
  }
  for (const double lean_rad : plan.holds[limb.hold].lean_rad) {
    if (!(lean_rad >= 0.0 && lean_rad < kRightAngle_rad)) {
      return Sentence() << where << "a face of hold " << limb.hold << " leans by " << lean_rad
                        << " rad; possible is 0 to less than a right angle";
    }
  }
  if (limb.finger1_face < 0 || limb.finger1_face >= limb_knot_t::FACE_WALL ||
      plan.holds[limb.hold].graspable == hold_t::FOOTHOLD) {
    return Sentence() << where << "finger1_face is " << static_cast<int>(limb.finger1_face) << " on hold " << limb.hold
                      << "; a hold is gripped by its side faces, and footholds belong to plans of format "
                      << plan_t::FORMAT_FEET;
  }
  const double max_normal_N = std::min(plan.max_normal_n, robot.gripper.max_finger_force_N);
  for (int finger = 0; finger < 2; ++finger) {
    const double normal_N = finger_normal_N(limb, finger);
    if (normal_N < -kForceTolerance_N || normal_N > max_normal_N + kForceTolerance_N) {
      return Sentence() << where << "finger " << finger + 1 << " presses with " << normal_N << " N; possible is 0.."
                        << max_normal_N << " N";
    }
  }
  return {};
}

std::string stance_defect(const RobotDescription& robot, const plan_t& plan, bool walk, std::size_t k, int l) {
  const limb_knot_t& limb = plan.knots[k].limbs[l];
  const std::string where = place(robot, k, l);
  const bool foot = plan.format == plan_t::FORMAT_FEET && limb.finger1_face == limb_knot_t::FACE_WALL && limb.hold >= 0;
  std::string defect = walk   ? foot_defect(robot, plan, k, l)
                       : foot ? foothold_defect(where, plan, limb)
                              : grasp_defect(robot, plan, k, l);
  if (!defect.empty()) return defect;
  if (!(limb.friction > 0.0))
    return Sentence() << where << "friction is " << limb.friction << "; a limb in stance needs more than 0";
  const limb_knot_t& before = plan.knots[k == 0 ? 0 : k - 1].limbs[l];
  if (before.phase == limb_knot_t::STANCE) {
    double moved = std::abs(limb.gripper_yaw_w_rad - before.gripper_yaw_w_rad);
    for (int i = 0; i < 2; ++i) {
      moved = std::max(moved, std::abs(limb.gripper_tilt_w_rad[i] - before.gripper_tilt_w_rad[i]));
    }
    for (int i = 0; i < 3; ++i) {
      moved = std::max(moved, std::abs(limb.gripper_position_w_m[i] - before.gripper_position_w_m[i]));
    }
    const bool shifts = std::abs(limb.finger_separation_m - before.finger_separation_m) > kPoseTolerance;
    if (moved > kPoseTolerance || limb.hold != before.hold || (foot && shifts)) {
      return Sentence() << where << "the gripper moves in stance; it must release its hold first";
    }
  }
  return {};
}

std::string limb_defect(const RobotDescription& robot, const plan_t& plan, bool walk, std::size_t k, int l) {
  const limb_knot_t& limb = plan.knots[k].limbs[l];
  const std::string where = place(robot, k, l);
  if (limb.phase != limb_knot_t::STANCE && limb.phase != limb_knot_t::AIR) {
    return Sentence() << where << "phase is " << static_cast<int>(limb.phase) << "; it is 0 (stance) or 1 (air)";
  }
  if (!all_finite(limb.gripper_position_w_m, 3) || !all_finite(&limb.gripper_yaw_w_rad, 1) ||
      !all_finite(limb.gripper_tilt_w_rad, 2) || !all_finite(&limb.finger_separation_m, 1) ||
      !all_finite(limb.finger_force_w_n, 6) || !all_finite(limb.finger_moment_w_nm, 6) ||
      !all_finite(&limb.friction, 1)) {
    return Sentence() << where << "a number is not finite";
  }
  const double opening_m = 0.5 * limb.finger_separation_m;
  if (opening_m < robot.gripper.opening_m.low || opening_m > robot.gripper.opening_m.high) {
    return Sentence() << where << "finger_separation_m is " << limb.finger_separation_m << "; the gripper has "
                      << 2.0 * robot.gripper.opening_m.low << ".." << 2.0 * robot.gripper.opening_m.high << " m";
  }
  for (int i = 0; i < 3; ++i) {
    const double force_N = limb.finger_force_w_n[i] + limb.finger_force_w_n[3 + i];
    if (std::abs(force_N) > robot.force_torque.range_N) {
      return Sentence() << where << "the gripper bears " << force_N << " N; the sensor reads "
                        << robot.force_torque.range_N << " N";
    }
  }
  if (limb.phase == limb_knot_t::STANCE) return stance_defect(robot, plan, walk, k, l);
  if (k == 0 && (plan.format == plan_t::FORMAT || walk))
    return Sentence() << where << "a walk and a plan of format " << plan_t::FORMAT << " begin with all limbs in stance";
  if (k + 1 == plan.knots.size()) return Sentence() << where << "all limbs must grip at the end of a plan";
  const bool alone = (k == 0 || plan.knots[k - 1].limbs[l].phase == limb_knot_t::STANCE) &&
                     plan.knots[k + 1].limbs[l].phase == limb_knot_t::STANCE;
  if (alone) return Sentence() << where << "a swing needs two knots in the air at least";
  for (int i = 0; i < 6; ++i) {
    if (std::abs(limb.finger_force_w_n[i]) > kForceTolerance_N)
      return Sentence() << where << "bears a force in the air";
  }
  return {};
}

/// Quasi-random joint angles inside the limits (additive recurrence with the generalised golden ratio in 6 dimensions).
JointVector seed_angles(const LimbDescription& limb, int index) {
  constexpr double kGolden6 = 1.1127756842787055;  // root of x^7 = x + 1
  JointVector q = JointVector::Zero();
  double step = 1.0;
  for (int j = 0; j < limb.turns(); ++j) {
    step /= kGolden6;
    const double share = std::fmod(0.5 + step * index, 1.0);
    q[j] = limb.joints[j].lower_rad + share * (limb.joints[j].upper_rad - limb.joints[j].lower_rad);
  }
  return q;
}

/// Turns that the limb does not make are part of what it misses.
bool reached(const IkResult& result, const LimbDescription& limb) {
  if (!(result.q_rad.tail(kJoints - limb.driven).norm() <= kReachTolerance_rad)) return false;
  return result.position_error_m <= kReachTolerance_m && result.rotation_error_rad <= kReachTolerance_rad;
}

Pose gripper_target_B(const PlanReference& reference, int l) {
  const LimbReference& limb = reference.limbs[l];
  const Pose gripper_W = {limb.gripper_rotation_W(), limb.gripper_position_W_m};
  return reference.body_W.inverse() * gripper_W;
}

std::string limb_reach_defect(const RobotDescription& robot, const PreparedPlan& plan, int first, int l) {
  LimbKinematics kinematics(robot.limbs[l]);
  InverseKinematics inverse(robot.limbs[l], kinematics);
  const Pose start = gripper_target_B(play(plan, {first, 0.0}), l);
  IkResult result;
  for (int seed = 0; seed < kStartSeeds; ++seed) {
    result = inverse.solve(start, seed_angles(robot.limbs[l], seed), kStartIterations);
    if (reached(result, robot.limbs[l])) break;
  }
  for (int k = first; k < plan.intervals(); ++k) {
    for (int sample = 0; sample <= kSamplesPerInterval; ++sample) {
      const PlanTime at{k, plan.step_s[k] * sample / kSamplesPerInterval};
      result = inverse.solve(gripper_target_B(play(plan, at), l), result.q_rad, kFollowIterations);
      if (!reached(result, robot.limbs[l])) {
        return Sentence() << place(robot, static_cast<std::size_t>(k), l) << "the gripper is out of reach at "
                          << at.seconds(plan) << " s: it comes within " << 1e3 * result.position_error_m << " mm and "
                          << result.rotation_error_rad + result.q_rad.tail(kJoints - robot.limbs[l].driven).norm()
                          << " rad";
      }
    }
  }
  return {};
}

}  // namespace

std::string plan_message_defect(const RobotDescription& robot, const plan_t& plan) {
  if (std::string defect = identity_defect(robot, plan); !defect.empty()) return defect;
  if (std::string defect = size_defect(plan); !defect.empty()) return defect;
  const bool walk = is_walk(plan);
  if (walk && plan.format >= plan_t::FORMAT_OWN_TIMES) {
    return Sentence() << "plan format is " << plan.format << "; the knots of a walk stand every dt_s";
  }
  for (std::size_t k = 0; k < plan.knots.size(); ++k) {
    if (std::string defect = knot_defect(plan, k); !defect.empty()) return defect;
    for (int l = 0; l < kLimbs; ++l) {
      if (std::string defect = limb_defect(robot, plan, walk, k, l); !defect.empty()) return defect;
    }
  }
  return {};
}

std::string plan_reach_defect(const RobotDescription& robot, const PreparedPlan& plan, int first) {
  for (int l = 0; l < kLimbs; ++l) {
    if (std::string defect = limb_reach_defect(robot, plan, first, l); !defect.empty()) return defect;
  }
  return {};
}

}  // namespace crux
