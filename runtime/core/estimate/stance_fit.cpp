#include "core/estimate/stance_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace crux {
namespace {

constexpr int kLeastHolds = 3;  // for one of them to be told from the others
constexpr double kRelativeDamping = 1e-9;
constexpr double kAlone = 0.5;  // the others are off each other by less than this share of what the odd limb moved
constexpr double kPlay = 0.5;
constexpr double kDoubts = 2.0;  // deviations from where the others have it
constexpr double kArm_m = 0.25;  // of a joint to its gripper, about
constexpr int kSweeps = 30;      // over the joints, for their play
constexpr int kNever = std::numeric_limits<int>::max();

/// Inverse of a symmetric, positive definite matrix, by blocks: those of 3 x 3 are closed forms.
Matrix6 inverse(const Matrix6& matrix) noexcept {
  const Matrix3 side = matrix.topRightCorner<3, 3>();
  const Matrix3 first = matrix.topLeftCorner<3, 3>().inverse();
  const Matrix3 across = first * side;
  const Matrix3 second = (matrix.bottomRightCorner<3, 3>() - side.transpose() * across).inverse();
  const Matrix3 corner = across * second;
  Matrix6 inverse;
  inverse << first + corner * across.transpose(), -corner, -corner.transpose(), second;
  return inverse;
}

}  // namespace

/// What a limb's word is worth (inverse covariance), axes of S: joints that were idle within `cycles` may have gone
/// through as much play as was seen lately.
Matrix6 StanceFit::information(const Standing& limb, int cycles) const noexcept {
  Vector6 deviation;
  deviation << Vector3::Constant(parameters_.shift_sigma_m), Vector3::Constant(parameters_.turn_sigma_rad);
  const double play_rad = std::min(play_m_ / kArm_m, parameters_.most_play_rad / 2.0);
  Matrix6 covariance = deviation.cwiseAbs2().asDiagonal();
  bool played = false;
  for (int j = 0; j < kJoints; ++j) {
    if (limb.idle_cycles_ago[j] >= cycles) continue;
    played = true;
    Row moved;
    moved << limb.rotation_GS.transpose() * limb.joints_G.col(j).head<3>(),
        limb.rotation_GS.transpose() * limb.joints_G.col(j).tail<3>();
    covariance += play_rad * play_rad * moved * moved.transpose();
  }
  if (!played) return covariance.diagonal().cwiseInverse().asDiagonal();
  return inverse(covariance);
}

/// What the limb says of the body, and of its joints.
void StanceFit::look(Standing& limb, const FittedLimb& seen) noexcept {
  const Pose gripper_S = body_S_ * seen.state->gripper_B;
  limb.rotation_GS = gripper_S.rotation.transpose();
  limb.map.topRightCorner<3, 3>() = -skew(gripper_S.position_m - body_S_.position_m);
  const Matrix3 rotation_GB = seen.state->gripper_B.rotation.transpose();
  limb.joints_G << rotation_GB * seen.state->jacobian_B.topRows<3>(),
      rotation_GB * seen.state->jacobian_B.bottomRows<3>();
  for (int j = 0; j < kJoints; ++j) {
    const bool idle =
        std::abs(seen.torque_Nm[j]) < parameters_.idle_torque_Nm || seen.torque_Nm[j] * limb.torque_Nm[j] < 0.0;
    const bool there = !limb.joints_G.col(j).isZero(0.0);  // a slot without a joint has no play
    limb.idle_cycles_ago[j] = !there ? kNever : idle ? 0 : limb.idle_cycles_ago[j] + 1;
  }
  limb.torque_Nm = seen.torque_Nm;
}

/// Moves the body to where the limbs that held before fit best; limbs that are new are anchored there. False: none
/// held.
bool StanceFit::lay_body(const PerLimb<FittedLimb>& limbs) noexcept {
  bool changed = false, any = false;
  PerLimb<Row> last;
  Matrix6 normal = Matrix6::Zero();
  Vector6 gradient = Vector6::Zero();
  for (int l = 0; l < kLimbs; ++l) {
    Standing& limb = limbs_[l];
    changed = changed || limb.holds != limbs[l].holds;
    last[l] = limb.off;
    if (!limb.holds || !limbs[l].holds) continue;
    any = true;
    look(limb, limbs[l]);
    const Pose gripper_S = body_S_ * limbs[l].state->gripper_B;
    limb.off << gripper_S.position_m - limb.anchor_S.position_m,
        rotation_log(gripper_S.rotation * limb.anchor_S.rotation.transpose());
    const Matrix6 worth = information(limb, 0);
    normal += limb.map.transpose() * worth * limb.map;
    gradient += limb.map.transpose() * worth * limb.off;
  }
  Vector6 step = Vector6::Zero();
  if (any) step = -normal.ldlt().solve(gradient);
  body_S_.position_m += step.head<3>();
  body_S_.rotation = orthonormalised(rotation_exp(step.tail<3>()) * body_S_.rotation);
  for (int l = 0; l < kLimbs; ++l) {
    Standing& limb = limbs_[l];
    if (limbs[l].holds && !limb.holds) {
      limb = {};
      limb.anchor_S = body_S_ * limbs[l].state->gripper_B;
      limb.torque_Nm = limbs[l].torque_Nm;
      look(limb, limbs[l]);
    } else if (limb.holds) {
      limb.off += limb.map * step;
      // Another set of limbs lays the body elsewhere: no limb has moved by it.
      if (!changed) limb.path += limb.off - last[l];
      ++limb.cycles;
    }
    limb.holds = limbs[l].holds;
    any = any || limb.holds;
  }
  now_ = (now_ + 1) % kPast;
  for (Standing& limb : limbs_) limb.past[now_] = limb.path;
  return any;
}

