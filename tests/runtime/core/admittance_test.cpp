// Admittance against the closed form of mass, damper and spring; grasp force against the formula worked by hand.
#include "core/limb/admittance.hpp"

#include <Eigen/LU>
#include <array>

#include "core/loads/grasp_force.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

constexpr double kDt_s = 0.002;

AdmittanceParameters soft() {
  AdmittanceParameters p = robot().admittance;
  p.max_speed_m_s = p.max_rate_rad_s = 1e3;
  p.max_offset_m = p.max_rotation_rad = 1e3;
  return p;
}

TEST(Admittance, StepResponseEqualsTheOverdampedOscillator) {
  AdmittanceParameters p = soft();
  p.stiffness_N_m = 2000.0;
  Admittance admittance(p);
  const double force = 4.0;
  // M·x'' + D·x' + K·x = F: two real poles.
  const double root = std::sqrt(p.damping_Ns_m * p.damping_Ns_m - 4.0 * p.mass_kg * p.stiffness_N_m);
  const double s1 = (-p.damping_Ns_m + root) / (2.0 * p.mass_kg), s2 = (-p.damping_Ns_m - root) / (2.0 * p.mass_kg);
  for (int i = 1; i <= 1000; ++i) {
    admittance.step({{0.0, force, 0.0}, Vector3::Zero()}, 1e-4);
    const double t = 1e-4 * i;
    const double x = force / p.stiffness_N_m * (1.0 + (s2 * std::exp(s1 * t) - s1 * std::exp(s2 * t)) / (s1 - s2));
    ASSERT_NEAR(admittance.offset_m().y(), x, 2e-2 * force / p.stiffness_N_m);
  }
}

TEST(Admittance, WithoutSpringTheSpeedIsErrorOverDamping) {
  AdmittanceParameters p = soft();
  p.stiffness_N_m = p.rotational_stiffness_Nm_rad = 0.0;
  Admittance admittance(p);
  for (int i = 0; i < 500; ++i) admittance.step({{2.0, 0.0, 0.0}, {0.0, 0.0, 0.3}}, kDt_s);
  const Vector3 before = admittance.offset_m(), turned = admittance.rotation_rad();
  admittance.step({{2.0, 0.0, 0.0}, {0.0, 0.0, 0.3}}, kDt_s);
  EXPECT_NEAR((admittance.offset_m() - before).x() / kDt_s, 2.0 / p.damping_Ns_m, 1e-9);
  EXPECT_NEAR((admittance.rotation_rad() - turned).z() / kDt_s, 0.3 / p.rotational_damping_Nms_rad, 1e-9);
}

TEST(Admittance, OffsetAndSpeedStayInsideTheirClamps) {
  Admittance admittance(robot().admittance);
  Vector3 last = Vector3::Zero();
  for (int i = 0; i < 5000; ++i) {
    admittance.step({{500.0, 300.0, 0.0}, {9.0, 0.0, 0.0}}, kDt_s);
    ASSERT_LE((admittance.offset_m() - last).norm(), robot().admittance.max_speed_m_s * kDt_s + 1e-12);
    ASSERT_LE(admittance.offset_m().norm(), robot().admittance.max_offset_m + 1e-12);
    ASSERT_LE(admittance.rotation_rad().norm(), robot().admittance.max_rotation_rad + 1e-12);
    last = admittance.offset_m();
  }
  EXPECT_NEAR(last.norm(), robot().admittance.max_offset_m, 1e-6);
}

TEST(Admittance, LeavesItsClampAtOnceWhenTheErrorTurns) {
  Admittance admittance(robot().admittance);
  for (int i = 0; i < 10000; ++i) admittance.step({{500.0, 0.0, 0.0}, Vector3::Zero()}, kDt_s);
  const double full = admittance.offset_m().x();
  admittance.step({{-20.0, 0.0, 0.0}, Vector3::Zero()}, kDt_s);
  EXPECT_LT(admittance.offset_m().x(), full);
}

