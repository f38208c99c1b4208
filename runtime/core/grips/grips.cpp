#include "core/grips/grips.hpp"

#include <algorithm>
#include <bit>

namespace crux {
namespace {

// A gripper that slips is relieved where so many others take its load.
constexpr int kLeastOthers = 2;
// What a limb bears of the rest while its new grasp is pulled.
constexpr double kPulledLoad = 1e-3;
// A foot that touches down presses with so many times the force of a contact.
constexpr double kTouchPress = 1.5;
// Of its friction, what a foot is asked for at least that has slid as far as it may.
constexpr double kLeastTrust = 0.3;
// A limb with this share of its load counts as standing.
constexpr double kStandingLoad = 0.9;
// So few grips alone do not show which of them creeps.
constexpr int kLeastGrips = 3;

}  // namespace

FootCone foot_cone(const CycleView& now, const LimbReference& reference) noexcept {
  if (!reference.on_foothold) return {};
  return {.stands = true,
          .normal_W = reference.off_W(),
          .friction = reference.friction / now.robot.control.grasp_force_factor,
          .max_normal_N = now.plan->max_normal_N,
          .to_foot_W_m = reference.to_foot_W_m()};
}

Contact contact(const CycleView& now, int limb, const LimbReference& reference) noexcept {
  return {reference.friction,
          now.plan->patch_k_m,
          std::min(now.plan->max_normal_N, now.robot.gripper.max_finger_force_N),
          now.limbs[limb].grip_opening_m(reference),
          reference.lean_rad,
          now.robot.gripper.pad_radius_m};
}

Grips::Grips(const RobotDescription& robot)
    : parameters_(robot.stance),
      stance_(robot.stance, robot.gripper.pad_radius_m),
      slips_{SlipWatch(robot.stance), SlipWatch(robot.stance), SlipWatch(robot.stance), SlipWatch(robot.stance)},
      drift_(robot.stance) {}

void Grips::begin_plan() noexcept {
  pull_.reset();
  retry_.reset();
  searches_.fill({});
  touches_.fill({});
  rubs_.fill(false);
  return_ = Return::kNone;
}

void Grips::forgive() noexcept {
  pull_.reset();
  retry_.reset();
  return_ = Return::kNone;
  for (SlipWatch& slip : slips_) slip = SlipWatch(parameters_);
  drift_ = DriftWatch(parameters_);
  stance_.forget_drift();
}

void Grips::watch(const CycleView& now, bool climbs, double dt_s) noexcept {
  PerLimb<FittedLimb> fitted;
  unsigned holding = 0;  // a bit a limb
  bool closes = false;   // a gripper that finds its place on a hold moves the stance by what it presses
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& reference = now.reference.limbs[l];
    const LimbController& limb = now.limbs[l];
    // Before the plan has begun somebody may put the robot on: a limb holds where its fingers press.
    const bool presses = limb.fingers().force_N() >= now.robot.control.min_grasp_force_N;
    const bool grips = reference.gripping() && limb.in_contact() && (now.started || presses);
    const bool seen = !now.health.hold_lost[l] && !limb.blind();
    const bool holds = now.engaged && !reference.foot() && (grips || pull_.begun(l)) && seen;
    const Vector3 force_B_N = now.body_W.rotation.transpose() * limb.wrench_W().force_N;
    fitted[l] = {&limb.state(), limb.torque_Nm(), force_B_N, holds};
    if (holds) holding |= 1U << static_cast<unsigned>(l);
    closes = closes || (reference.closing() && !reference.point_foot);
  }
  stance_.update(fitted, dt_s);
  for (int l = 0; l < kLimbs; ++l) {
    const double slides = (foot_slid_m(now, l) - parameters_.slip_m) / (parameters_.max_slip_m - parameters_.slip_m);
    const double trust = 1.0 - (1.0 - kLeastTrust) * std::clamp(slides, 0.0, 1.0);
    const bool stands = now.reference.limbs[l].on_foothold && now.reference.limbs[l].gripping();
    foot_trust_[l] = stands ? std::min(foot_trust_[l], trust) : 1.0;
  }
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& reference = now.reference.limbs[l];
    const LimbController& limb = now.limbs[l];
    const double used = reference.on_foothold
                            ? 0.0
                            : limit_surface_utilisation(limb.wrench_W(), reference.finger_axis_W(),
                                                        contact(now, l, reference), limb.fingers().force_N());
    if (now.health.gives_way[l]) slips_[l].give_off_load();
    // While control takes over, the fingers' force and the load change too quickly to be set against each other.
    slips_[l].update(l, stance_, fitted[l].holds && reference.gripping(), now.started ? used : 0.0, dt_s);
    const Matrix3 rotation_GW = (now.body_W.rotation * limb.state().gripper_B.rotation).transpose();
    if (!fitted[l].holds || slips_[l].slipped_at() > 0.0) {
      borne_N_[l] = 0.0;
    } else {
      const double needed_N = needed_grasp_force_N(limb.wrench_W(), reference.finger_axis_W(),
                                                   contact(now, l, reference), now.robot.control);
      borne_N_[l] = std::max(borne_N_[l], needed_N);
    }
    compliances_[l].update(fitted[l].holds ? holding : 0, rotation_GW * limb.wrench_W().force_N,
                           stance_.since_contact(l).shift_G_m, dt_s);
  }
  const bool compares = !now.plan->footholds || std::popcount(holding) >= kLeastGrips;
  const bool grips_alone =
      compares && slipping_limb() < 0 && pull_.limb() < 0 && !closes && !now.health.any_hold_lost();
  PerLimb<double> compliance_m_N;
  for (int l = 0; l < kLimbs; ++l) compliance_m_N[l] = this->compliance_m_N(l);
  drift_.update(stance_, compliance_m_N, grips_alone, climbs, dt_s);
}

