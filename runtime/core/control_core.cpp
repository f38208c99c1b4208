#include "core/control_core.hpp"

#include <algorithm>
#include <cmath>

#include "core/grips/shares.hpp"
#include "core/grips/squeeze.hpp"
#include "core/plan/plan_join.hpp"
#include "core/plan/plan_preparation.hpp"
#include "core/robot/gravity.hpp"
#include "core/supervise/loop_errors.hpp"
#include "core/supervise/plan_start.hpp"

namespace crux {
namespace {

constexpr const char* kLatched = "nodes hold by themselves; clear the fault to re-arm them";
constexpr const char* kNotWell = "not all nodes and sensors answer and are well";

// Half of a gripper's width: pads give in turning as if they gave in shifting so far from its middle.
constexpr double kGripLever_m = 0.03;

/// Of this cycle; nothing where its clock is wrong, of which the fault monitor tells.
double elapsed_s(const crux_msgs::control_input_t& in) noexcept {
  return in.dt_s > 0.0 && std::isfinite(in.dt_s) ? in.dt_s : 0.0;
}

}  // namespace

ControlCore::ControlCore(const RobotDescription& robot)
    : robot_(robot),
      limbs_{LimbController(robot, 0), LimbController(robot, 1), LimbController(robot, 2), LimbController(robot, 3)},
      calibration_(robot.calibrates ? std::make_unique<Calibration>(robot) : nullptr),
      correction_(robot.control.body_gain_1_s, robot.control.max_body_correction_m,
                  robot.control.max_body_rotation_rad),
      localisation_(robot.localisation),
      grips_(robot),
      faults_(robot),
      balance_(robot.stance, robot.force_torque) {}

CycleView ControlCore::view() const noexcept {
  return {robot_,      plan_.get(),        limbs_,   faults_.health(), body_.body_W(), com_W_m_, reference_,
          wrenches_W_, balance_.carried(), engaged_, started_};
}

std::string ControlCore::load_plan(const crux_msgs::plan_t& plan) {
  Result<std::unique_ptr<const PreparedPlan>> prepared = prepare_plan(robot_, plan, plan_.get());
  if (!prepared) return prepared.reason();
  return in_words(exchange_plan(prepared.value()));
}

Reason ControlCore::change_plan_ahead(std::unique_ptr<const PreparedPlan>& plan) noexcept {
  if (!plan || plan->follows != plan_->plan_id) return {"the robot is climbing; hold it first"};
  const int here = clock_.now().interval;
  // The body's way through the last interval that both have depends on what comes after it.
  if (here + 1 >= plan->shared) {
    if (plan->shared == plan_->intervals()) return {"the plan that runs is about to end; go on when the robot holds"};
    return {"the robot is about to pass the stance from which this plan goes on otherwise than the one that runs"};
  }
  if (supervisor_.motion() != Motion::kForward && plan->shared < plan_->intervals())
    return {"the robot climbs a single step, or back; another way on is taken when it climbs forward or holds"};
  for (int l = 0; l < kLimbs; ++l) {
    if (!reference_.limbs[l].gripping() && grips_elsewhere(*plan, *plan_, here + 1, l))
      return {"the limb is in the air, and this plan has it land elsewhere", l};
  }
  plan_.swap(plan);
  const PlanReference now = play(*plan_, clock_.now());
  for (int l = 0; l < kLimbs; ++l) {
    LimbReference& limb = reference_.limbs[l];
    if (!limb.gripping() || !grips_elsewhere(*plan_, *plan, here, l)) continue;
    const LimbReference before = limb;
    limb.gripper_position_W_m = now.limbs[l].gripper_position_W_m;
    limb.gripper_yaw_W_rad = now.limbs[l].gripper_yaw_W_rad;
    limb.gripper_tilt_W_rad = now.limbs[l].gripper_tilt_W_rad;
    limbs_[l].regrip(before, limb);
  }
  return {};
}

Reason ControlCore::exchange_plan(std::unique_ptr<const PreparedPlan>& plan) noexcept {
  if (supervisor_.state() == SupervisorState::kClimbing) return change_plan_ahead(plan);
  const bool stands_there = plan && (plan->footholds || (plan_ && plan_->footholds));
  if (supervisor_.state() != SupervisorState::kIdle && stands_there)
    return {"a robot that is on the wall takes over no other plan from or to footholds; take it off the wall first"};
  if (supervisor_.state() != SupervisorState::kIdle && plan) {
    const PlanReference start = play(*plan, {});
    if (const Reason off = off_stance(view(), start)) return off;
    if (const Reason off = off_start(view(), start, true)) return off;
  }
  const bool stands = engaged_ && plan && plan->point_feet == plan_->point_feet;
  plan_.swap(plan);
  looks_around_ = false;
  supervisor_.plan_exchanged(stands);
  clock_.reset();
  grips_.begin_plan();
  const PlanReference before = reference_;
  reference_ = plan_ ? play(*plan_, clock_.now()) : PlanReference();
  if (stands) {
    hand_over(before);
  } else {
    started_ = false;
    engaged_ = false;
    if (plan_) body_.reset(reference_.body_W);
  }
  return {};
}

void ControlCore::hand_over(const PlanReference& before) noexcept {
  correction_.rebase(correction_.command_W(before.body_W), reference_.body_W);
  for (int l = 0; l < kLimbs; ++l) {
    limbs_[l].hand_over(before.limbs[l], reference_.limbs[l], engagement());
    if (!reference_.limbs[l].gripping()) faults_.begin_in_air(l);
  }
  grips_.begin_contact();
  balance_.restart();
  engaged_time_s_ = 0.0;
}

double ControlCore::engagement() const noexcept { return smoothstep(engaged_time_s_ / robot_.control.engage_time_s); }

bool ControlCore::as_new() const noexcept {
  return state() == SupervisorState::kIdle && !plan_ && !supervisor_.fault() && supervisor_.speed_scale() == 1.0;
}

void ControlCore::step(const crux_msgs::control_input_t& in, CycleResult& out) noexcept {
  sense(in);
  if (plan_) watch(elapsed_s(in));
  supervise(in);
  if (engaged_) {
    refer(in);
    engaged_time_s_ += in.dt_s;
    locate(in.dt_s);
    share(in.dt_s);
    aim(in.dt_s);
    if (faults_.force_torque_well(in)) {
      yield(in.dt_s);
      calibrate(in.dt_s);
    }
    press_holds(view(), grips_, clock_.now(), limbs_, rise_.rises(), in.dt_s);
    drive(in);
  } else {
    stand_by();
  }
  write(in, out);
  if (!supervisor_.news()) notice_ = {};
}

void ControlCore::sense(const crux_msgs::control_input_t& in) noexcept {
  faults_.observe(in);
  for (LimbController& limb : limbs_) limb.sense(in);
  if (!plan_) return;
  const CycleView now = view();
  PerLimb<Pose> anchors_W, grippers_B;
  PerLimb<double> weights, levers_m;
  PerLimb<LimbState> states;
  for (int l = 0; l < kLimbs; ++l) {
    states[l] = limbs_[l].state();
    anchors_W[l] = limbs_[l].anchor_W(reference_.limbs[l]);
    grippers_B[l] = states[l].gripper_B;
    levers_m[l] = limbs_[l].turn_found() ? kGripLever_m : 0.0;
    // Where nothing has been commanded yet no encoder can have frozen.
    const bool sees = looks_around_ || !limbs_[l].blind();
    weights[l] = limbs_[l].found() && sees ? grips_.load(now, l, reference_.limbs[l]) : 0.0;
  }
  body_.update(anchors_W, grippers_B, weights, levers_m);
  com_W_m_ = body_.body_W() * centre_of_mass(robot_, states);
  for (LimbController& limb : limbs_) limb.sense_wrench(body_.body_W().rotation, plan_->gravity_W_m_s2, elapsed_s(in));
}

void ControlCore::supervise(const crux_msgs::control_input_t& in) noexcept {
  if (rearm_cycles_ > 0) --rearm_cycles_;
  const bool well = rearm_cycles_ == 0 && faults_.all_well(in);
  FaultList found = faults_.node_fault(in, engaged_);
  const FaultEvent oscillation = crux::oscillation(limbs_);
  if (engaged_) {
    for (const LimbController& limb : limbs_) found.add(limb.encoder_fault());
    found.add(oscillation);
    if (!started_) found.add(late_joint(probe_, robot_));
    faults_.loop_faults(errors(in.late_s), in.dt_s, found);
  }
  const bool idle = plan_ && supervisor_.state() == SupervisorState::kIdle && !looks_around_;
  Reason off = idle ? off_start(view(), reference_, false) : Reason{};
  if (idle && oscillation)
    off = {"the joint oscillates while its node holds it, by {value} rad", oscillation.limb, oscillation.node,
           oscillation.value};
  const bool reverses = in.operator_command == crux_msgs::command_t::REVERSE;
  supervisor_.update({.command = in.operator_command,
                      .command_value = in.command_value,
                      .plan_loaded = plan_ && !looks_around_,
                      .may_take_over = well && idle && !off,
                      .plan_started = started_,
                      .plan_complete = plan_ && clock_.complete(*plan_),
                      .walks = plan_ && plan_->point_feet,
                      .footholds = plan_ && plan_->footholds,
                      .arrived = plan_ && clock_.arrived(*plan_),
                      .testing = grips_.pull().limb() >= 0,
                      .can_reverse = reverses && plan_ && clock_.can_reverse(*plan_),
                      .link_restored = faults_.link_restored(),
                      .rearming = rearm_cycles_ > 0,
                      .faults = found,
                      .cause = faults_.standing_cause(in),
                      .supply = faults_.supply_fault(),
                      .stands_up = rise_.rises(),
                      .not_ready_reason = well                      ? off
                                          : faults_.any_latched(in) ? Reason{kLatched}
                                                                    : Reason{kNotWell}});
  take_up();
  follow_supervisor(well);
}

void ControlCore::follow_supervisor(bool well) noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    limbs_[l].fingers().trust(!faults_.health().finger_force_distrusted[l]);
    limbs_[l].trust_force_torque(!faults_.health().force_torque_distrusted[l]);
    limbs_[l].stand(faults_.joint_stands(l), faults_.fingers_stand(l));
  }
  if (supervisor_.rearm_requested()) {
    faults_.forgive();
    grips_.forgive();
    rearm_cycles_ = kRearmCycles;
    engaged_ = false;
  }
  if (!supervisor_.controls()) {
    engaged_ = false;
  } else if (!engaged_ && well) {
    if (started_) begin_again();
    engage();
  }
  if (supervisor_.departs()) {
    clock_.depart(*plan_, supervisor_.motion());
    reference_ = play(*plan_, clock_.now());
  }
  if (supervisor_.state() != SupervisorState::kClimbing) settling_time_s_ = 0.0;
}