TEST(Admittance, DoesNotGrowWhenTheLimbCannotFollowButMayComeBack) {
  Admittance admittance(robot().admittance);
  for (int i = 0; i < 100; ++i) admittance.step({{20.0, 0.0, 0.0}, Vector3::Zero()}, kDt_s);
  const Vector3 held = admittance.offset_m();
  for (int i = 0; i < 100; ++i) admittance.step({{20.0, 0.0, 0.0}, Vector3::Zero()}, kDt_s, false);
  EXPECT_EQ(admittance.offset_m(), held);
  for (int i = 0; i < 100; ++i) admittance.step({{-20.0, 0.0, 0.0}, Vector3::Zero()}, kDt_s, false);
  EXPECT_LT(admittance.offset_m().x(), held.x());
}

TEST(Admittance, NewParametersMakeNoBump) {
  Admittance admittance(soft());
  const Wrench error = {{5.0, 0.0, 0.0}, {0.0, 0.2, 0.0}};
  for (int i = 0; i < 300; ++i) admittance.step(error, kDt_s);
  const Vector3 before = admittance.offset_m(), turned = admittance.rotation_rad();
  AdmittanceParameters stiff = soft();
  stiff.stiffness_N_m *= 20.0;
  stiff.damping_Ns_m *= 3.0;
  admittance.set_parameters(stiff);
  EXPECT_EQ(admittance.offset_m(), before);
  EXPECT_EQ(admittance.rotation_rad(), turned);
  admittance.step(error, kDt_s);
  EXPECT_LT((admittance.offset_m() - before).norm(), 5.0 / soft().damping_Ns_m * kDt_s * 1.01);
}

TEST(Admittance, FadesWithTheTimeConstantGiven) {
  Admittance admittance(soft());
  admittance.reset({0.01, 0.0, 0.0}, {0.0, 0.1, 0.0});
  for (int i = 0; i < 500; ++i) admittance.fade(Vector3::Zero(), 0.5, kDt_s);  // 1 s: two time constants
  EXPECT_NEAR(admittance.offset_m().x(), 0.01 * std::exp(-2.0), 2e-4);
  EXPECT_NEAR(admittance.rotation_rad().y(), 0.1 * std::exp(-2.0), 2e-3);
}

TEST(Admittance, GivesWayInTheAirToWhatItRunsAgainst) {
  Admittance admittance(soft());
  for (int i = 0; i < 2000; ++i) admittance.fade({4.0, 0.0, 0.0}, 0.5, kDt_s);
  EXPECT_NEAR(admittance.offset_m().x(), 4.0 * 0.5 / soft().damping_Ns_m, 1e-4);
}

TEST(Admittance, AnOffsetTakenOverOutsideTheClampDoesNotJump) {
  Admittance admittance(robot().admittance);
  admittance.reset({0.08, 0.0, 0.0}, Vector3::Zero());
  admittance.fade(Vector3::Zero(), 0.5, kDt_s);
  EXPECT_NEAR(admittance.offset_m().x(), 0.08, robot().admittance.max_speed_m_s * kDt_s);
}

const Contact kContact = {2.2, 0.0134, 60.0, 0.025};

TEST(GraspForce, EqualsTheFormulaByHand) {
  const ControlParameters& c = robot().control;
  const Vector3 e = rotation_z(0.3).col(0);
  // Shear 30 N, twist 0.2 Nm, 8 N along the fingers, and 0.7 Nm across them: 14 N a pad, across the shear.
  const Wrench wrench = {8.0 * e + 30.0 * Vector3::UnitZ(), 0.2 * e + 0.7 * Vector3::UnitZ()};
  const double expected = 1.25 * std::sqrt(15.0 * 15.0 + 14.0 * 14.0 + std::pow(0.1 / 0.0134, 2)) / 2.2 + 4.0 + 4.0;
  EXPECT_NEAR(required_grasp_force_N(wrench, e, kContact, c), expected, 1e-12);
}

/// Tangential force, twist about the finger axis and normal force of one pad.
struct PadLoad {
  Vector3 tangential_N;
  double twist_Nm;
  double normal_N;
};

