#include "fixture.hpp"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <cmath>
#include <stdexcept>

#include "core/robot/gravity.hpp"
#include "core/robot/hash.hpp"
#include "core/robot/inverse_kinematics.hpp"
#include "core/robot/node_protocol.hpp"
#include "core/robot/robot_reader.hpp"

namespace crux_test {
namespace {

using crux_msgs::limb_knot_t;

constexpr double kHalfHold_m = 0.03;
constexpr double kOpen_m = 0.045;
constexpr double kPad_m = 0.035;
constexpr double kLift_m = 0.11;
constexpr double kDt_s = 2.0;
constexpr double kBodyHeight_m = 0.185;
constexpr double kSqueeze_N = 20.0;
constexpr int kHoldOfLf = 4;

Vector3 hold_position(int hold) {
  const double x = hold == kHoldOfLf ? 0.20 : (hold < 2 ? 0.14 : -0.14);
  return {x, hold % 2 == 0 ? 0.36 : -0.36, kPad_m};
}

double hold_yaw(int hold) { return 0.05 * (hold - 2); }

struct LimbPlan {
  Vector3 position_m;
  double yaw_rad;
  int hold;  ///< -1 in the air
};

/// Least forces of the limbs on holds that carry the robot's weight about the body's origin.
Eigen::VectorXd carrying_forces(const std::vector<LimbPlan>& limbs, const Vector3& body_m, const Vector3& gravity) {
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(6, 3 * static_cast<int>(limbs.size()));
  for (int l = 0; l < static_cast<int>(limbs.size()); ++l) {
    if (limbs[l].hold < 0) continue;
    map.block<3, 3>(0, 3 * l).setIdentity();
    map.block<3, 3>(3, 3 * l) = skew(limbs[l].position_m - body_m);
  }
  Eigen::VectorXd load = Eigen::VectorXd::Zero(6);
  load.head<3>() = -robot().total_mass_kg * gravity;
  return map.completeOrthogonalDecomposition().solve(load);
}

crux_msgs::plan_knot_t knot(double time_s, const Vector3& body_m, const std::vector<LimbPlan>& limbs,
                            const Vector3& gravity) {
  crux_msgs::plan_knot_t knot{};
  knot.time_s = time_s;
  std::copy(body_m.data(), body_m.data() + 3, knot.body_position_w_m);
  const Eigen::VectorXd forces = carrying_forces(limbs, body_m, gravity);
  for (int l = 0; l < kLimbs; ++l) {
    limb_knot_t& limb = knot.limbs[l];
    const bool air = limbs[l].hold < 0;
    limb.phase = air ? limb_knot_t::AIR : limb_knot_t::STANCE;
    limb.hold = static_cast<std::int16_t>(limbs[l].hold);
    limb.finger1_face = air ? limb_knot_t::FACE_NONE : limb_knot_t::FACE_PLUS_X;
    limb.friction = air ? 0.0 : 2.2;
    std::copy(limbs[l].position_m.data(), limbs[l].position_m.data() + 3, limb.gripper_position_w_m);
    limb.gripper_yaw_w_rad = limbs[l].yaw_rad;
    limb.finger_separation_m = 2.0 * (air ? kOpen_m : kHalfHold_m);
    if (air) continue;
    const Vector3 axis = rotation_z(limbs[l].yaw_rad).col(0);
    for (int finger = 0; finger < 2; ++finger) {
      const Vector3 force = 0.5 * forces.segment<3>(3 * l) + (finger == 0 ? kSqueeze_N : -kSqueeze_N) * axis;
      std::copy(force.data(), force.data() + 3, limb.finger_force_w_n + 3 * finger);
    }
  }
  return knot;
}

}  // namespace

const RobotDescription& robot() {
  static const Result<RobotDescription> loaded = load_robot(CRUX_ROBOT);
  if (!loaded) throw std::runtime_error(loaded.reason());
  return loaded.value();
}

JointVector standing_angles() {
  JointVector q;
  q << 0.1, 0.9, 1.9, 1.0, 0.05, 0.0, 0.0;
  return q;
}

JointVector random_angles(Random& random, double spread) {
  JointVector q = standing_angles();
  for (int j = 0; j < kPlacing; ++j) q[j] += random.uniform(-spread, spread);
  return q;
}

void sign(crux_msgs::plan_t& plan) {
  plan.n_knots = static_cast<std::int32_t>(plan.knots.size());
  plan.n_holds = static_cast<std::int32_t>(plan.holds.size());
  plan.plan_id.clear();
  std::string bytes(static_cast<std::size_t>(plan.getEncodedSize()), '\0');
  plan.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  plan.plan_id = sha256_hex(bytes);
}

crux_msgs::plan_t sample_plan() {
  crux_msgs::plan_t plan{};
  plan.format = crux_msgs::plan_t::FORMAT;
  plan.robot_name = robot().name;
  plan.robot_sha256 = robot().sha256;
  plan.dt_s = kDt_s;
  const Vector3 gravity(-9.81 * std::sqrt(0.5), 0.0, -9.81 * std::sqrt(0.5));
  std::copy(gravity.data(), gravity.data() + 3, plan.gravity_w_m_s2);
  plan.patch_k_m = 0.0134;
  plan.max_normal_n = 60.0;
  plan.holds.resize(5);
  for (crux_msgs::hold_t& hold : plan.holds) hold = crux_msgs::hold_t{};

  std::vector<LimbPlan> limbs;
  for (int l = 0; l < kLimbs; ++l) limbs.push_back({hold_position(l), hold_yaw(l), l});
  const Vector3 start(0.0, 0.0, kBodyHeight_m), aside(-0.02, -0.03, kBodyHeight_m);
  const auto add = [&](const Vector3& body_m) {
    plan.knots.push_back(knot(kDt_s * static_cast<double>(plan.knots.size()), body_m, limbs, gravity));
  };
  add(start);
  add(start);
  add(aside);
  LimbPlan& lf = limbs[0];
  lf.hold = -1;
  add(aside);  // lets go here
  lf.position_m.z() = kLift_m;
  add(aside);
  lf.position_m = hold_position(kHoldOfLf) + Vector3(0.0, 0.0, kLift_m - kPad_m);
  lf.yaw_rad = hold_yaw(kHoldOfLf);
  add(aside);
  lf = {hold_position(kHoldOfLf), hold_yaw(kHoldOfLf), kHoldOfLf};
  add(aside);
  add(aside);
  add(start + Vector3(0.01, 0.0, 0.0));
  sign(plan);
  return plan;
}

double setpoint_share(double dt_s) { return 1.0 - std::exp(-dt_s / robot().servo.setpoint_time_constant_s); }

void loosen(crux_msgs::control_input_t& in, int limb) {
  constexpr double kLeft_N = 0.5;
  in.finger_opening_m[limb] -= (in.finger_force_n[limb] - kLeft_N) / robot().gripper.stiffness_N_m;
  in.finger_force_n[limb] = kLeft_N;
}

ObedientPlant::ObedientPlant(const crux_msgs::plan_t& plan) : plan_(plan) {
  input_.dt_s = 1.0 / robot().can.rate_Hz;
  std::fill(std::begin(input_.joint_fresh), std::end(input_.joint_fresh), 1);
  std::fill(std::begin(input_.gripper_fresh), std::end(input_.gripper_fresh), 1);
  std::fill(std::begin(input_.ft_fresh), std::end(input_.ft_fresh), 1);
  const crux_msgs::plan_knot_t& start = plan.knots.front();
  for (int l = 0; l < kLimbs; ++l) {
    LimbKinematics kinematics(robot().limbs[l]);
    InverseKinematics inverse(robot().limbs[l], kinematics);
    const Vector3 gripper_B_m = Vector3(start.limbs[l].gripper_position_w_m) - Vector3(start.body_position_w_m);
    const Pose target = {rotation_z(start.limbs[l].gripper_yaw_w_rad), gripper_B_m};
    const IkResult result = inverse.solve(target, standing_angles(), 100);
    for (int j = 0; j < kJoints; ++j) input_.joint_position_rad[l * kJoints + j] = result.q_rad[j];
    input_.finger_opening_m[l] = kHalfHold_m;
    input_.finger_force_n[l] = kSqueeze_N;
  }
}

bool ObedientPlant::on_hold(int limb, const Vector3& gripper_W_m) const {
  const auto near = [&](int hold) { return (gripper_W_m - hold_position(hold)).norm() < 0.01; };
  return near(limb) || (limb == 0 && near(kHoldOfLf));
}

void ObedientPlant::obey(const CycleResult& result) {
  ++input_.cycle;
  for (int i = 0; i < kAllJoints; ++i) {
    const auto mode = static_cast<NodeMode>(result.output.joint_mode[i]);
    const bool tracks = mode == NodeMode::kTrack && (input_.joint_faults[i] & kFaultCommandTimeout) == 0;
    if (tracks) {
      input_.joint_position_rad[i] +=
          setpoint_share(input_.dt_s) * (result.output.joint_position_rad[i] - input_.joint_position_rad[i]);
      input_.joint_torque_nm[i] = result.output.joint_torque_nm[i];
    }
    if (mode == NodeMode::kRearm) input_.joint_faults[i] = 0;
    input_.joint_state[i] = static_cast<std::int8_t>(tracks ? NodeState::kTrack : NodeState::kHold);
  }
  const Vector3 gravity(plan_.gravity_w_m_s2);
  for (int l = 0; l < kLimbs; ++l) {
    const auto mode = static_cast<NodeMode>(result.output.gripper_mode[l]);
    const bool tracks = mode == NodeMode::kTrack && (input_.gripper_faults[l] & kFaultCommandTimeout) == 0;
    if (mode == NodeMode::kRearm) input_.gripper_faults[l] = 0;
    input_.gripper_state[l] = static_cast<std::int8_t>(tracks ? NodeState::kTrack : NodeState::kHold);
    const crux_msgs::limb_telemetry_t& limb = result.telemetry[l];
    if (tracks) {
      const double command_m = result.output.finger_opening_m[l];
      const bool held = on_hold(l, Vector3(limb.gripper_position_w_m)) && command_m < kHalfHold_m;
      input_.finger_opening_m[l] = held ? kHalfHold_m : command_m;
      input_.finger_force_n[l] = held ? robot().gripper.stiffness_N_m * (kHalfHold_m - command_m) : 0.0;
    }
    const double* q = limb.gripper_quaternion_w;
    const Matrix3 rotation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
    const Vector3 weight = robot().limbs[l].hand_mass_kg * gravity;
    const Vector3 arm = rotation * robot().limbs[l].hand_com_G_m;
    const Vector3 force = rotation.transpose() * (Vector3(limb.force_reference_w_n) + weight);
    const Vector3 moment = rotation.transpose() * (Vector3(limb.moment_reference_w_nm) + arm.cross(weight));
    std::copy(force.data(), force.data() + 3, input_.ft_force_g_n + 3 * l);
    std::copy(moment.data(), moment.data() + 3, input_.ft_moment_g_nm + 3 * l);
  }
}

void ObedientPlant::press(int limb, const CycleResult& result, const Vector3& at_W_m, const Vector3& force_W_N) {
  const double* q = result.telemetry[limb].gripper_quaternion_w;
  const Matrix3 rotation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
  const Vector3 moment_W_Nm = at_W_m.cross(force_W_N);
  LimbState state;
  LimbKinematics(robot().limbs[limb]).evaluate(JointVector(input_.joint_position_rad + kJoints * limb), state);
  const JointVector torque_Nm = contact_torque(state, {force_W_N, moment_W_Nm});
  for (int j = 0; j < kJoints; ++j) input_.joint_torque_nm[kJoints * limb + j] += torque_Nm[j];
  for (int a = 0; a < 3; ++a) {
    input_.ft_force_g_n[3 * limb + a] += (rotation.transpose() * force_W_N)[a];
    input_.ft_moment_g_nm[3 * limb + a] += (rotation.transpose() * moment_W_Nm)[a];
  }
}

Climber::Climber(const crux_msgs::plan_t& plan, const RobotDescription& climbs) : core(climbs), plant(plan) {
  const std::string reason = core.load_plan(plan);
  if (!reason.empty()) throw std::runtime_error(reason);
}

const CycleResult& Climber::step(int command) {
  plant.input().operator_command = static_cast<std::int8_t>(command);
  core.step(plant.input(), result);
  plant.obey(result);
  return result;
}

const CycleResult& Climber::steps(int n) {
  for (int i = 0; i < n; ++i) step();
  return result;
}

void Climbing::SetUp() {
  ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
  run_.steps(1000);
  run_.step(crux_msgs::command_t::START);
  run_.steps(150);
  ASSERT_GT(run_.result.state.plan_time_s, 0.1);
}

bool Climber::until(SupervisorState state, int n) {
  for (int i = 0; i < n && core.state() != state; ++i) step();
  return core.state() == state;
}

}  // namespace crux_test