LoopErrors ControlCore::errors(double late_s) const noexcept {
  LoopErrors errors = loop_errors(view(), grips_, balance_, rise_.rises());
  errors.late_s = late_s;
  errors.below_m = rise_.left_m();
  errors.rise_waited_s = rise_.waited_s();
  if (supervisor_.state() == SupervisorState::kClimbing) {
    errors.waited_s = started_ ? clock_.waited_s() : settling_time_s_;
    errors.waiting_limb = started_ ? clock_.waiting_limb() : settling_limb_;
  }
  return errors;
}

std::array<double, kAllJoints> ControlCore::joint_dead_time_s() const noexcept {
  return dead_time_s(probe_, robot_.can.rate_Hz);
}

void ControlCore::engage() noexcept {
  for (int l = 0; l < kLimbs; ++l) limbs_[l].engage(reference_.limbs[l], body_.body_W(), started_);
  if (calibration_) {
    calibration_->restart();
    for (LimbController& limb : limbs_) limb.set_gains(robot_.admittance);
  }
  rise_ = {};
  if (started_) rise_.begin(body_.body_W(), reference_.body_W);
  correction_.reset(body_.body_W(), rise_.below(reference_.body_W));
  if (!started_ || !localisation_.begun()) {
    PerLimb<Vector3> arms_W_m;
    PerLimb<bool> on_hold;
    for (int l = 0; l < kLimbs; ++l) {
      arms_W_m[l] = limbs_[l].anchor_W_m(reference_.limbs[l]) - body_.body_W().position_m;
      on_hold[l] = reference_.limbs[l].gripping();
    }
    localisation_.begin(body_.body_W().position_m, arms_W_m, on_hold);
  }
  if (!started_) probe_.restart();
  engaged_ = true;
  engaged_time_s_ = 0.0;
}

