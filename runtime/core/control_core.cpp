#include "core/control_core.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

#include "core/loads/internal_wrench.hpp"
#include "core/loads/wrench_distribution.hpp"
#include "core/plan/plan_preparation.hpp"
#include "core/robot/gravity.hpp"
#include "core/robot/node_protocol.hpp"

namespace crux {
namespace {

// What a limb bears of the rest while its new grasp is pulled.
constexpr double kTestedLoad = 1e-3;

}  // namespace

ControlCore::ControlCore(const RobotDescription& robot)
    : robot_(robot),
      limbs_{LimbController(robot, 0), LimbController(robot, 1), LimbController(robot, 2), LimbController(robot, 3)},
      calibration_(robot.calibrates ? std::make_unique<Calibration>(robot) : nullptr),
      correction_(robot.control.body_gain_1_s, robot.control.max_body_correction_m,
                  robot.control.max_body_rotation_rad),
      localisation_(robot.localisation),
      faults_(robot),
      stance_(robot.stance),
      slips_{SlipWatch(robot.stance), SlipWatch(robot.stance), SlipWatch(robot.stance), SlipWatch(robot.stance)},
      balance_(robot.stance) {}

std::string ControlCore::load_plan(const crux_msgs::plan_t& plan) {
  Result<std::unique_ptr<const PreparedPlan>> prepared = prepare_plan(robot_, plan);
  if (!prepared) return prepared.reason();
  return in_words(exchange_plan(prepared.value()));
}

Reason ControlCore::exchange_plan(std::unique_ptr<const PreparedPlan>& plan) noexcept {
  if (supervisor_.state() == SupervisorState::kClimbing) return {"the robot is climbing; hold it first"};
  if (supervisor_.state() != SupervisorState::kIdle && plan) {
    const PlanReference start = play(*plan, {});
    if (const Reason off = off_stance(start)) return off;
    if (const Reason off = off_start(start)) return off;
  }
  const bool stands = engaged_ && plan && plan->point_feet == plan_->point_feet;
  plan_.swap(plan);
  looks_around_ = false;
  supervisor_.plan_exchanged(stands);
  clock_.reset();
  test_.reset();
  retry_.reset();
  searches_.fill({});
  return_ = Return::kNone;
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
  stance_.begin_anew();
  balance_.restart();
  engaged_time_s_ = 0.0;
}

double ControlCore::engagement() const noexcept { return smoothstep(engaged_time_s_ / robot_.control.engage_time_s); }

bool ControlCore::as_new() const noexcept {
  return state() == SupervisorState::kIdle && !plan_ && !supervisor_.fault() && supervisor_.speed_scale() == 1.0;
}

void ControlCore::step(const crux_msgs::control_input_t& in, CycleResult& out) noexcept {
  sense(in);
  supervise(in);
  if (engaged_) {
    if (supervisor_.state() == SupervisorState::kClimbing && slipping_limb() < 0) advance_clock(reference_, in.dt_s);
    find_hold_again(in.operator_command, in.dt_s);
    reference_ = play(*plan_, clock_.now());
    retry_.apply(reference_);
    stand_up(in.dt_s);
    control(in, reference_);
  } else {
    for (LimbController& limb : limbs_) limb.stand_by();
    wrenches_W_.fill(Wrench());
  }
  write(in, out);
  if (!supervisor_.news()) notice_ = {};
}

double ControlCore::load(int limb, const LimbReference& reference) const noexcept {
  if (faults_.lost(limb)) return 0.0;
  // With a hold gone each grip is needed whole, also one that takes load up just now, or gives it off.
  return (faults_.any_lost() && reference.gripping() ? 1.0 : reference.load) * relief(limb);
}

void ControlCore::sense(const crux_msgs::control_input_t& in) noexcept {
  faults_.observe(in);
  PerLimb<Vector3> anchors_W_m, grippers_B_m;
  PerLimb<double> weights;
  for (int l = 0; l < kLimbs; ++l) {
    limbs_[l].sense(in);
    anchors_W_m[l] = limbs_[l].anchor_W_m(reference_.limbs[l]);
    grippers_B_m[l] = limbs_[l].state().gripper_B.position_m;
    // Where nothing has been commanded yet no encoder can have frozen.
    const bool sees = looks_around_ || !limbs_[l].blind();
    weights[l] = limbs_[l].found() && sees ? load(l, reference_.limbs[l]) : 0.0;
  }
  if (!plan_) return;
  body_.update(anchors_W_m, grippers_B_m, weights);
  PerLimb<LimbState> states;
  for (int l = 0; l < kLimbs; ++l) states[l] = limbs_[l].state();
  com_W_m_ = body_.body_W() * centre_of_mass(robot_, states);
  const double dt_s = in.dt_s > 0.0 && std::isfinite(in.dt_s) ? in.dt_s : 0.0;
  for (LimbController& limb : limbs_) limb.sense_wrench(body_.body_W().rotation, plan_->gravity_W_m_s2, dt_s);
  watch_stance(dt_s);
}

Reason ControlCore::off_stance(const PlanReference& start) const noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    const bool grips = reference_.limbs[l].gripping() && !faults_.lost(l);
    if (start.limbs[l].gripping() && !grips)
      return {"the plan starts with this gripper on a hold, but it is in the air: its fingers press with {value} N", l,
              0, limbs_[l].finger_force_N()};
    if (!start.limbs[l].gripping() && grips)
      return {"the plan starts with this gripper in the air, but it is on its hold and bears {value} N", l, 0,
              limbs_[l].wrench_W().force_N.norm()};
  }
  return {};
}

