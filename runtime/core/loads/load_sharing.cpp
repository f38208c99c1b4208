#include "core/loads/load_sharing.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <limits>
#include <piqp/piqp.hpp>

#include "core/robot/gravity.hpp"

namespace crux {
namespace {

constexpr int kPads = 2;
constexpr int kPlanes = 2;  // tangent planes a pad: at the balanced wrench and at the last answer
constexpr int kWrench = 6;
// Variables by which limits are exceeded [N]: one of all pads, one of all joints.
constexpr int kPadExcess = kLimbs * kWrench, kJointExcess = kPadExcess + 1, kVariables = kJointExcess + 1;
constexpr int kPadRows = kLimbs * kPads * kPlanes;
constexpr int kRows = kPadRows + kAllJoints;

constexpr double kLeastLoad = 1e-3;
constexpr double kNoMoment = 1e6;  // times dearer: a foot has none
// [N] of exceeding a limit by 1 N, far above what moving a force by 1 N costs. A pad beyond its cone slips; a joint at
// its limit gives way, and the other limbs take over.
constexpr double kPadPrice = 1e4, kJointPrice = 1e3;
constexpr double kArm_m = 0.05;  // weighs moments against forces, and how far torques are exceeded
constexpr double kNoLimit = 1e6;
constexpr double kLeastOnPad_N = 1.0;  // a cone is no sharper than where a pad bears that
constexpr double kTolerance = 1e-4;    // [N]
constexpr int kMaxIterations = 25;
constexpr double kStep = 0.05;   // towards what the planes say: they hold near where they touch
constexpr int kEvery = 2;        // cycles; the answer stands in between
constexpr double kFaded = 0.01;  // [N] of a limb's force, and of its moment over kArm_m: the rest is dropped
constexpr int kPatience = 10;    // answers in a row that the solver does not find, before the last one fades

using PadMap = Eigen::Matrix<double, 3, kWrench>;
using WrenchMatrix = Eigen::Matrix<double, kWrench, kWrench>;

/// What one pad bears along its face and, as a force, about its normal, with the most squeeze: z = map·(F, M) + offset,
/// |z| ≤ μ·(pressed·(F, M) + most) by (2).
struct PadLimit {
  PadMap map;
  Vector3 offset_N;
  Eigen::Matrix<double, 1, kWrench> pressed;
  double most_N;
};

PadLimit pad_limit(const Vector3& axis_W, int pad, const Contact& contact, double squeeze_N) {
  const PadForm form = pad_form(axis_W, pad, contact);
  const Vector3 u = form.normal_W.unitOrthogonal(), v = form.normal_W.cross(u);
  PadLimit limit;
  limit.map << u.transpose() * form.force, v.transpose() * form.force, form.twist;
  limit.offset_N = squeeze_N * Vector3(u.dot(form.by_squeeze), v.dot(form.by_squeeze), 0.0);
  limit.pressed = form.normal_W.transpose() * form.force;
  limit.most_N = squeeze_N * form.normal_W.dot(form.by_squeeze);
  return limit;
}

/// The wrench of `bearer` about its gripper's centre.
Wrench about_gripper(const Bearer& bearer, const Wrench& wrench_W) {
  if (!bearer.foot.stands) return wrench_W;
  return {wrench_W.force_N, wrench_W.moment_Nm + bearer.foot.to_foot_W_m.cross(wrench_W.force_N)};
}

/// Second derivative of |z| by (F, M) where z is `at_N`: what a tangent plane leaves out.
WrenchMatrix curvature(const PadMap& map, const Vector3& at_N) {
  const Vector3 normal = at_N.normalized();
  const Matrix3 across = Matrix3::Identity() - normal * normal.transpose();
  return map.transpose() * across * map / std::max(at_N.norm(), kLeastOnPad_N);
}

Vector6 stacked(const Wrench& wrench) {
  Vector6 vector;
  vector << wrench.force_N, wrench.moment_Nm;
  return vector;
}

JointVector joint_torque(const Capacity& capacity, const Wrench& wrench_W, const Matrix3& rotation_WB) {
  const Wrench wrench_B = {rotation_WB.transpose() * wrench_W.force_N, rotation_WB.transpose() * wrench_W.moment_Nm};
  return capacity.gravity_Nm + contact_torque(*capacity.limb, wrench_B);
}

bool exceeds(const Capacity& capacity, const Bearer& bearer, const Wrench& wrench_W, const Matrix3& rotation_WB,
             const ControlParameters& control) {
  if (bearer.load <= 0.0) return false;
  const JointVector torque_Nm = joint_torque(capacity, about_gripper(bearer, wrench_W), rotation_WB);
  const bool weak = (torque_Nm.cwiseAbs() - capacity.max_torque_Nm).maxCoeff() > 0.0;
  if (bearer.foot.stands) return weak;
  return weak || needed_grasp_force_N(wrench_W, bearer.finger_axis_W, capacity.contact, control) >
                     capacity.contact.max_normal_N;
}

}  // namespace

/// The solver's own form: least ½xᵀ·price·x + linear_priceᵀ·x under balance·x = 0, limits·x ≤ upper, excess ≥ 0. x: Δ
/// of each limb, then both excesses.
struct LoadSharing::Program {
  using Answer = Eigen::Matrix<double, kVariables, 1>;

