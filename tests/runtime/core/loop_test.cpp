// The closed loop of the core, seen from outside: what it does with wrench errors, bias, load and reach.
#include <Eigen/Geometry>

#include "core/plan/plan_preparation.hpp"
#include "core/robot/gravity.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

class Loop : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(run_.until(SupervisorState::kReady, 20));
    run_.steps(1000);
  }
  /// Adds a force [N] in W to what the sensor of a limb reads next.
  void add_force_W(int limb, const Vector3& force_W_N) {
    const double* q = run_.result.telemetry[limb].gripper_quaternion_w;
    const Vector3 force_G_N = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).conjugate() * force_W_N;
    for (int i = 0; i < 3; ++i) run_.plant.input().ft_force_g_n[3 * limb + i] += force_G_N[i];
  }
  Vector3 offset_m(int limb) const { return Vector3(run_.result.telemetry[limb].admittance_offset_m); }
  Vector3 gripper_W_m(int limb) const { return Vector3(run_.result.telemetry[limb].gripper_position_w_m); }

  Climber run_{sample_plan()};
};

/// Somebody holds the robot to the wall before the plan begins, and its limbs sag under their own weight.
class Held : public testing::Test {
 protected:
  void hold(int cycles, bool presses) {
    for (int i = 0; i < cycles; ++i) {
      for (int l = 0; l < kLimbs; ++l) {
        if (!presses) loosen(run_.plant.input(), l);
        run_.plant.input().joint_position_rad[kJoints * l + 1] += kSags_rad;
      }
      run_.step();
    }
  }
  double most_borne_N() const {
    double most_N = 0.0;
    for (const auto& limb : run_.result.telemetry) most_N = std::max(most_N, Vector3(limb.force_reference_w_n).norm());
    return most_N;
  }
  double body_off_m() const {
    const crux_msgs::robot_state_t& state = run_.result.state;
    return (Vector3(state.body_position_w_m) - Vector3(state.body_reference_position_w_m)).norm();
  }

  static constexpr double kSags_rad = 0.001;  // more in each cycle; the nodes take a part of it back
  Climber run_{sample_plan()};
};

TEST_F(Held, LimbsBearNothingBeforeTheirFingersPress) {
  hold(400, false);
  ASSERT_EQ(run_.core.state(), SupervisorState::kReady);
  EXPECT_LT(most_borne_N(), 3.0) << "half a newton of squeeze bears little";
  hold(400, true);
  EXPECT_GT(most_borne_N(), 20.0);
}

TEST_F(Held, TheirPlacesAreWhereTheFingersBeginToPress) {
  hold(400, false);
  EXPECT_LT(body_off_m(), 1e-6) << "limbs that sag in the air say nothing of the body";
  hold(400, true);
  EXPECT_LT(body_off_m(), 2e-4);
}

TEST_F(Loop, LimbsYieldToASqueezeBetweenThem) {
  const Vector3 line = (gripper_W_m(1) - gripper_W_m(0)).normalized();
  const Vector3 before = offset_m(0), other = offset_m(1);
  for (int i = 0; i < 60; ++i) {  // 0.12 s: the holds push limbs 0 and 1 together, and give way, but not as in a slip
    add_force_W(0, 2.0 * line);
    add_force_W(1, -2.0 * line);
    run_.step();
  }
  const double expected_m = 2.0 / robot().admittance.damping_Ns_m * 0.12;
  EXPECT_NEAR((offset_m(0) - before).dot(line), expected_m, 0.2 * expected_m);
  EXPECT_NEAR((offset_m(1) - other).dot(line), -expected_m, 0.2 * expected_m);
}

TEST_F(Loop, ACommonErrorOfAllLimbsMovesNothing) {
  PerLimb<Vector3> before;
  for (int l = 0; l < kLimbs; ++l) before[l] = offset_m(l);
  for (int i = 0; i < 500; ++i) {
    for (int l = 0; l < kLimbs; ++l) add_force_W(l, {2.0, 1.0, -1.0});
    run_.step();
  }
  // 2.4 N would have carried a limb 6 mm in that second. A small moment about the centre of mass remains of it.
  for (int l = 0; l < kLimbs; ++l) EXPECT_LT((offset_m(l) - before[l]).norm(), 1.5e-3) << "limb " << l;
}