StanceFit::Word StanceFit::word(const Standing& limb, const Row& off, const Matrix6& information) const noexcept {
  const Matrix6 weight = limb.map.transpose() * information;
  return {true, off, weight * limb.map, weight * off, off.dot(information * off)};
}

StanceFit::Fit StanceFit::fit_without(int limb, const PerLimb<Word>& words) const noexcept {
  Matrix6 normal = Matrix6::Zero();
  Vector6 gradient = Vector6::Zero();
  double squares = 0.0;
  for (int l = 0; l < kLimbs; ++l) {
    if (l == limb || !words[l].counts) continue;
    normal += words[l].normal;
    gradient += words[l].gradient;
    squares += words[l].squares;
  }
  const Matrix6 covariance = inverse(normal + kRelativeDamping * normal.trace() * Matrix6::Identity());
  const Vector6 body = -covariance * gradient;
  const Standing& own = limbs_[limb];
  const Eigen::Matrix<double, 2, 6> along = (own.rotation_GS * own.map.topRows<3>()).bottomRows<2>();
  const Row on = own.rotation_GS.row(0) * own.map.bottomRows<3>();
  return {words[limb].off + own.map * body, std::max(squares + body.dot(2.0 * gradient + normal * body), 0.0),
          std::sqrt((along * covariance * along.transpose()).trace()), std::sqrt(on.dot(covariance * on))};
}

Vector3 StanceFit::on_faces(const Misfit& misfit) const noexcept {
  return {misfit.shift_G_m.y(), misfit.shift_G_m.z(), pad_radius_m_ * misfit.turn_G_rad.x()};
}

double StanceFit::play_of_rim_m() const noexcept { return play_m_ * pad_radius_m_ / kArm_m; }

Misfit StanceFit::in_gripper(const Standing& limb, const Row& off) const noexcept {
  return {limb.rotation_GS * off.head<3>(), limb.rotation_GS * off.tail<3>()};
}

/// Takes off what joints that were idle within `cycles` explain by their play.
Misfit StanceFit::beyond_play(const Standing& limb, const Misfit& off, int cycles) const noexcept {
  LimbJacobian joints = LimbJacobian::Zero();
  for (int j = 0; j < kJoints; ++j) {
    if (limb.idle_cycles_ago[j] < cycles) joints.col(j) = limb.joints_G.col(j);
  }
  Row row;
  row << off.shift_G_m, off.turn_G_rad;
  Vector6 weight;
  weight << Vector3::Constant(1.0 / (parameters_.shift_sigma_m * parameters_.shift_sigma_m)),
      Vector3::Constant(1.0 / (parameters_.turn_sigma_rad * parameters_.turn_sigma_rad));
  // Least squares within what play there can be, joint by joint until it stands.
  const JointMatrix normal = joints.transpose() * weight.asDiagonal() * joints;
  const JointVector gradient = joints.transpose() * weight.cwiseProduct(row);
  JointVector play_rad = JointVector::Zero(), before_rad = JointVector::Constant(1.0);
  for (int sweep = 0; sweep < kSweeps && play_rad != before_rad; ++sweep) {
    before_rad = play_rad;
    for (int j = 0; j < kJoints; ++j) {
      if (!(normal(j, j) > 0.0)) continue;
      play_rad[j] += (gradient[j] - normal.row(j).dot(play_rad)) / normal(j, j);
      play_rad[j] = std::clamp(play_rad[j], -parameters_.most_play_rad, parameters_.most_play_rad);
    }
  }
  row -= limb.joints_G * play_rad;
  return {row.head<3>(), row.tail<3>()};
}