Reason ControlCore::off_start(const PlanReference& start) const noexcept {
  const SupervisorParameters& p = robot_.supervisor;
  const double body_m = (body_.body_W().position_m - start.body_W.position_m).norm();
  if (!(body_m <= robot_.control.max_body_correction_m))
    return {"the body is {value} m from the plan's start pose (limit: {limit} m)", -1, 0, body_m,
            robot_.control.max_body_correction_m};
  for (int l = 0; l < kLimbs; ++l) {
    double distance_m = 0.0, angle_rad = 0.0;
    limbs_[l].pose_error(start.limbs[l], body_.body_W(), distance_m, angle_rad);
    if (!(distance_m <= p.start_tolerance_m))
      return {"the gripper is {value} m from the plan's start pose (limit: {limit} m)", l, 0, distance_m,
              p.start_tolerance_m};
    if (!(angle_rad <= p.start_tolerance_rad))
      return {"the gripper is rotated by {value} rad from the plan's start pose (limit: {limit} rad)", l, 0, angle_rad,
              p.start_tolerance_rad};
    const double force_N = limbs_[l].finger_force_N();
    if (supervisor_.state() != SupervisorState::kIdle && !start.limbs[l].point_foot && start.limbs[l].gripping() &&
        !(force_N >= p.min_stance_force_N))
      return {"the plan starts with this gripper closed, but its fingers press with {value} N (least: {limit} N)", l, 0,
              force_N, p.min_stance_force_N};
  }
  return {};
}

Reason ControlCore::not_ready(const crux_msgs::control_input_t& in, bool well, const Reason& off) const noexcept {
  if (well) return off;
  return {faults_.any_latched(in) ? "nodes hold by themselves; clear the fault to re-arm them"
                                  : "not all nodes and sensors answer and are well"};
}

void ControlCore::supervise(const crux_msgs::control_input_t& in) noexcept {
  if (rearm_cycles_ > 0) --rearm_cycles_;
  const bool well = rearm_cycles_ == 0 && faults_.all_well(in);
  FaultList found = faults_.node_fault(in, engaged_);
  const FaultEvent oscillation = this->oscillation();
  if (engaged_) {
    for (const LimbController& limb : limbs_) found.add(limb.encoder_fault());
    found.add(oscillation);
    found.add(late_joint());
    faults_.loop_faults(loop_errors(in.late_s), in.dt_s, found);
  }
  const bool idle = plan_ && supervisor_.state() == SupervisorState::kIdle && !looks_around_;
  Reason off = idle ? off_start(reference_) : Reason{};
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
                      .arrived = plan_ && clock_.arrived(*plan_),
                      .testing = test_.limb() >= 0,
                      .can_reverse = reverses && plan_ && clock_.can_reverse(*plan_),
                      .link_restored = faults_.link_restored(),
                      .rearming = rearm_cycles_ > 0,
                      .faults = found,
                      .cause = faults_.standing_cause(in),
                      .supply = faults_.supply_fault(),
                      .stands_up = rise_.rises(),
                      .not_ready_reason = not_ready(in, well, off)});
  take_up();
  for (int l = 0; l < kLimbs; ++l) {
    limbs_[l].trust_finger_force(!faults_.finger_force_distrusted(l));
    limbs_[l].trust_force_torque(!faults_.distrusted(l));
  }
  if (supervisor_.rearm_requested()) {
    faults_.forgive();
    test_.reset();
    retry_.reset();
    return_ = Return::kNone;
    for (SlipWatch& slip : slips_) slip = SlipWatch(robot_.stance);
    rearm_cycles_ = kRearmCycles;
    engaged_ = false;
  }
  if (!supervisor_.controls()) {
    engaged_ = false;
  } else if (!engaged_ && well) {
    if (started_) begin_again();
    engage(reference_);
  }
  if (supervisor_.departs()) {
    clock_.depart(*plan_, supervisor_.motion());
    reference_ = play(*plan_, clock_.now());
  }
  if (supervisor_.state() != SupervisorState::kClimbing) settling_time_s_ = 0.0;
}