TEST_F(Loop, ReferencesHoldTheRobotsWeightInEveryPhase) {
  run_.step(command_t::START);
  const Vector3 gravity(sample_plan().gravity_w_m_s2);
  for (int i = 0; i < 12000; ++i) {
    run_.step();
    Vector3 force = Vector3::Zero(), moment = Vector3::Zero();
    for (int l = 0; l < kLimbs; ++l) {
      const crux_msgs::limb_telemetry_t& limb = run_.result.telemetry[l];
      const Vector3 arm = gripper_W_m(l) - Vector3(run_.result.state.centre_of_mass_w_m);
      force += Vector3(limb.force_reference_w_n);
      moment += arm.cross(Vector3(limb.force_reference_w_n)) + Vector3(limb.moment_reference_w_nm);
    }
    ASSERT_LT((force + 9.6 * gravity).norm(), 1e-3) << "cycle " << i;
    ASSERT_LT(moment.norm(), 0.1) << "cycle " << i;  // planned places against measured ones: a millimetre of 94 N
  }
}

TEST_F(Loop, TheGraspIsNeverWeakerThanTheLoadDemands) {
  run_.step(command_t::START);
  for (int i = 0; i < 12000; ++i) {
    run_.step();
    for (int l = 0; l < kLimbs; ++l) {
      const crux_msgs::limb_reference_t& reference = run_.result.reference[l];
      if (reference.load < 0.05 || run_.result.state.plan_time_s == 0.0) continue;
      const crux_msgs::limb_telemetry_t& limb = run_.result.telemetry[l];
      const Wrench wrench = {Vector3(limb.force_reference_w_n), Vector3(limb.moment_reference_w_nm)};
      const Vector3 axis = rotation_z(reference.gripper_yaw_w_rad).col(0);
      const Contact contact = {reference.friction, 0.0134, 60.0, reference.finger_opening_m};
      const double demand_N = required_grasp_force_N(wrench, axis, contact, robot().control);
      ASSERT_GT(limb.grasp_force_n, demand_N - 0.25) << "limb " << l << " at " << run_.result.state.plan_time_s << " s";
    }
  }
}

TEST_F(Loop, TheGraspPressesForWhatItsSensorFeelsToo) {
  // 1 Nm across the fingers that no plan asked for.
  const crux_msgs::limb_telemetry_t& limb = run_.result.telemetry[1];
  const double before_N = limb.grasp_force_n;
  for (int i = 0; i < 1000; ++i) {
    run_.plant.input().ft_moment_g_nm[3 * 1 + 2] += 1.0;
    run_.step();
  }
  const crux_msgs::limb_reference_t& reference = run_.result.reference[1];
  const double friction = robot().control.trusted_friction * reference.friction;
  const Contact contact = {friction, 0.0134, 60.0, reference.finger_opening_m};
  const Wrench felt = {Vector3(limb.force_w_n), Vector3(limb.moment_w_nm)};
  const Vector3 axis = rotation_z(reference.gripper_yaw_w_rad).col(0);
  EXPECT_NEAR(limb.grasp_force_n, required_grasp_force_N(felt, axis, contact, robot().control), 0.25);
  EXPECT_GT(limb.grasp_force_n, before_N + 2.0);
  // A sensor that fails keeps the squeeze it asked for: no grip grows weaker because something else failed.
  const double felt_N = limb.grasp_force_n;
  run_.plant.input().ft_fresh[1] = 0;
  run_.steps(500);
  EXPECT_GE(limb.grasp_force_n, felt_N - 0.25);
}

