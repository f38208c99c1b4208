// Control that takes over from where the robot hangs, as after a loss of power.
#include "core/control_core.hpp"

namespace crux {
namespace {

// A gripper that came down on its hold, or was closing about it, is turned by more than that: it begins anew.
constexpr double kAskew_rad = 0.1;
// A body stands up as long as no joint and no grip is used further than that, and limbs come where they should.
constexpr double kMostTorque = 0.95, kMostUsed = 0.9, kMostMissed_m = 0.002;

}  // namespace

/// From where the robot hangs: what was to come down on its hold may be somewhere else.
void ControlCore::begin_again() noexcept {
  reference_ = play(*plan_, clock_.now());
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference_.limbs[l];
    double distance_m = 0.0, angle_rad = 0.0;
    limbs_[l].pose_error(limb, body_.body_W(), distance_m, angle_rad);
    const bool comes = !limb.point_foot && (limb.closing() || limb.phase == LimbPhase::kDescend);
    distance_m = (limbs_[l].gripper_W_m(body_.body_W()) - limbs_[l].anchor_W_m(limb)).norm();
    if (comes && (distance_m > robot_.supervisor.arrive_tolerance_m || angle_rad > kAskew_rad))
      clock_.approach_anew(*plan_);
  }
  reference_ = play(*plan_, clock_.now());
}

void ControlCore::stand_up(double dt_s) noexcept {
  if (!rise_.rises()) return;
  bool may = engagement() >= 1.0;
  for (int l = 0; l < kLimbs; ++l) {
    const bool bears = limbs_[l].torque_share() <= kMostTorque && utilisation(l) <= kMostUsed;
    const LimbPhase phase = reference_.limbs[l].phase;
    const bool flies = phase == LimbPhase::kLift || phase == LimbPhase::kSwing || phase == LimbPhase::kDescend;
    const bool comes = flies ? !limbs_[l].caught() : limbs_[l].ik_error_m() <= kMostMissed_m;
    may = may && bears && comes;
  }
  rise_.advance(may, dt_s);
  reference_.body_W = rise_.below(reference_.body_W);
}

}  // namespace crux