int Grips::slipping_limb() const noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    if (slips_[l].slips()) return l;
  }
  return -1;
}

int Grips::moving_limb() const noexcept {
  const int slipping = slipping_limb();
  return slipping >= 0 ? slipping : drift_.suspected();
}

double Grips::relief(const CycleView& now, int limb) const noexcept {
  int others = 0;
  for (int l = 0; l < kLimbs; ++l) others += l != limb && now.reference.limbs[l].gripping() && !now.health.hold_lost[l];
  if (others < kLeastOthers) return 1.0;
  // Two others alone hardly bear all.
  const double least = others > kLeastOthers ? 0.0 : parameters_.relief_load;
  return std::max(slips_[limb].relief(), least);
}

double Grips::load(const CycleView& now, int limb, const LimbReference& reference) const noexcept {
  if (now.health.hold_lost[limb]) return 0.0;
  // With a hold gone, or giving way, each grip is needed whole, also one that takes load up just now, or gives it off.
  const bool needed = now.health.any_hold_lost() || now.health.any_gives_way();
  return (needed && reference.gripping() ? 1.0 : reference.load) * relief(now, limb);
}

double Grips::foot_slid_m(const CycleView& now, int limb) const noexcept {
  const LimbReference& reference = now.reference.limbs[limb];
  const LimbController& foot = now.limbs[limb];
  const bool stands = reference.on_foothold && reference.gripping() && reference.load > kStandingLoad;
  if (!now.started || !stands || !foot.found() || foot.blind()) return 0.0;
  const Vector3 off_m = foot.gripper_W_m(now.body_W) - foot.anchor_W_m(reference);
  return (off_m - off_m.dot(reference.off_W()) * reference.off_W()).norm();
}

Wrench Grips::touch_W(const CycleView& now, const LimbReference& reference) const noexcept {
  const bool comes = reference.closing() || reference.phase == LimbPhase::kLoad;
  if (!reference.on_foothold || !comes) return {};
  return {kTouchPress * now.robot.control.contact_force_N * (1.0 - reference.load) * reference.off_W(),
          Vector3::Zero()};
}

PerLimb<Bearer> Grips::bearers(const CycleView& now, const PlanReference& reference) const noexcept {
  PerLimb<Bearer> bearers;
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference.limbs[l];
    bearers[l] = {now.limbs[l].anchor_W_m(limb), limb.finger_axis_W(), load(now, l, limb),
                  now.health.hold_lost[l] ? Wrench() : limb.wrench_W * relief(now, l)};
    if (limb.on_foothold && !now.health.hold_lost[l]) {
      bearers[l].foot = foot_cone(now, limb);
      bearers[l].foot.friction *= foot_trust_[l];
      bearers[l].position_W_m += limb.to_foot_W_m();
      bearers[l].finger_axis_W.setZero();
      bearers[l].planned_W = {limb.wrench_W.force_N + touch_W(now, limb).force_N, Vector3::Zero()};
      if (limb.closing() || limb.phase == LimbPhase::kLoad) bearers[l].load = std::max(bearers[l].load, kPulledLoad);
    }
    if (pull_.limb() == l) {
      // A pull that goes makes way for what the plan loads the grasp with: never more than it was pulled with.
      bearers[l].planned_W = bearers[l].planned_W + pull_.pull_W() * (1.0 - bearers[l].load);
      bearers[l].load = std::max(bearers[l].load, kPulledLoad);
    }
  }
  return bearers;
}

Contact Grips::known_contact(const CycleView& now, int limb) const noexcept {
  Contact known = contact(now, limb, now.reference.limbs[limb]);
  const double slipped_at = slips_[limb].slipped_at();
  if (slipped_at > 0.0) known.friction *= std::min(slipped_at, 1.0);
  return known;
}

double Grips::utilisation(const CycleView& now, int limb) const noexcept {
  const LimbReference& reference = now.reference.limbs[limb];
  if (!now.plan || now.plan->point_feet || !reference.gripping()) return 0.0;
  const Wrench& wrench_W = now.health.force_torque_distrusted[limb] ? now.wrenches_W[limb] : now.limbs[limb].wrench_W();
  if (reference.on_foothold) {
    FootCone cone = foot_cone(now, reference);
    cone.friction = reference.friction;
    return cone.utilisation(wrench_W.force_N);
  }
  return limit_surface_utilisation(wrench_W, reference.finger_axis_W(), contact(now, limb, reference),
                                   now.limbs[limb].fingers().force_N());
}

}  // namespace crux