  Eigen::Matrix<double, kVariables, kVariables> price = decltype(price)::Identity();
  Answer linear_price = kPadPrice * Answer::Unit(kPadExcess) + kJointPrice * Answer::Unit(kJointExcess);
  Eigen::Matrix<double, kRows, 1> multipliers = decltype(multipliers)::Zero();  ///< of the limits, at the last solution
  Eigen::Matrix<double, 6, kVariables> balance = decltype(balance)::Zero();
  Eigen::Matrix<double, kRows, kVariables> limits = decltype(limits)::Zero();
  Eigen::Matrix<double, kRows, 1> upper = decltype(upper)::Constant(kNoLimit);
  piqp::DenseSolver<double, piqp::dense::IdentityPreconditioner<double>> solver;

  Answer answer = Answer::Zero();
  int cycle = 0;
  int in_vain = 0;  ///< times in a row that the solver found no answer
  std::int64_t failures = 0;

  Program();
  Vector6 change(int limb) const { return answer.segment<kWrench>(limb * kWrench); }
  void weigh(int limb, const Bearer& bearer, const Vector3& com_W_m) noexcept;
  void limit_pads(int limb, const Bearer& bearer, const Wrench& balanced_W, const Contact& contact,
                  const ControlParameters& control) noexcept;
  void limit_foot(int limb, const Bearer& bearer, const Wrench& balanced_W) noexcept;
  void limit_joints(int limb, const Bearer& bearer, const Capacity& capacity, const Wrench& balanced_W,
                    const Matrix3& rotation_WB) noexcept;
  void solve() noexcept;
  /// The change goes on, towards none.
  void fade() noexcept { answer *= 1.0 - kStep; }
  bool faded() const noexcept;
  /// The change without net force or moment on the limbs that bear now, none on the others.
  void rebalance(const PerLimb<Bearer>& bearers, const Vector3& com_W_m, double twist_length_m) noexcept;
};

LoadSharing::Program::Program() {
  Answer least = Answer::Constant(-std::numeric_limits<double>::infinity());
  least[kPadExcess] = least[kJointExcess] = 0.0;
  auto& settings = solver.settings();
  settings.max_iter = kMaxIterations;
  settings.eps_abs = settings.eps_rel = kTolerance;
  settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = kTolerance;
  const Vector6 none = Vector6::Zero();
  solver.setup(price, linear_price, balance, none, limits, piqp::nullopt, upper, least, piqp::nullopt);
}

void LoadSharing::Program::weigh(int limb, const Bearer& bearer, const Vector3& com_W_m) noexcept {
  const int at = limb * kWrench;
  const double weight = 1.0 / std::max(bearer.load, kLeastLoad);
  price.block<kWrench, kWrench>(at, at).setZero();
  linear_price.segment<kWrench>(at).setZero();
  price.diagonal().segment<3>(at).setConstant(weight);
  price.diagonal().segment<3>(at + 3).setConstant(weight / (kArm_m * kArm_m));
  balance.middleCols<kWrench>(at).setZero();
  if (bearer.load <= 0.0) return;
  balance.block<3, 3>(0, at).setIdentity();
  balance.block<3, 3>(3, at) = skew(bearer.position_W_m - com_W_m);
  balance.block<3, 3>(3, at + 3).setIdentity();
  if (!bearer.foot.stands) return;
  price.diagonal().segment<3>(at + 3) *= kNoMoment;
  balance.block<3, 3>(3, at + 3).setZero();
}

/// Friction's cone by its tangent planes, and the normal force between none and the most.
void LoadSharing::Program::limit_foot(int limb, const Bearer& bearer, const Wrench& balanced_W) noexcept {
  const FootCone& foot = bearer.foot;
  const int first = limb * kPads * kPlanes, at = limb * kWrench;
  limits.middleRows<kPads * kPlanes>(first).setZero();
  upper.segment<kPads * kPlanes>(first).setConstant(kNoLimit);
  if (bearer.load <= 0.0) return;
  const Vector3& normal = foot.normal_W;
  const double pressed_N = normal.dot(balanced_W.force_N);
  const std::array<Vector3, kPlanes> at_N = {balanced_W.force_N, balanced_W.force_N + change(limb).head<3>()};
  for (int plane = 0; plane < kPlanes; ++plane) {
    const Vector3 along = (at_N[plane] - normal.dot(at_N[plane]) * normal).normalized() / foot.friction;
    limits.row(first + plane).segment<3>(at) = (along - normal).transpose();
    upper[first + plane] = pressed_N - along.dot(balanced_W.force_N);
  }
  const int pulls = first + kPlanes, presses = pulls + 1;
  limits.row(pulls).segment<3>(at) = -normal.transpose();
  upper[pulls] = pressed_N;
  limits.row(presses).segment<3>(at) = normal.transpose();
  upper[presses] = foot.max_normal_N - pressed_N;
  limits.block<kPads * kPlanes, 1>(first, kPadExcess).setConstant(-1.0);
}

void LoadSharing::Program::limit_pads(int limb, const Bearer& bearer, const Wrench& balanced_W, const Contact& contact,
                                      const ControlParameters& control) noexcept {
  const double slope = control.grasp_force_factor / contact.friction;
  const int at = limb * kWrench;
  for (int pad = 0; pad < kPads; ++pad) {
    const PadLimit pad_limits =
        pad_limit(bearer.finger_axis_W, pad, contact, contact.max_normal_N - control.grasp_force_reserve_N);
    const PadMap& map = pad_limits.map;
    const Vector3 balanced_N = map * stacked(balanced_W) + pad_limits.offset_N;
    const std::array<Vector3, kPlanes> at_N = {balanced_N, balanced_N + map * change(limb)};
    const int first = (limb * kPads + pad) * kPlanes;
    const double multiplier = multipliers.segment<kPlanes>(first).sum();
    if (bearer.load > 0.0 && multiplier > 0.0) {
      const WrenchMatrix bent = multiplier * slope * curvature(map, at_N.back());
      price.block<kWrench, kWrench>(at, at) += bent;
      linear_price.segment<kWrench>(at) -= bent * change(limb);
    }
    for (int plane = 0; plane < kPlanes; ++plane) {
      const int row = first + plane;
      limits.row(row).setZero();
      upper[row] = kNoLimit;
      if (bearer.load <= 0.0) continue;
      const Vector3 normal = at_N[plane].normalized();
      limits.row(row).segment<kWrench>(at) = slope * normal.transpose() * map;
      limits.row(row).segment<kWrench>(at) -= pad_limits.pressed;
      limits(row, kPadExcess) = -1.0;
      upper[row] = pad_limits.most_N - slope * normal.dot(balanced_N) + pad_limits.pressed * stacked(balanced_W);
    }
  }
}

void LoadSharing::Program::limit_joints(int limb, const Bearer& bearer, const Capacity& capacity,
                                        const Wrench& balanced_W, const Matrix3& rotation_WB) noexcept {
  const int row = kPadRows + limb * kJoints, at = limb * kWrench;
  limits.middleRows<kJoints>(row).setZero();
  upper.segment<kJoints>(row).setConstant(kNoLimit);
  if (bearer.load <= 0.0) return;
  Eigen::Matrix<double, kJoints, kWrench> torque_of;
  torque_of << capacity.limb->jacobian_B.topRows<3>().transpose() * -rotation_WB.transpose(),
      capacity.limb->jacobian_B.bottomRows<3>().transpose() * -rotation_WB.transpose();
  if (bearer.foot.stands) torque_of.leftCols<3>() += torque_of.rightCols<3>() * skew(bearer.foot.to_foot_W_m);
  const JointVector balanced_Nm = joint_torque(capacity, about_gripper(bearer, balanced_W), rotation_WB);
  const JointVector last_Nm = balanced_Nm + torque_of * change(limb);
  for (int j = 0; j < kJoints; ++j) {
    const double side = last_Nm[j] < 0.0 ? -1.0 : 1.0;
    limits.row(row + j).segment<kWrench>(at) = side / kArm_m * torque_of.row(j);
    limits(row + j, kJointExcess) = -1.0;
    upper[row + j] = (capacity.max_torque_Nm[j] - side * balanced_Nm[j]) / kArm_m;
  }
}

void LoadSharing::Program::solve() noexcept {
  bool solved = limits.allFinite() && upper.allFinite();  // of others the solver would tell on standard error
  if (solved) {
    solver.update(price, linear_price, balance, piqp::nullopt, limits, piqp::nullopt, upper);
    solved = solver.solve() == piqp::PIQP_SOLVED && solver.result().x.allFinite();
  }
  if (solved) {
    answer += kStep * (solver.result().x - answer);
    multipliers = solver.result().z_u;
  }
  failures += solved ? 0 : 1;
  in_vain = solved ? 0 : in_vain + 1;
  if (in_vain > kPatience) fade();
}

bool LoadSharing::Program::faded() const noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    if (change(l).head<3>().norm() > kFaded || change(l).tail<3>().norm() > kFaded * kArm_m) return false;
  }
  return true;
}