TEST_F(Loop, AGripperInTheAirGivesWayToWhatItRunsAgainst) {
  run_.step(command_t::START);
  const auto swings = [&] { return run_.result.reference[0].phase == static_cast<int>(LimbPhase::kSwing); };
  for (int i = 0; i < 6000 && !swings(); ++i) run_.step();
  ASSERT_TRUE(swings());
  const Vector3 push_N(0.0, 6.0, 15.0);
  const auto given_way_m = [&](int cycles, bool joints_feel_it) {
    const Vector3 before_m = offset_m(0);
    for (int i = 0; i < cycles; ++i) {
      add_force_W(0, push_N);
      LimbKinematics kinematics(robot().limbs[0]);
      LimbState limb;
      kinematics.evaluate(JointVector(run_.plant.input().joint_position_rad), limb);
      const JointVector felt_Nm = contact_torque(limb, {push_N, Vector3::Zero()});
      for (int j = 0; j < kJoints && joints_feel_it; ++j) run_.plant.input().joint_torque_nm[j] += felt_Nm[j];
      run_.step();
    }
    return (offset_m(0) - before_m).z();
  };
  EXPECT_LT(given_way_m(10, false), 1e-4) << "on the word of one sensor";
  // A second on, against the spring that lets offsets fade; what pushes from the side it goes over.
  const double spring_N_m = robot().admittance.damping_Ns_m / robot().control.swing_decay_s;
  const double at_s = run_.result.state.plan_time_s;
  EXPECT_NEAR(given_way_m(500, true), (1.0 - std::exp(-2.0)) * (push_N.z() + push_N.head<2>().norm()) / spring_N_m,
              2e-3);
  EXPECT_LT(run_.result.state.plan_time_s, at_s + 0.3) << "the clock would press it further";
  // The offset fades, but for the height above the wall that the gripper has come to.
  const Vector3 before_m = offset_m(0);
  run_.steps(250);
  ASSERT_TRUE(swings());
  EXPECT_GT(run_.result.state.plan_time_s, at_s + 0.25);
  EXPECT_NEAR(offset_m(0).z(), before_m.z(), 1e-3);
  EXPECT_NEAR(offset_m(0).y(), std::exp(-1.0) * before_m.y(), 5e-4);
}

TEST_F(Loop, TheSensorsBiasIsLearntInTheSwing) {
  run_.step(command_t::START);
  const auto spoiled_step = [&] {
    run_.plant.input().ft_force_g_n[1] += 0.8;
    run_.plant.input().ft_moment_g_nm[2] += 0.03;
    run_.step();
  };
  run_.steps(3400);  // a force that is not there would move the gripper on this plant's hold
  for (int i = 0; i < 100; ++i) spoiled_step();
  EXPECT_EQ(run_.result.telemetry[0].tare_force_g_n[1], 0.0) << "not before the swing";
  for (int i = 0; i < 3000; ++i) spoiled_step();
  EXPECT_NEAR(run_.result.telemetry[0].tare_force_g_n[1], 0.8, 0.01);
  EXPECT_NEAR(run_.result.telemetry[0].tare_moment_g_nm[2], 0.03, 1e-3);
}

TEST(LimbController, CommandsLeadByWhatTheNodesFilterLags) {
  // A gripper swings on a sine; after the nodes' filter of positions it is where it is to be, and moves as fast.
  const crux_msgs::plan_t plan = sample_plan();
  const auto prepared = prepare_plan(robot(), plan);
  ASSERT_TRUE(prepared);
  LimbReference reference = play(*prepared.value(), {0, 0.0}).limbs[1];
  reference.phase = LimbPhase::kSwing;
  const Vector3 middle = reference.gripper_position_W_m;
  const Pose body = {Matrix3::Identity(), {0.0, 0.0, 0.185}};
  LimbController limb(robot(), 1);
  ObedientPlant plant(plan);
  limb.sense(plant.input());
  limb.engage(reference, body, true);
  LimbKinematics kinematics(robot().limbs[1]);
  const double dt_s = 0.002, share = setpoint_share(dt_s);
  JointVector setpoint, velocity = JointVector::Zero(), before;
  for (int j = 0; j < kJoints; ++j) setpoint[j] = plant.input().joint_position_rad[kJoints + j];
  double farthest_m = 0.0, largest_rad_s = 0.0;
  for (int i = 1; i < 500; ++i) {
    reference.gripper_position_W_m = middle + Vector3(0.02 * std::sin(6.0 * i * dt_s), 0.0, 0.01 * i * dt_s);
    limb.follow_contact(reference, body, body, false);
    limb.drive(reference, {}, Vector3(0.0, 0.0, -9.81), body, 1.0, dt_s);
    crux_msgs::control_output_t out{};
    limb.write(NodeMode::kTrack, NodeMode::kTrack, out);
    before = setpoint;
    for (int j = 0; j < kJoints; ++j) {
      setpoint[j] += share * (out.joint_position_rad[kJoints + j] - setpoint[j]);
      velocity[j] += share * (out.joint_velocity_rad_s[kJoints + j] - velocity[j]);
    }
    if (i < 50) continue;  // it starts with a jolt
    Pose gripper_B;
    LimbJacobian jacobian_B;
    kinematics.evaluate(setpoint, gripper_B, jacobian_B);
    farthest_m = std::max(farthest_m, ((body * gripper_B).position_m - reference.gripper_position_W_m).norm());
    largest_rad_s = std::max(largest_rad_s, (velocity - (setpoint - before) / dt_s).cwiseAbs().maxCoeff());
  }
  EXPECT_LT(farthest_m, 1e-4);  // 0.12 m/s · 20 ms = 2.4 mm without the lead
  EXPECT_LT(largest_rad_s, 1e-2);
}