void ControlCore::refer(const crux_msgs::control_input_t& in) noexcept {
  if (supervisor_.state() == SupervisorState::kClimbing && grips_.moving_limb() < 0) advance_clock(in.dt_s);
  if (supervisor_.state() == SupervisorState::kHolding)
    grips_.find_hold_again(view(), clock_, limbs_, in.operator_command == crux_msgs::command_t::HOLD, in.dt_s);
  reference_ = play(*plan_, clock_.now());
  grips_.hold_open(reference_);
  stand_up(in.dt_s);
}

void ControlCore::advance_clock(double dt_s) noexcept {
  PerLimb<LimbEvents> events;
  for (int l = 0; l < kLimbs; ++l) events[l] = limbs_[l].events(reference_.limbs[l], body_.body_W(), dt_s);
  if (!started_) settle(events, dt_s);
  if (started_) {
    grips_.judge(view(), clock_, limbs_, localisation_.unsure_of_height(), events, dt_s);
    if (const auto [limb, high_m] = grips_.touched(); limb >= 0) touched_[limb].touch(high_m);
    clock_.advance(*plan_, events, dt_s, supervisor_.speed_scale());
  }
  // A pull takes as long as its load is heavy, and ends by itself.
  if (grips_.pull().limb() >= 0) clock_.wait_anew();
}