void LoadSharing::Program::rebalance(const PerLimb<Bearer>& bearers, const Vector3& com_W_m,
                                     double twist_length_m) noexcept {
  PerLimb<Bearer> changes = bearers;
  for (int l = 0; l < kLimbs; ++l) changes[l].planned_W = {change(l).head<3>(), change(l).tail<3>()};
  const PerLimb<Wrench> balanced = balanced_wrenches(changes, com_W_m, Vector3::Zero(), twist_length_m);
  for (int l = 0; l < kLimbs; ++l) {
    const bool bears = bearers[l].load > 0.0;
    answer.segment<kWrench>(l * kWrench) = bears ? stacked(balanced[l]) : Vector6(Vector6::Zero());
  }
}

LoadSharing::LoadSharing() : program_(std::make_unique<Program>()) {}
LoadSharing::~LoadSharing() = default;

std::int64_t LoadSharing::failures() const noexcept { return program_->failures; }

PerLimb<Wrench> LoadSharing::within_limits(const PerLimb<Wrench>& balanced, const PerLimb<Bearer>& bearers,
                                           const PerLimb<Capacity>& capacities, const Vector3& com_W_m,
                                           const Matrix3& rotation_WB, const ControlParameters& control) noexcept {
  Program& p = *program_;
  bool within = true;
  for (int l = 0; l < kLimbs; ++l)
    within = within && !exceeds(capacities[l], bearers[l], balanced[l], rotation_WB, control);
  if (within) p.fade();
  if (within && p.faded()) {
    p.answer.setZero();
    p.multipliers.setZero();
    p.cycle = 0;
    return balanced;
  }
  const bool solves = !within && p.cycle++ % kEvery == 0;
  for (int l = 0; l < kLimbs && solves; ++l) {
    p.weigh(l, bearers[l], com_W_m);
    if (bearers[l].foot.stands) {
      p.limit_foot(l, bearers[l], balanced[l]);
    } else {
      p.limit_pads(l, bearers[l], balanced[l], capacities[l].contact, control);
    }
    p.limit_joints(l, bearers[l], capacities[l], balanced[l], rotation_WB);
  }
  if (solves) p.solve();
  p.rebalance(bearers, com_W_m, control.twist_length_m);
  PerLimb<Wrench> shared = balanced;
  for (int l = 0; l < kLimbs; ++l) {
    if (bearers[l].load <= 0.0) continue;
    shared[l].force_N += p.change(l).head<3>();
    shared[l].moment_Nm += p.change(l).tail<3>();
  }
  return shared;
}

}  // namespace crux
