#include "core/limb/fingers.hpp"

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

constexpr double kRest_m_s = 0.02;
constexpr double kPadsGive_m = 0.001;  // in the width of a hold, under its squeeze
constexpr double kStop_m = 0.001;      // from the closed stop: they press on each other or on the stop itself
// Fingers that stay so near to a place stand there.
constexpr double kStands_m = 0.0002;

}  // namespace

Fingers::Fingers(const RobotDescription& robot)
    : gripper_(robot.gripper),
      supervisor_(robot.supervisor),
      contact_force_N_(robot.control.contact_force_N),
      grasp_(robot.gripper, robot.control) {}

void Fingers::engage() noexcept {
  grasp_.reset(opening_m_, force_N_);
  gripped_opening_m_ = opening_m_;
  gripped_time_s_ = 0.0;
}

void Fingers::restore(double opening_m) noexcept {
  gripped_opening_m_ = opening_m;
  opened_m_ = gripper_.opening_m.high;
}

bool Fingers::gripped(const LimbReference& reference, double dt_s) noexcept {
  // As far as they were open before they began to close, on the way down or there.
  if (reference.phase == LimbPhase::kDescend) {
    opened_m_ = std::max(opened_m_, opening_m_);
  } else if (!reference.gripping() && !reference.closing()) {
    opened_m_ = opening_m_;
  }
  stood_s_ = std::abs(opening_m_ - stood_m_) < kStands_m ? stood_s_ + dt_s : 0.0;
  if (stood_s_ == 0.0) stood_m_ = opening_m_;
  const bool about_nothing = reference.closing() && (closed() || opening_m_ > opened_m_ - kLeastClosed_m);
  const bool grips = force_N() >= contact_force_N_ && !about_nothing;
  gripped_time_s_ = grips ? gripped_time_s_ + dt_s : 0.0;
  return gripped_time_s_ >= supervisor_.persistence_s;
}

void Fingers::grasp(const LimbReference& reference, double wanted_N, double dt_s) noexcept {
  grasp_.see(opening_m_, speed_m_s_, force_N());
  if (stand_) return grasp_.reset(opening_m_, force_N());
  if (!reference.foot() && (reference.gripping() || reference.closing())) {
    grasp_.press(wanted_N, force_N(), opening_m_, dt_s);
  } else {
    // What they meet as they narrow on the way down is not where the gripper is to stand yet.
    const bool meets = reference.phase == LimbPhase::kDescend && !reference.on_foothold && grasp_.touches(force_N());
    grasp_.open_to(meets ? reference.open_m : wanted_opening_m(reference), dt_s);
  }
}

double Fingers::residual_N(const LimbReference& reference, bool begun, bool touches) const noexcept {
  const bool rest = std::abs(speed_m_s_) < kRest_m_s;
  if (finds_no_hold(reference, begun)) return 0.0;  // they stand at their own stop
  if (rest && reference.passing() && opened(reference)) return touches ? 0.0 : std::abs(force_N_);
  return rest ? std::max(expected_force_N() - force_N_, 0.0) : 0.0;
}

double Fingers::grip_opening_m(const LimbReference& reference, bool in_contact) const noexcept {
  if (reference.foot() || !(reference.gripping() || reference.closing())) return reference.finger_opening_m;
  return std::clamp(in_contact ? gripped_opening_m_ : opening_m_, gripper_.opening_m.low, gripper_.opening_m.high);
}

bool Fingers::finds_no_hold(const LimbReference& reference, bool begun) const noexcept {
  const bool seeks = begun ? reference.closing() : reference.gripping();
  return seeks && !reference.on_foothold && closed();
}

bool Fingers::closes_on_nothing() const noexcept {
  return opening_m_ < gripped_opening_m_ - kPadsGive_m && force_N_ < least_force_N();
}

bool Fingers::closed() const noexcept { return opening_m_ < gripper_.opening_m.low + kStop_m; }

}  // namespace crux