/// What statics leaves the two pads of a gripper: f1 + f2 = F, a·e × (f1 − f2) + (m1 + m2)·e = M, m1 = m2 (4) and the
/// squeeze, solved as eight equations.
std::array<PadLoad, 2> pad_loads(const Wrench& wrench, const Vector3& e, double half_opening_m, double squeeze_N) {
  Eigen::Matrix<double, 8, 8> equations = Eigen::Matrix<double, 8, 8>::Zero();
  Eigen::Matrix<double, 8, 1> right;
  equations.block<3, 3>(0, 0).setIdentity();
  equations.block<3, 3>(0, 3).setIdentity();
  equations.block<3, 3>(3, 0) = half_opening_m * skew(e);
  equations.block<3, 3>(3, 3) = -half_opening_m * skew(e);
  equations.block<3, 1>(3, 6) = equations.block<3, 1>(3, 7) = e;
  equations(6, 6) = 1.0;
  equations(6, 7) = -1.0;
  equations.block<1, 3>(7, 0) = 0.5 * e.transpose();
  equations.block<1, 3>(7, 3) = -0.5 * e.transpose();
  right << wrench.force_N, wrench.moment_Nm, 0.0, squeeze_N;
  const Eigen::Matrix<double, 8, 1> x = equations.fullPivLu().solve(right);
  std::array<PadLoad, 2> loads;
  for (int finger = 0; finger < 2; ++finger) {
    const Vector3 force = x.segment<3>(3 * finger);
    loads[finger] = {force - force.dot(e) * e, x[6 + finger], (finger == 0 ? 1.0 : -1.0) * force.dot(e)};
  }
  return loads;
}

bool both_pads_hold(const Wrench& wrench, const Vector3& e, const Contact& contact, double squeeze_N) {
  for (const PadLoad& pad : pad_loads(wrench, e, contact.half_opening_m, squeeze_N)) {
    const double bound_N = contact.friction * pad.normal_N;
    if (pad.normal_N < 0.0) return false;
    if (pad.tangential_N.squaredNorm() + std::pow(pad.twist_Nm / contact.patch_k_m, 2) > bound_N * bound_N)
      return false;
  }
  return true;
}

TEST(GraspForce, IsTheLeastThatKeepsBothPadsInsideTheirLimitSurface) {
  ControlParameters bare = robot().control;
  bare.grasp_force_factor = 1.0;
  bare.grasp_force_reserve_N = bare.min_grasp_force_N = 0.0;
  Random random(20);
  for (int i = 0; i < 500; ++i) {
    const Vector3 e = rotation_z(random.uniform(-3.0, 3.0)).col(0);
    const Contact contact = {random.uniform(0.3, 2.5), random.uniform(0.005, 0.02), 1e6, random.uniform(0.008, 0.066)};
    const Wrench wrench = random.wrench(40.0, 1.5);
    double low_N = 0.0, high_N = 1e5;
    while (high_N - low_N > 1e-9 * high_N) {
      const double middle_N = 0.5 * (low_N + high_N);
      (both_pads_hold(wrench, e, contact, middle_N) ? high_N : low_N) = middle_N;
    }
    ASSERT_NEAR(required_grasp_force_N(wrench, e, contact, bare), high_N, 1e-6 * high_N) << "wrench " << i;
    // With the robot's factor and reserve: inside, and larger by no more than what they say.
    const double used_N = required_grasp_force_N(wrench, e, contact, robot().control);
    ASSERT_TRUE(both_pads_hold(wrench, e, contact, used_N)) << "wrench " << i;
    const ControlParameters& c = robot().control;
    const double along_N = std::abs(wrench.force_N.dot(e));
    const double factored_N = c.grasp_force_factor * high_N + (c.grasp_force_factor - 1.0) * 0.5 * along_N;
    ASSERT_LE(used_N, std::max(factored_N + c.grasp_force_reserve_N, c.min_grasp_force_N) + 1e-6) << "wrench " << i;
  }
}

TEST(GraspForce, AMomentAcrossTheFingersIsShearOnTheArmBetweenThePads) {
  ControlParameters bare = robot().control;
  bare.grasp_force_factor = 1.0;
  bare.grasp_force_reserve_N = bare.min_grasp_force_N = 0.0;
  // 1 Nm at 25 mm half width: 20 N of shear a pad.
  const Contact contact = {2.0, 0.0134, 60.0, 0.025};
  EXPECT_NEAR(required_grasp_force_N({Vector3::Zero(), Vector3::UnitZ()}, Vector3::UnitX(), contact, bare), 10.0,
              1e-12);
}