void ControlCore::settle(const PerLimb<LimbEvents>& events, double dt_s) noexcept {
  settling_limb_ = -1;
  for (int l = 0; l < kLimbs && settling_limb_ < 0; ++l) {
    if (reference_.limbs[l].gripping() && !events[l].gripped) settling_limb_ = l;
  }
  started_ = settling_limb_ < 0 && probe_.done() && engaged_time_s_ >= robot_.supervisor.settle_time_s;
  if (started_) grips_.begin_climb();
  if (engaged_time_s_ >= robot_.supervisor.settle_time_s) settling_time_s_ += dt_s;
}

void ControlCore::locate(double dt_s) noexcept {
  // Point feet find no place on the map; those of a walk learn no sensor's bias.
  if (plan_->point_feet || plan_->footholds || !started_) return;
  Vector3 force_W_N = Vector3::Zero();
  bool known = supervisor_.state() == SupervisorState::kClimbing;
  for (int l = 0; l < kLimbs; ++l) {
    known = known && !grips_.touches_wall(l);
    if (!limbs_[l].in_contact() && !reference_.limbs[l].closing()) continue;
    force_W_N += limbs_[l].wrench_W().force_N;
    known = known && limbs_[l].force_torque_tared() && !faults_.health().force_torque_distrusted[l];
  }
  localisation_.feel(force_W_N, robot_.total_mass_kg * plan_->gravity_W_m_s2, known, dt_s);
  const Pose motion = localisation_.correction(body_.body_W().position_m, dt_s);
  body_.reset(motion * body_.body_W());
  correction_.relocate(motion, reference_.body_W);
  for (int l = 0; l < kLimbs; ++l) limbs_[l].relocate(motion, reference_.limbs[l]);
}