/// Joint commands of a limb whose fingers have closed, after the body has moved by `moved_m` as it is estimated.
JointVector commands_as_the_body_moves(bool pulled, const Vector3& moved_m) {
  LimbController limb(robot(), 0);
  const crux_msgs::control_input_t in = ObedientPlant(sample_plan()).input();
  const Pose body_W = {Matrix3::Identity(), {0.0, 0.0, 0.185}};
  const crux_msgs::limb_knot_t start = sample_plan().knots[0].limbs[0];
  LimbReference reference;
  reference.phase = LimbPhase::kClose;
  reference.gripper_position_W_m = Vector3(start.gripper_position_w_m);
  reference.gripper_yaw_W_rad = start.gripper_yaw_w_rad;
  limb.sense(in);
  limb.engage(reference, body_W, true);
  const auto commands_rad = [&](const Vector3& off_m, bool pulls) {
    limb.follow_contact(reference, {body_W.rotation, body_W.position_m + off_m}, body_W, pulls);
    limb.drive(reference, {}, {0.0, 0.0, -9.81}, body_W, 1.0, 0.002);
    crux_msgs::control_output_t out{};
    limb.write(NodeMode::kTrack, NodeMode::kTrack, out);
    return JointVector(out.joint_position_rad);
  };
  for (int i = 0; i < 50; ++i) commands_rad(Vector3::Zero(), false);  // it starts with a jolt
  const JointVector closed_rad = commands_rad(Vector3::Zero(), false);
  return commands_rad(moved_m, pulled) - closed_rad;
}

TEST(LimbController, AimsFromTheCommandedBodyFromThePullOn) {
  // Of a body that seems to move a pulled limb takes no notice: behind the joints' lag it would drive it on.
  const Vector3 moved_m(0.0, 0.0, 0.003);
  EXPECT_GT(commands_as_the_body_moves(false, moved_m).cwiseAbs().maxCoeff(), 3e-3);
  EXPECT_LT(commands_as_the_body_moves(true, moved_m).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(LimbController, DoesNotYieldFurtherThanItReaches) {
  LimbController limb(robot(), 0);
  crux_msgs::control_input_t in = ObedientPlant(sample_plan()).input();
  const Pose body_W = {Matrix3::Identity(), {0.0, 0.0, 0.185}};
  const crux_msgs::limb_knot_t start = sample_plan().knots[0].limbs[0];
  LimbReference reference;
  reference.gripper_position_W_m = Vector3(start.gripper_position_w_m);
  reference.gripper_yaw_W_rad = start.gripper_yaw_w_rad;
  limb.sense(in);
  limb.engage(reference, body_W, true);
  crux_msgs::limb_telemetry_t telemetry{};
  crux_msgs::control_output_t out{};
  // The reference wanders out of reach while the hold pulls the same way.
  const Vector3 outwards(0.3, 0.95, 0.0);
  double where_it_stopped_m = 0.0;
  for (int i = 0; i < 2000; ++i) {
    reference.gripper_position_W_m += 1.5e-4 * outwards;
    limb.follow_contact(reference, body_W, body_W, false);
    limb.comply(reference, {8.0 * outwards, Vector3::Zero()}, body_W.rotation, 0.002);
    limb.drive(reference, {}, {0.0, 0.0, -9.81}, body_W, 1.0, 0.002);
    limb.write(NodeMode::kTrack, NodeMode::kTrack, out);
    for (int j = 0; j < kJoints; ++j)
      in.joint_position_rad[j] += setpoint_share(in.dt_s) * (out.joint_position_rad[j] - in.joint_position_rad[j]);
    limb.sense(in);
    limb.write(body_W, {}, telemetry);
    if (telemetry.ik_limited == 0) where_it_stopped_m = Vector3(telemetry.admittance_offset_m).norm();
  }
  EXPECT_NE(telemetry.ik_limited, 0);
  EXPECT_NEAR(Vector3(telemetry.admittance_offset_m).norm(), where_it_stopped_m, 5e-4);
  EXPECT_LT(where_it_stopped_m, 0.8 * robot().admittance.max_offset_m);
}

}  // namespace
}  // namespace crux_test