TEST(GraspForce, StaysBetweenItsBounds) {
  const Vector3 e = Vector3::UnitX();
  EXPECT_EQ(required_grasp_force_N({}, e, kContact, robot().control), robot().control.min_grasp_force_N);
  EXPECT_EQ(required_grasp_force_N({{0.0, 500.0, 0.0}, Vector3::Zero()}, e, kContact, robot().control), 60.0);
}

/// An actuator with a position loop on a rigid hold: opening follows the command until the hold stops it.
struct Actuator {
  double hold_m = 0.03;
  double opening(double command_m) const { return std::max(command_m, hold_m); }
  double force(double command_m) const { return robot().gripper.stiffness_N_m * std::max(hold_m - command_m, 0.0); }
};

TEST(GraspController, ClosesUntilContactThenReachesTheForceWithoutOvershoot) {
  GraspController grasp(robot().gripper, robot().control);
  const Actuator actuator;
  grasp.reset(0.048, 0.0);
  double force = 0.0, highest = 0.0;
  bool touched = false;
  for (int i = 0; i < 2000; ++i) {
    const double before = grasp.opening_command_m();
    grasp.press(25.0, force, actuator.opening(before), kDt_s);
    if (force == 0.0) {
      ASSERT_NEAR((before - grasp.opening_command_m()) / kDt_s, robot().control.closing_speed_m_s, 1e-9);
    }
    force = actuator.force(grasp.opening_command_m());
    touched = touched || force > 0.0;
    highest = std::max(highest, force);
  }
  EXPECT_TRUE(touched);
  EXPECT_NEAR(force, 25.0, 0.2);
  EXPECT_LT(highest, 26.0);
}

TEST(GraspController, FingersAtTheirStopAreNotCommandedBeyondIt) {
  GraspController grasp(robot().gripper, robot().control);
  grasp.reset(robot().gripper.opening_m.low, 20.0);
  EXPECT_GE(grasp.opening_command_m(), robot().gripper.opening_m.low);
}

TEST(GraspController, ClosesAsFastAsItCanWhereItHurries) {
  GraspController grasp(robot().gripper, robot().control);
  grasp.reset(0.05, 0.0);
  grasp.press(20.0, 0.0, 0.05, kDt_s);
  EXPECT_NEAR(grasp.opening_command_m(), 0.05 - kDt_s * robot().control.closing_speed_m_s, 1e-9);
  grasp.hurry(true);
  grasp.reset(0.05, 0.0);
  grasp.press(20.0, 0.0, 0.05, kDt_s);
  EXPECT_NEAR(grasp.opening_command_m(), 0.05 - kDt_s * robot().gripper.max_finger_speed_m_s, 1e-9);
}

TEST(GraspController, WhatDragsTheFingersInTheAirIsNoTouch) {
  GraspController grasp(robot().gripper, robot().control);
  grasp.reset(0.048, 0.0);
  const double touch_N = 0.3 * robot().control.contact_force_N, before = grasp.opening_command_m();
  grasp.press(25.0, 0.9 * touch_N, before, kDt_s);
  EXPECT_EQ(grasp.force_reference_N(), 0.0);
  EXPECT_NEAR((before - grasp.opening_command_m()) / kDt_s, robot().control.closing_speed_m_s, 1e-9);
  grasp.press(25.0, 1.1 * touch_N, before, kDt_s);
  EXPECT_GE(grasp.force_reference_N(), robot().control.contact_force_N);
}

TEST(GraspController, TakesOverAPressingActuatorWithoutAJolt) {
  GraspController grasp(robot().gripper, robot().control);
  const Actuator actuator;
  grasp.reset(actuator.hold_m, 20.0);
  EXPECT_NEAR(actuator.force(grasp.opening_command_m()), 20.0, 1e-9);
  grasp.press(20.0, 20.0, actuator.hold_m, kDt_s);
  EXPECT_NEAR(actuator.force(grasp.opening_command_m()), 20.0, 1e-6);
}