void ControlCore::share(double dt_s) noexcept {
  grips_.pull_new_grasps(view(), limbs_, supervisor_.state() == SupervisorState::kClimbing, dt_s);
  wrenches_W_ = shared(view(), grips_, sharing_, rise_.rises() ? StandUp::kSharedTorque : 1.0);
}

void ControlCore::aim(double dt_s) noexcept {
  Vector3 missed_W_m = Vector3::Zero();
  for (int l = 0; l < kLimbs; ++l) missed_W_m += limbs_[l].missed_W_m(reference_.limbs[l]);
  if (!plan_->point_feet) correction_.make_way(missed_W_m, dt_s);
  // Before the plan has begun somebody may carry the body: an integral would only push against him, or against a joint
  // that stands.
  const bool stands = std::ranges::any_of(limbs_, &LimbController::joint_stands);
  const Pose body_command_W = correction_.update(reference_.body_W, body_.body_W(), started_ && !stands ? dt_s : 0.0);
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference_.limbs[l];
    const bool lands = limb.on_foothold && limbs_[l].foot_force_N(limb) >= robot_.control.contact_force_N;
    const bool presses = limb.closing() && (limb.on_foothold ? lands : limbs_[l].fingers().presses());
    const bool pulled = presses || grips_.pull().limb() == l || grips_.presses_wall(l);
    if (presses) touched_[l].press(limbs_[l].gripper_W_m(body_.body_W()).z());
    if (limb.phase == LimbPhase::kDescend) touched_[l].open();
    if (limb.passing()) touched_[l] = {};
    const bool found = limbs_[l].follow_contact(limb, body_.body_W(), body_command_W, pulled);
    if (found && started_ && !plan_->point_feet && !plan_->footholds && limb.gripping()) find_place(l);
  }
}

void ControlCore::find_place(int l) noexcept {
  const LimbReference& limb = reference_.limbs[l];
  const Vector3 place_W_m = limbs_[l].anchor_W_m(limb), body_W_m = body_.body_W().position_m;
  localisation_.grasp(body_W_m, place_W_m - body_W_m, limb.finger_axis_W(),
                      limb.finger_axis_W().dot(place_W_m - limb.gripper_position_W_m));
  if (const std::optional<double> high_m = touched_[l].found(place_W_m.z()))
    localisation_.touch(body_W_m, place_W_m - body_W_m, *high_m);
}

void ControlCore::yield(double dt_s) noexcept {
  const PerLimb<Wrench> errors = wrench_errors(view(), grips_, engagement());
  for (int l = 0; l < kLimbs; ++l) limbs_[l].comply(reference_.limbs[l], errors[l], body_.body_W().rotation, dt_s);
}

void ControlCore::calibrate(double dt_s) noexcept {
  if (!calibration_ || plan_->point_feet) return;
  const LimbHealth& health = faults_.health();
  PerLimb<Yielding> translations, rotations;
  for (int l = 0; l < kLimbs; ++l) {
    // A limb that slips or has lost its hold is given no error: it shows nothing of its gains.
    if (grips_.slip(l).slips() || health.hold_lost[l] || health.force_torque_distrusted[l] || limbs_[l].rigid() ||
        reference_.limbs[l].on_foothold)
      continue;
    translations[l] = limbs_[l].translation();
    rotations[l] = limbs_[l].rotation();
  }
  if (!calibration_->update(translations, rotations, dt_s)) return;
  for (LimbController& limb : limbs_) limb.set_gains(calibration_->gains());
}

void ControlCore::drive(const crux_msgs::control_input_t& in) noexcept {
  const double engagement = this->engagement();
  if (!started_ && engagement >= 1.0) probe_.step(in.joint_torque_nm);
  for (int l = 0; l < kLimbs; ++l)
    limbs_[l].drive(reference_.limbs[l], wrenches_W_[l], plan_->gravity_W_m_s2, body_.body_W(), engagement, in.dt_s);
}

void ControlCore::stand_by() noexcept {
  for (LimbController& limb : limbs_) limb.stand_by();
  wrenches_W_.fill(Wrench());
}

}  // namespace crux