int StanceFit::odd_one(const PerLimb<Word>& words, Fit& fit) const noexcept {
  int odd = -1, counted = 0;
  fit.rest = std::numeric_limits<double>::infinity();
  for (const Word& word : words) counted += word.counts;
  for (int l = 0; l < kLimbs && counted >= kLeastHolds; ++l) {
    if (!words[l].counts) continue;
    const Fit without = fit_without(l, words);
    if (without.rest >= fit.rest) continue;
    fit = without;
    odd = l;
  }
  return odd;
}

void StanceFit::look_back(int window, double dt_s) noexcept {
  const int cycles = kCycles[window];
  const int then = (now_ + kPast - cycles) % kPast;
  PerLimb<Word> words;
  for (int l = 0; l < kLimbs; ++l) {
    const Standing& limb = limbs_[l];
    if (limb.holds && limb.cycles > cycles)
      words[l] = word(limb, limb.path - limb.past[then], information(limb, cycles));
  }
  Moved& moved = moved_[window];
  Fit best;
  moved.limb = odd_one(words, best);
  if (moved.limb < 0) return;
  const Misfit misfit = in_gripper(limbs_[moved.limb], best.left);
  const Misfit slid = beyond_play(limbs_[moved.limb], misfit, cycles);
  // What play explains most of is play.
  const double off_m = misfit.shift_G_m.tail<2>().norm();
  const double play_m = (misfit.shift_G_m - slid.shift_G_m).tail<2>().norm();
  const double explained_m = play_m > kPlay * off_m ? play_m : 0.0;
  moved.way_m = slid.shift_G_m.tail<2>();
  moved.alone =
      parameters_.shift_sigma_m * std::sqrt(best.rest) < kAlone * off_m && kDoubts * best.doubt_m < moved.way_m.norm();
  moved.turn_m = on_faces(slid).z();
  const double turned_rad = std::abs(slid.turn_G_rad.x());
  moved.turns_alone = parameters_.turn_sigma_rad * std::sqrt(best.rest) < kAlone * std::abs(misfit.turn_G_rad.x()) &&
                      kDoubts * best.doubt_rad < turned_rad;
  if (window == 0) play_m_ = std::max(play_m_ * std::exp(-dt_s / parameters_.play_memory_s), explained_m);
}

double StanceFit::slid_m(int limb) const noexcept {
  const Vector3 slid_m = on_faces(beyond_play(limbs_[limb], since_contact_[limb], limbs_[limb].cycles));
  const double along_m = std::max(slid_m.head<2>().norm() - kDoubts * doubt_m_[limb], 0.0);
  return std::hypot(along_m, std::max(std::abs(slid_m.z()) - kDoubts * pad_radius_m_ * doubt_rad_[limb], 0.0));
}

double StanceFit::misfit_m(int limb) const noexcept {
  if (limb != misfit_limb_) return 0.0;
  return std::max(since_contact_[limb].shift_G_m.norm(), kArm_m * since_contact_[limb].turn_G_rad.norm());
}

double StanceFit::misfit_off_faces_m(int limb) const noexcept {
  if (limb != misfit_limb_) return 0.0;
  const Misfit& misfit = since_contact_[limb];
  return std::max(std::abs(misfit.shift_G_m.x()), kArm_m * misfit.turn_G_rad.tail<2>().norm());
}

void StanceFit::update(const PerLimb<FittedLimb>& limbs, double dt_s) noexcept {
  if (!begun_) play_m_ = parameters_.slip_m;  // not known yet
  since_contact_.fill({});
  doubt_m_.fill(0.0);
  doubt_rad_.fill(0.0);
  moved_.fill({});
  misfit_limb_ = -1;
  if (!lay_body(limbs)) {
    drifts_.fill({});
    forget_drift();
    looked_ = -1;
    return;
  }
  begun_ = true;
  PerLimb<Word> words, played;
  int counted = 0;
  for (int l = 0; l < kLimbs; ++l) {
    if (!limbs_[l].holds) continue;
    ++counted;
    words[l] = word(limbs_[l], limbs_[l].off, information(limbs_[l], 0));
    played[l] = word(limbs_[l], limbs_[l].off, information(limbs_[l], limbs_[l].cycles));
  }
  for (int l = 0; l < kLimbs && counted >= kLeastHolds; ++l) {
    if (!words[l].counts) continue;
    since_contact_[l] = in_gripper(limbs_[l], fit_without(l, words).left);
    const Fit doubtful = fit_without(l, played);
    doubt_m_[l] = doubtful.doubt_m;
    doubt_rad_[l] = doubtful.doubt_rad;
  }
  Fit best;
  misfit_limb_ = odd_one(words, best);
  for (int window = 0; window < kWindows; ++window) look_back(window, dt_s);
  cycles_ = (cycles_ + 1) % kSampled;
  if (cycles_ == 0) remember(limbs);
  // One of them a cycle.
  looked_ = cycles_ < kDrifts ? cycles_ : -1;
  if (looked_ >= 0) look_far_back(looked_);
}

}  // namespace crux