TEST(GraspController, AForceThatReadsTooMuchOpensNoFurtherThanOpeningAndWantedForceAllow) {
  GraspController grasp(robot().gripper, robot().control);
  const Actuator actuator;
  grasp.reset(actuator.hold_m, 40.0);
  for (int i = 0; i < 5000; ++i) grasp.press(40.0, 58.0, actuator.hold_m, kDt_s);
  EXPECT_NEAR(actuator.force(grasp.opening_command_m()), 35.0, 0.5);
}

/// One whose setpoint moves no faster than its limit, and is seen three cycles later.
struct SlowActuator {
  double limit_m_s, hold_m = 0.03, setpoint_m = 0.048;
  std::array<double, 3> seen_m = {0.048, 0.048, 0.048};

  double opening_m() const { return std::max(seen_m[0], hold_m); }
  double force_N() const { return robot().gripper.stiffness_N_m * (opening_m() - seen_m[0]); }
  void obey(double command_m) {
    const double reach_m = limit_m_s * kDt_s;
    setpoint_m += std::clamp(command_m - setpoint_m, -reach_m, reach_m);
    seen_m = {seen_m[1], seen_m[2], setpoint_m};
  }
};

/// The longest time [s] for which the force that is expected is further from the actuator's than a fault's limit, in
/// grasps and releases. `read`: what the sensor makes of the force.
template <class Read>
double longest_residual_s(double limit_m_s, Read read, double& force_N) {
  GraspController grasp(robot().gripper, robot().control);
  SlowActuator actuator{limit_m_s};
  grasp.reset(actuator.setpoint_m, 0.0);
  double now_s = 0.0, longest_s = 0.0;
  const auto look = [&] {
    const double residual_N = grasp.expected_force_N(actuator.opening_m(), 0.0) - read(actuator.force_N());
    now_s = residual_N > robot().supervisor.max_finger_residual_N ? now_s + kDt_s : 0.0;
    longest_s = std::max(longest_s, now_s);
    grasp.see(actuator.opening_m(), 0.0, read(actuator.force_N()));
  };
  for (int turn = 0; turn < 2; ++turn) {
    for (int i = 0; i < 4000; ++i, actuator.obey(grasp.opening_command_m())) {
      look();
      grasp.press(40.0, read(actuator.force_N()), actuator.opening_m(), kDt_s);
    }
    force_N = actuator.force_N();
    for (int i = 0; i < 4000 && turn == 0; ++i, actuator.obey(grasp.opening_command_m())) {
      look();
      grasp.open_to(0.048, kDt_s);
    }
  }
  return longest_s;
}

TEST(GraspController, AnActuatorThatIsSlowerThanDescribedIsFoundToBeAndPressesAsItIsTold) {
  for (const double limit_m_s : {0.005, 0.010, 0.015, 0.030}) {
    double force_N = 0.0;
    EXPECT_LT(longest_residual_s(limit_m_s, [](double force) { return force; }, force_N), 0.08) << limit_m_s;
    EXPECT_NEAR(force_N, 40.0, 1.0) << limit_m_s;
  }
}

TEST(GraspController, AForceSensorThatReadsTooLittleIsNoSlowActuator) {
  double force_N = 0.0;
  for (const double limit_m_s : {0.005, 0.030}) {
    EXPECT_GT(longest_residual_s(limit_m_s, [](double) { return 2.0; }, force_N), 0.5) << limit_m_s;
    EXPECT_GT(longest_residual_s(limit_m_s, [](double force) { return 0.5 * force; }, force_N), 0.5) << limit_m_s;
  }
}

TEST(GraspController, OpensAtItsSpeedAndDoesNotWindUpOnNothing) {
  GraspController grasp(robot().gripper, robot().control);
  grasp.reset(0.03, 20.0);
  const double start = grasp.opening_command_m();
  for (int i = 0; i < 100; ++i) grasp.open_to(0.048, kDt_s);
  EXPECT_NEAR(grasp.opening_command_m(), start + 0.2 * robot().gripper.max_finger_speed_m_s, 1e-9);
  for (int i = 0; i < 5000; ++i) grasp.press(20.0, 0.0, 0.0, kDt_s);  // nothing there to press
  EXPECT_GE(grasp.opening_command_m(), robot().gripper.opening_m.low);
}

}  // namespace
}  // namespace crux_test