void ControlCore::engage(const PlanReference& reference) noexcept {
  for (int l = 0; l < kLimbs; ++l) limbs_[l].engage(reference.limbs[l], body_.body_W());
  if (calibration_) {
    calibration_->restart();
    for (LimbController& limb : limbs_) limb.set_gains(robot_.admittance);
  }
  rise_ = {};
  if (started_) rise_.begin(body_.body_W(), reference.body_W);
  correction_.reset(body_.body_W(), rise_.below(reference.body_W));
  if (!started_ || !localisation_.begun()) {
    PerLimb<Vector3> arms_W_m;
    PerLimb<bool> on_hold;
    for (int l = 0; l < kLimbs; ++l) {
      arms_W_m[l] = limbs_[l].anchor_W_m(reference.limbs[l]) - body_.body_W().position_m;
      on_hold[l] = reference.limbs[l].gripping();
    }
    localisation_.begin(body_.body_W().position_m, arms_W_m, on_hold);
  }
  if (!started_) probe_.restart();
  engaged_ = true;
  engaged_time_s_ = 0.0;
}

PerLimb<Bearer> ControlCore::bearers(const PlanReference& reference) const noexcept {
  PerLimb<Bearer> bearers;
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference.limbs[l];
    bearers[l] = {limbs_[l].anchor_W_m(limb), limb.finger_axis_W(), load(l, limb),
                  faults_.lost(l) ? Wrench() : limb.wrench_W * relief(l)};
    if (test_.limb() == l) bearers[l].load = kTestedLoad, bearers[l].planned_W = test_.pull_W();
  }
  return bearers;
}

PerLimb<Wrench> ControlCore::balanced(const PerLimb<Bearer>& bearers) const noexcept {
  return balanced_wrenches(bearers, com_W_m_, robot_.total_mass_kg * plan_->gravity_W_m_s2,
                           robot_.control.twist_length_m);
}

PerLimb<Wrench> ControlCore::shared(const PlanReference& reference) noexcept {
  if (plan_->point_feet) return balanced_on_feet(reference);
  const PerLimb<Bearer> bearing = bearers(reference);
  const Matrix3& rotation_WB = body_.body_W().rotation;
  PerLimb<Capacity> capacities;
  for (int l = 0; l < kLimbs; ++l)
    capacities[l] = limbs_[l].capacity(known_contact(l, reference.limbs[l]), rotation_WB, plan_->gravity_W_m_s2);
  return sharing_.within_limits(balanced(bearing), bearing, capacities, com_W_m_, rotation_WB, robot_.control);
}

PerLimb<Wrench> ControlCore::balanced_on_feet(const PlanReference& reference) const noexcept {
  // Forces act at the foot points; the plan's own sum of forces stands, for a walk accelerates.
  const Vector3 below(0.0, 0.0, -robot_.gripper.pad_radius_m);
  PerLimb<Bearer> bearers;
  PerLimb<Vector3> feet_W_m;
  Vector3 total_N = Vector3::Zero();
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference.limbs[l];
    feet_W_m[l] = limbs_[l].anchor_W_m(limb) + below;
    bearers[l] = {feet_W_m[l], Vector3::Zero(), limb.load, {limb.wrench_W.force_N, {0, 0, 0}}};
    total_N += limb.wrench_W.force_N;
  }
  PerLimb<Wrench> wrenches = balanced_wrenches(bearers, com_W_m_, -total_N, 0.0);
  share_along_plane(feet_W_m, wrenches);
  for (Wrench& wrench : wrenches) wrench.moment_Nm += below.cross(wrench.force_N);
  return wrenches;
}

