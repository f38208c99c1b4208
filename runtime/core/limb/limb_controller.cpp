#include "core/limb/limb_controller.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/limb/yielding_part.hpp"
#include "core/robot/gravity.hpp"

namespace crux {

namespace {

Wrench turned(const Wrench& wrench, const Matrix3& rotation) {
  return {rotation * wrench.force_N, rotation * wrench.moment_Nm};
}

// A limb that hung without power is that far from its way; it goes away from the wall first, above the way.
constexpr double kAstray_m = 0.04, kClear_m = 0.03;
// Share of a joint's effort by which its gear may stick: a motor's torque within that of what is expected says nothing.
constexpr double kSticks = 0.125;
// Of the torque and force that show that something is in a gripper's way: so much is left where it still is. Joints
// that give way bear now more, now less.
constexpr double kStaysBlocked = 0.5;
constexpr double kFoundLoad = 0.95;  // share of its load from which on a foot's place is known

/// The gripper still grips: it aims from the commanded body pose, and where it grips is remembered. A foot has found
/// its place when it bears its load: at the planned instant of touch-down a servo's lag still parts it from the ground.
bool on_hold(const LimbReference& reference) {
  if (reference.point_foot && reference.phase == LimbPhase::kLoad) return reference.load > kFoundLoad;
  return reference.gripping() || reference.phase == LimbPhase::kOpen;
}

}  // namespace

LimbController::LimbController(const RobotDescription& robot, int limb)
    : limb_(limb),
      control_(robot.control),
      supervisor_(robot.supervisor),
      gripper_(robot.gripper),
      servo_(robot.servo),
      transmission_(robot.limbs[limb].transmission),
      joints_(robot.limbs[limb].joints),
      actuators_(robot.limbs[limb].actuators),
      driven_(robot.limbs[limb].driven),
      kinematics_(robot.limbs[limb]),
      inverse_(robot.limbs[limb], kinematics_),
      wrench_(robot.limbs[limb], robot.force_torque, robot.control),
      encoders_(robot, limb),
      shaking_(robot, limb),
      heat_(robot.motor, robot.limbs[limb].actuators),
      admittance_(robot.admittance),
      fingers_(robot) {
  kinematics_.evaluate(q_rad_, state_);
}

void LimbController::sense(const crux_msgs::control_input_t& in) noexcept {
  encoders_.begin_cycle();
  const JointVector command_rad = transmission_.actuators_rad(command_q_rad_);
  const double since_last_s = in.dt_s + std::exchange(late_s_, in.late_s);  // reading, at most
  for (int j = 0; j < kJoints; ++j) {
    const int i = limb_ * kJoints + j;
    if (in.joint_fresh[i] == 0 || !std::isfinite(in.joint_position_rad[i]) || !std::isfinite(in.joint_torque_nm[i])) {
      encoders_.skip(j, since_last_s);
      continue;
    }
    actuators_rad_[j] = encoders_.look(j, in.joint_position_rad[i], command_rad[j], since_last_s);
    actuators_Nm_[j] = in.joint_torque_nm[i];
    // A node that has restarted has lost its feed-forward.
    if (in.joint_state[i] == static_cast<int>(NodeState::kBoot)) command_torque_Nm_[j] = 0.0;
  }
  q_rad_ = transmission_.joints_rad(actuators_rad_);
  torque_Nm_ = transmission_.joint_torque_Nm(actuators_Nm_, q_rad_);
  if (in.gripper_fresh[limb_] != 0 && std::isfinite(in.finger_opening_m[limb_]) &&
      std::isfinite(in.finger_speed_m_s[limb_]) && std::isfinite(in.finger_force_n[limb_])) {
    fingers_.see(in.finger_opening_m[limb_], in.finger_speed_m_s[limb_], in.finger_force_n[limb_]);
  }
  const Vector3 force_N(in.ft_force_g_n + 3 * limb_);
  const Vector3 moment_Nm(in.ft_moment_g_nm + 3 * limb_);
  if (in.ft_fresh[limb_] != 0 && in.ft_status[limb_] == 0 && force_N.allFinite() && moment_Nm.allFinite()) {
    if (force_N != raw_G_.force_N || moment_Nm != raw_G_.moment_Nm) borne_as_it_moved_Nm_ = borne_Nm_;
    raw_G_ = {force_N, moment_Nm};
  }
  shaking_.look(q_rad_, in.dt_s);
  kinematics_.evaluate(q_rad_, state_);
}

void LimbController::sense_wrench(const Matrix3& rotation_WB, const Vector3& gravity_W_m_s2, double dt_s) noexcept {
  wrench_.update(raw_G_, rotation_WB * state_.gripper_B.rotation, gravity_W_m_s2, dt_s);
  heat_.take(actuators_Nm_, dt_s);
  const Matrix3 rotation_BW = rotation_WB.transpose();
  const JointVector borne_Nm = torque_Nm_ - gravity_torque(state_, rotation_BW * gravity_W_m_s2);
  const JointVector unexplained_Nm = borne_Nm - contact_torque(state_, turned(wrench_.wrench_W(), rotation_BW));
  const double share = dt_s / (control_.force_filter_s + dt_s);
  borne_Nm_ += share * (borne_Nm - borne_Nm_);
  residual_Nm_ += share * (unexplained_Nm - residual_Nm_);
}

double LimbController::ft_residual_Nm() const noexcept {
  double squares = 0.0;
  for (int j = 0; j < kJoints; ++j) {
    const double sticks_Nm = kSticks * joints_[j].effort_Nm;
    const double unexplained_Nm = residual_Nm_[j] - std::clamp(residual_Nm_[j], -sticks_Nm, sticks_Nm);
    squares += unexplained_Nm * unexplained_Nm;
  }
  return std::sqrt(squares);
}

double LimbController::ft_limit_Nm(const Wrench& planned_W, const Matrix3& rotation_WB) const noexcept {
  const auto torque_Nm = [&](const Wrench& wrench_W) {
    return contact_torque(state_, turned(wrench_W, rotation_WB.transpose())).norm();
  };
  return supervisor_.max_ft_residual_Nm +
         supervisor_.max_ft_residual_share * std::max(torque_Nm(wrench_.wrench_W()), torque_Nm(planned_W));
}

void LimbController::pose_error(const LimbReference& reference, const Pose& body_W, double& distance_m,
                                double& angle_rad) const noexcept {
  const Pose gripper_W = body_W * state_.gripper_B;
  distance_m = (gripper_W.position_m - reference.gripper_position_W_m).norm();
  angle_rad = rotation_log(gripper_W.rotation * reference.gripper_rotation_W().transpose()).norm();
}

void LimbController::engage(const LimbReference& reference, const Pose& body_W, bool begun) noexcept {
  const Pose gripper_W = body_W * state_.gripper_B;
  const Vector3 off_m = gripper_W.position_m - reference.gripper_position_W_m;
  in_contact_ = on_hold(reference);
  to_touch_ = in_contact_ && !begun && !reference.foot() && !presses();
  found_ = in_contact_ && !to_touch_;
  find_turn(gripper_W.rotation, reference);
  beside_W_m_.setZero();
  back_ = reference.back;
  known_ = {};
  contact_offset_W_m_ = in_contact_ ? clamped_norm(off_m, control_.max_contact_offset_m) : Vector3::Zero();
  admittance_.reset(off_m - contact_offset_W_m_,
                    rotation_log(gripper_W.rotation * reference.gripper_rotation_W().transpose()));
  fingers_.engage();
  aim_W_ = body_W;
  goal_B_ = state_.gripper_B;
  ik_ = {};
  ik_.q_rad = q_rad_;
  // A node that holds makes its torque from the feed-forward it had and from the distance of its setpoint.
  held_torque_Nm_ = command_torque_Nm_;
  const JointVector unasked_Nm = transmission_.actuator_torque_Nm(torque_Nm_ - held_torque_Nm_, q_rad_);
  JointVector actuators_off_rad;
  for (int j = 0; j < kJoints; ++j) actuators_off_rad[j] = unasked_Nm[j] / servo_.position_gain_Nm_rad[j];
  held_offset_rad_ = transmission_.joint_ways(actuators_off_rad, q_rad_);
  encoders_.restart();
  shaking_.restart();
}

void LimbController::restore(const LimbReference& reference, bool grips, const Vector3& place_W_m, double opening_m,
                             const Wrench& tare_G) noexcept {
  wrench_.take_bias(tare_G);
  found_ = in_contact_ = grips;
  turn_found_ = false;
  contact_offset_W_m_ = grips ? Vector3(place_W_m - reference.gripper_position_W_m) : Vector3::Zero();
  fingers_.restore(opening_m);
}

void LimbController::hand_over(const LimbReference& before, const LimbReference& now, double engagement) noexcept {
  grip_at(anchor_W_m(before), target_W(before), now);
  known_ = {};
  back_ = now.back;
  held_torque_Nm_ = command_torque_Nm_;
  held_offset_rad_ *= 1.0 - engagement;
}

LimbEvents LimbController::events(const LimbReference& reference, const Pose& body_W, double dt_s) noexcept {
  const double distance_m = ((body_W * state_.gripper_B).position_m - anchor_W_m(reference)).norm();
  if (reference.point_foot) return {.unloaded = true, .opened = true, .arrived = true, .gripped = true};
  const bool unloaded = trusts_force_torque_ ? wrench_W().force_N.norm() < control_.unload_force_N
                                             : borne_Nm_.norm() < supervisor_.max_ft_residual_Nm;
  if (reference.on_foothold) {
    blocked_ = false;
    const bool stands = stands_on_foot(reference, dt_s);
    const bool arrived = stands || distance_m <= supervisor_.arrive_tolerance_m;
    return {.unloaded = unloaded, .opened = true, .arrived = arrived, .gripped = stands};
  }
  const bool on_its_way = reference.passing() || reference.phase == LimbPhase::kDescend;
  blocked_ = on_its_way && caught(blocked_ ? kStaysBlocked : 1.0);
  return {.unloaded = unloaded,
          .opened = fingers_.opened(reference),
          .arrived = fingers_.opened(reference) && distance_m <= supervisor_.arrive_tolerance_m,
          .gripped = fingers_.gripped(reference, dt_s),
          .blocked = blocked_};
}

Pose LimbController::target_W(const LimbReference& reference) const noexcept {
  return {rotation_exp(admittance_.rotation_rad()) * reference.gripper_rotation_W(),
          anchor_W_m(reference) + admittance_.offset_m()};
}

void LimbController::aim_at(const Pose& target_W, const LimbReference& reference) noexcept {
  admittance_.rebase(target_W.position_m - anchor_W_m(reference),
                     rotation_log(target_W.rotation * reference.gripper_rotation_W().transpose()));
}

/// The limb grips at `place_W_m`, and goes on aiming at `target_W`.
void LimbController::grip_at(const Vector3& place_W_m, const Pose& target_W, const LimbReference& reference) noexcept {
  contact_offset_W_m_ = clamped_norm(place_W_m - reference.gripper_position_W_m, control_.max_contact_offset_m);
  beside_W_m_.setZero();
  aim_at(target_W, reference);
}

/// A gripper on a hold stays turned as it is; a foot may turn on its point.
void LimbController::find_turn(const Matrix3& rotation_W, const LimbReference& reference) noexcept {
  grip_rotation_W_ = rotation_W;
  turn_found_ = found_ && !reference.foot();
}

bool LimbController::follow_contact(const LimbReference& reference, const Pose& body_estimate_W,
                                    const Pose& body_command_W, bool pulled) noexcept {
  const bool contact = on_hold(reference);
  const Pose aim_W = contact || pulled ? body_command_W : body_estimate_W;
  Vector3 place_W_m = gripper_W_m(body_estimate_W);
  if (reference.point_foot) place_W_m.z() = reference.gripper_position_W_m.z();  // the surface is where it is
  if (contact != in_contact_ || (!contact && reference.back != back_)) {
    // The same gripper pose seen from the body, expressed from the new aim.
    const Pose continued_W = aim_W * (aim_W_.inverse() * target_W(reference));
    const std::size_t begins = reference.back ? 1 : 0, ends = 1 - begins;
    if (contact) {
      known_[ends] = {};
      if (!reference.on_foothold) fingers_.grip();
    } else {
      // Fingers that turn back before they have left close where they are.
      if (in_contact_) {
        known_[reference.closing() ? ends : begins] = {true, reference.gripper_position_W_m, anchor_W_m(reference)};
      }
      place_W_m = reference.gripper_position_W_m + known_[ends].offset_m();
    }
    grip_at(place_W_m, continued_W, reference);
    admittance_.reset(admittance_.offset_m(), admittance_.rotation_rad());
    in_contact_ = contact;
    back_ = reference.back;
    found_ = turn_found_ = false;
  } else if (pulled != pulled_) {
    aim_at(aim_W * (aim_W_.inverse() * target_W(reference)), reference);
  }
  pulled_ = pulled;
  aim_W_ = aim_W;
  if (!contact || found_) return false;
  to_touch_ = to_touch_ && !presses();
  found_ = reference.point_foot || (reference.phase != LimbPhase::kLoad && !to_touch_);
  if (!reference.point_foot) grip_at(place_W_m, target_W(reference), reference);
  if (found_) find_turn(body_estimate_W.rotation * state_.gripper_B.rotation, reference);
  return found_;
}

void LimbController::aim_beside(const Vector3& beside_W_m, const LimbReference& reference) noexcept {
  const Pose target_W = this->target_W(reference);
  beside_W_m_ = beside_W_m;
  admittance_.rebase(target_W.position_m - anchor_W_m(reference), admittance_.rotation_rad());
}

void LimbController::relocate(const Pose& motion, const LimbReference& reference) noexcept {
  for (KnownHold& hold : known_) hold.found_W_m = motion * hold.found_W_m;
  if (!in_contact_ && !pulled_) {
    contact_offset_W_m_ = known_[back_ ? 0 : 1].offset_m();
    return;
  }
  const Pose target_W = motion * this->target_W(reference);
  const Vector3 anchor_W_m = this->anchor_W_m(reference);
  contact_offset_W_m_ += motion * anchor_W_m - anchor_W_m;
  grip_rotation_W_ = motion.rotation * grip_rotation_W_;
  aim_at(target_W, reference);
  aim_W_ = motion * aim_W_;
}

Capacity LimbController::capacity(const Contact& contact, const Matrix3& rotation_WB,
                                  const Vector3& gravity_W_m_s2) const noexcept {
  Capacity capacity{contact, &state_, gravity_torque(state_, rotation_WB.transpose() * gravity_W_m_s2)};
  for (int j = 0; j < kJoints; ++j) capacity.max_torque_Nm[j] = heat_.allowed_Nm(j);
  if (!transmission_.direct()) {
    JointVector efforts_Nm;
    for (int j = 0; j < kJoints; ++j) efforts_Nm[j] = joints_[j].effort_Nm;
    capacity.max_torque_Nm = transmission_.within_torques(efforts_Nm, capacity.max_torque_Nm, q_rad_);
  }
  return capacity;
}

void LimbController::comply(const LimbReference& reference, const Wrench& all_W, const Matrix3& rotation_WB,
                            double dt_s) noexcept {
  const Matrix3 rotation_BW = rotation_WB.transpose();
  const Wrench error_W =
      driven_ >= kPlacing
          ? all_W
          : turned(yielding_part(state_, turned(all_W, rotation_BW), admittance_.parameters()), rotation_WB);
  const bool follows = (ik_.limited & kIkNoConvergence) == 0;
  translation_ = {reference.gripping() && follows, error_W.force_N, admittance_.offset_m(), Vector3::Zero()};
  rotation_ = {translation_.counts, error_W.moment_Nm, admittance_.rotation_rad(), Vector3::Zero()};
  if (reference.gripping() || reference.closing()) {
    admittance_.step(error_W, dt_s, follows);
    translation_.speed = admittance_.speed_m_s();
    rotation_.speed = admittance_.rate_rad_s();
    return;
  }
  // A gripper that runs against something bears a force, which is no bias; its joints tell.
  // A foot that comes down early yields to its surface, whatever its joints show of it.
  const bool lands = reference.on_foothold && reference.phase == LimbPhase::kDescend && trusts_force_torque_ &&
                     foot_force_N(reference) >= control_.contact_force_N;
  const bool runs_against = !reference.point_foot && (lands || this->runs_against());
  Vector3 felt_N = runs_against ? wrench_W().force_N : Vector3::Zero();
  // What it runs against from the side, in passing over, stands out further than planned, or the gripper is lower than
  // it seems: it goes over it. A finger that still rubs on the hold it leaves would only be pulled along that.
  const bool passes = reference.passing() && reference.phase != LimbPhase::kLift;
  if (passes) felt_N.z() += felt_N.head<2>().norm();
  if (reference.phase != LimbPhase::kOpen) {
    const Vector3 before_m = admittance_.offset_m();
    const bool too_low = before_m.z() < kClear_m;
    const bool rises = !reference.point_foot && too_low && before_m.head<2>().norm() > kAstray_m;
    if (rises) felt_N.z() += admittance_.parameters().damping_Ns_m * admittance_.parameters().max_speed_m_s;
    admittance_.fade(felt_N, control_.swing_decay_s, dt_s);
    if (rises) admittance_.rebase({before_m.x(), before_m.y(), admittance_.offset_m().z()}, admittance_.rotation_rad());
    // What has touched its surface goes no further down.
    const Vector3 off_W = reference.off_W();
    const double sinks_m = off_W.dot((aim_W_ * goal_B_).position_m - target_W(reference).position_m);
    if (lands && sinks_m > 0.0)
      admittance_.rebase(admittance_.offset_m() + sinks_m * off_W, admittance_.rotation_rad());
    // A hold that stands out of the wall further than planned is passed at the planned height above where it was
    // gripped; and beside it the gripper rises as long as it is pushed, whatever rubs.
    const AdmittanceParameters& gains = admittance_.parameters();
    const Vector3& offset_m = admittance_.offset_m();
    const double rises_m = std::min(felt_N.head<2>().norm() / gains.damping_Ns_m, gains.max_speed_m_s) * dt_s;
    const double least_m = std::min(before_m.z() + rises_m, std::max(before_m.z(), gains.max_offset_m));
    if (passes && offset_m.z() < least_m)
      admittance_.rebase({offset_m.x(), offset_m.y(), least_m}, admittance_.rotation_rad());
  }
  const bool free = reference.phase == LimbPhase::kSwing && !reference.point_foot && !runs_against &&
                    fingers_.force_N() < 0.2 * control_.contact_force_N;
  if (free) wrench_.tare(rotation_WB * state_.gripper_B.rotation, dt_s);
}

void LimbController::drive(const LimbReference& reference, const Wrench& wrench_W, const Vector3& gravity_W_m_s2,
                           const Pose& body_estimate_W, double engagement, double dt_s) noexcept {
  // A joint whose encoder has frozen goes further with every command, and nobody sees it.
  if (rigid()) {
    aim_at(aim_W_ * goal_B_, reference);
    return stay_at(command_q_rad_);
  }
  const JointVector last_rad = ik_.q_rad;
  goal_B_ = aim_W_.inverse() * target_W(reference);
  ik_ = inverse_.step(goal_B_, last_rad, dt_s);
  // The nodes follow x += (1 − exp(−dt/T))·(u − x); to come out at x, u leads by what is left of the last step.
  const double time_constant_s = servo_.setpoint_time_constant_s;
  const double left = time_constant_s > 0.0 ? 1.0 / (1.0 - std::exp(-dt_s / time_constant_s)) - 1.0 : 0.0;
  const JointVector last_dq_rad_s = command_dq_rad_s_;
  command_dq_rad_s_ = (ik_.q_rad - last_rad) / dt_s;
  setpoint_lead_rad_ = left * (ik_.q_rad - last_rad);
  velocity_lead_rad_s_ = left * (command_dq_rad_s_ - last_dq_rad_s);
  command_q_rad_ = ik_.q_rad + (1.0 - engagement) * held_offset_rad_;
  for (JointVector* command : {&command_q_rad_, &command_dq_rad_s_, &setpoint_lead_rad_, &velocity_lead_rad_s_})
    command->tail(kJoints - driven_).setZero();

  const Matrix3 rotation_BW = body_estimate_W.rotation.transpose();
  JointVector model_Nm =
      gravity_torque(state_, rotation_BW * gravity_W_m_s2) + contact_torque(state_, turned(wrench_W, rotation_BW));
  JointVector friction_Nm = transmission_.actuator_ways(command_dq_rad_s_, q_rad_);
  for (int j = 0; j < kJoints; ++j) friction_Nm[j] = servo_.damping_Nms_rad[j] * friction_Nm[j];
  model_Nm += transmission_.joint_torque_Nm(friction_Nm, q_rad_);
  JointVector actuators_Nm =
      transmission_.actuator_torque_Nm(held_torque_Nm_ + engagement * (model_Nm - held_torque_Nm_), q_rad_);
  for (int j = 0; j < kJoints; ++j)
    actuators_Nm[j] = std::clamp(actuators_Nm[j], -actuators_[j].effort_Nm, actuators_[j].effort_Nm);
  command_torque_Nm_ = transmission_.joint_torque_Nm(actuators_Nm, q_rad_);
}

double LimbController::torque_share() const noexcept {
  double share = 0.0;
  for (int j = 0; j < kJoints; ++j) share = std::max(share, std::abs(actuators_Nm_[j]) / actuators_[j].effort_Nm);
  return share;
}

void LimbController::stay_at(const JointVector& q_rad) noexcept {
  command_q_rad_ = q_rad;
  command_dq_rad_s_.setZero();
  setpoint_lead_rad_.setZero();
  velocity_lead_rad_s_.setZero();
  ik_ = {};
  ik_.q_rad = q_rad;
}

Vector3 LimbController::missed_W_m(const LimbReference& reference) const noexcept {
  const bool kept = reference.gripping() && (ik_.limited & kIkPositionLimit) != 0;
  return kept ? Vector3(aim_W_.rotation * ik_.missed_B_m) : Vector3::Zero();
}

double LimbController::tracking_error_rad(int& joint) const noexcept {
  return (q_rad_ - command_q_rad_).cwiseAbs().maxCoeff(&joint);
}

}  // namespace crux