PerLimb<Wrench> ControlCore::wrench_errors(const PlanReference& reference, double engagement) const noexcept {
  PerLimb<Wrench> errors;
  PerLimb<Vector3> positions_W_m;
  PerLimb<double> loads{};  // none of a limb whose sensors are not believed
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference.limbs[l];
    positions_W_m[l] = limbs_[l].anchor_W_m(limb);
    if (faults_.distrusted(l) || limbs_[l].blind()) continue;
    loads[l] = load(l, limb);
    if (!faults_.lost(l) && !slips_[l].slips() && (limb.gripping() || limb.closing()))
      errors[l] = (limbs_[l].wrench_W() - wrenches_W_[l]) * engagement;
  }
  return internal_errors(errors, positions_W_m, loads, com_W_m_, robot_.control.moment_length_m);
}

void ControlCore::calibrate(double dt_s) noexcept {
  if (!calibration_ || plan_->point_feet) return;
  PerLimb<Yielding> translations, rotations;
  for (int l = 0; l < kLimbs; ++l) {
    // A limb that slips or has lost its hold is given no error: it shows nothing of its gains.
    if (slips_[l].slips() || faults_.lost(l) || faults_.distrusted(l) || limbs_[l].blind()) continue;
    translations[l] = limbs_[l].translation();
    rotations[l] = limbs_[l].rotation();
  }
  if (!calibration_->update(translations, rotations, dt_s)) return;
  for (LimbController& limb : limbs_) limb.set_gains(calibration_->gains());
}

void ControlCore::localise(const PlanReference& reference, double dt_s) noexcept {
  // Point feet find no place on the map, and learn no sensor's bias.
  if (plan_->point_feet || !started_) return;
  Vector3 force_W_N = Vector3::Zero();
  bool known = supervisor_.state() == SupervisorState::kClimbing;
  for (int l = 0; l < kLimbs; ++l) {
    if (!limbs_[l].in_contact() && !reference.limbs[l].closing()) continue;
    force_W_N += limbs_[l].wrench_W().force_N;
    known = known && limbs_[l].force_torque_tared() && !faults_.distrusted(l);
  }
  localisation_.feel(force_W_N, robot_.total_mass_kg * plan_->gravity_W_m_s2, known, dt_s);
  const Pose motion = localisation_.correction(body_.body_W().position_m, dt_s);
  body_.reset(motion * body_.body_W());
  correction_.relocate(motion, reference.body_W);
  for (int l = 0; l < kLimbs; ++l) limbs_[l].relocate(motion, reference.limbs[l]);
}

void ControlCore::control(const crux_msgs::control_input_t& in, const PlanReference& reference) noexcept {
  const double dt_s = in.dt_s;
  engaged_time_s_ += dt_s;
  const double engagement = this->engagement();

  if (!started_ && engagement >= 1.0) probe_.step(in.joint_torque_nm);
  localise(reference, dt_s);
  test_grasps(reference, dt_s);
  wrenches_W_ = shared(reference);
  Vector3 missed_W_m = Vector3::Zero();
  for (int l = 0; l < kLimbs; ++l) missed_W_m += limbs_[l].missed_W_m(reference.limbs[l]);
  if (!plan_->point_feet) correction_.make_way(missed_W_m, dt_s);
  // Before the plan has begun somebody may carry the body: an integral would only push against him.
  const Pose body_command_W = correction_.update(reference.body_W, body_.body_W(), started_ ? dt_s : 0.0);
  for (int l = 0; l < kLimbs; ++l) {
    const LimbReference& limb = reference.limbs[l];
    const bool found = limbs_[l].follow_contact(limb, body_.body_W(), body_command_W, test_.limb() == l);
    if (!found || plan_->point_feet || !limb.gripping()) continue;
    const Vector3 place_W_m = limbs_[l].anchor_W_m(limb);
    localisation_.grasp(body_.body_W().position_m, place_W_m - body_.body_W().position_m, limb.finger_axis_W(),
                        limb.finger_axis_W().dot(place_W_m - limb.gripper_position_W_m));
  }
  if (faults_.force_torque_well(in)) {
    const PerLimb<Wrench> errors = wrench_errors(reference, engagement);
    for (int l = 0; l < kLimbs; ++l) limbs_[l].comply(reference.limbs[l], errors[l], body_.body_W().rotation, dt_s);
    calibrate(dt_s);
  }
  press_holds(reference, dt_s);
  for (int l = 0; l < kLimbs; ++l) {
    limbs_[l].drive(reference.limbs[l], wrenches_W_[l], plan_->gravity_W_m_s2, body_.body_W(), engagement, dt_s);
  }
}

}  // namespace crux
