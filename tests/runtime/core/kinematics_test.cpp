// Kinematics against closed form and finite differences; gravity against KDL's recursion and energy.
#include <kdl/chainidsolver_recursive_newton_euler.hpp>

#include "core/robot/gravity.hpp"
#include "core/robot/inverse_kinematics.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

constexpr double kStep = 1e-6;

/// Closed form of scaler's limb: yaw, two pitches, wrist (pitch, roll, yaw), gripper 0.12 m below the wrist.
Pose closed_form(int limb, const JointVector& q) {
  const double side = limb % 2 == 0 ? 1.0 : -1.0, front = limb < 2 ? 1.0 : -1.0;
  const double mount = side * M_PI / 2;
  const double elevation = q[1] - q[2];
  const double reach = 0.15 * std::cos(q[1]) + 0.20 * std::cos(elevation);
  const double height = 0.15 * std::sin(q[1]) + 0.20 * std::sin(elevation);
  const double yaw = q[0] + mount;
  const Matrix3 forearm = rotation_z(yaw) * rotation_exp({0.0, -elevation, 0.0});
  const Matrix3 wrist =
      rotation_exp({0.0, q[3], 0.0}) * rotation_exp({q[4], 0.0, 0.0}) * rotation_exp({0.0, 0.0, q[5] - mount});
  const Matrix3 rotation = forearm * wrist;
  const Vector3 shoulder(front * 0.1355, side * 0.144, 0.0);
  return {rotation, shoulder + Vector3(std::cos(yaw) * reach, std::sin(yaw) * reach, height) - 0.12 * rotation.col(2)};
}

class Kinematics : public testing::TestWithParam<int> {
 protected:
  int limb() const { return GetParam(); }
  LimbState at(const JointVector& q) {
    LimbState state;
    kinematics_.evaluate(q, state);
    return state;
  }
  LimbKinematics kinematics_{robot().limbs[GetParam()]};
  Random random_{static_cast<unsigned>(GetParam() + 7)};
};

TEST_P(Kinematics, ForwardEqualsClosedForm) {
  for (int i = 0; i < 100; ++i) {
    const JointVector q = random_angles(random_, 0.8);
    const Pose pose = at(q).gripper_B, expected = closed_form(limb(), q);
    EXPECT_LT((pose.position_m - expected.position_m).norm(), 1e-12);
    EXPECT_LT((pose.rotation - expected.rotation).norm(), 1e-12);
  }
}

TEST_P(Kinematics, JacobianEqualsFiniteDifferences) {
  for (int i = 0; i < 20; ++i) {
    const JointVector q = random_angles(random_);
    const LimbState state = at(q);
    for (int j = 0; j < kPlacing; ++j) {
      JointVector step = JointVector::Zero();
      step[j] = kStep;
      const Pose ahead = at(q + step).gripper_B, behind = at(q - step).gripper_B;
      Vector6 expected;
      expected << (ahead.position_m - behind.position_m) / (2 * kStep),
          rotation_log(ahead.rotation * behind.rotation.transpose()) / (2 * kStep);
      EXPECT_LT((state.jacobian_B.col(j) - expected).norm(), 1e-8) << "joint " << j;
    }
  }
}

TEST_P(Kinematics, GravityTorqueEqualsNewtonEulerAndEnergy) {
  for (int i = 0; i < 20; ++i) {
    const JointVector q = random_angles(random_);
    const Vector3 g = random_.vector(10.0);
    const JointVector torque = gravity_torque(at(q), g);

    KDL::ChainIdSolver_RNE recursion(robot().limbs[limb()].chain, KDL::Vector(g.x(), g.y(), g.z()));
    KDL::JntArray angles(kPlacing), zero(kPlacing), expected(kPlacing);
    angles.data = q.head<kPlacing>();
    const KDL::Wrenches none(robot().limbs[limb()].chain.getNrOfSegments(), KDL::Wrench::Zero());
    ASSERT_EQ(recursion.CartToJnt(angles, zero, zero, none, expected), 0);
    EXPECT_LT((torque.head<kPlacing>() - expected.data).norm(), 1e-10);

    for (int j = 0; j < kPlacing; ++j) {
      JointVector step = JointVector::Zero();
      step[j] = kStep;
      const double energy_slope = -g.dot(at(q + step).moment_B_kgm - at(q - step).moment_B_kgm) / (2 * kStep);
      EXPECT_NEAR(torque[j], energy_slope, 1e-7) << "joint " << j;
    }
  }
}

TEST_P(Kinematics, ContactTorqueDoesTheWrenchsWork) {
  const JointVector q = random_angles(random_), dq = random_angles(random_);
  const LimbState state = at(q);
  const Wrench wrench = random_.wrench(50.0, 2.0);
  const Vector6 twist = state.jacobian_B * dq;
  // In equilibrium the joints' power and the wrench's cancel.
  const double power = contact_torque(state, wrench).dot(dq) + wrench.force_N.dot(twist.head<3>()) +
                       wrench.moment_Nm.dot(twist.tail<3>());
  EXPECT_NEAR(power, 0.0, 1e-10);
}

TEST_P(Kinematics, InverseFindsItsWayBackToNearbyPoses) {
  InverseKinematics inverse(robot().limbs[limb()], kinematics_);
  for (int i = 0; i < 50; ++i) {
    const JointVector q = random_angles(random_, 0.3);
    const IkResult result = inverse.solve(closed_form(limb(), q), standing_angles(), 30);
    EXPECT_EQ(result.limited, 0);
    EXPECT_LT((result.q_rad - q).norm(), 1e-4);
    EXPECT_LT(result.position_error_m, 1e-6);
  }
}

TEST_P(Kinematics, InverseOutOfReachStaysNearAndSaysSo) {
  InverseKinematics inverse(robot().limbs[limb()], kinematics_);
  JointVector q = standing_angles();
  Pose target = at(q).gripper_B;
  const Vector3 outwards = Vector3(target.position_m.x(), target.position_m.y(), 0.0).normalized();
  IkResult result;
  for (int i = 0; i < 2000; ++i) {
    target.position_m += 2e-4 * outwards;  // 0.4 m in the end: far beyond the limb
    result = inverse.step(target, q, 0.002);
    const JointVector moved = (result.q_rad - q).cwiseAbs();
    for (int j = 0; j < kPlacing; ++j) {
      const JointLimits& limits = robot().limbs[limb()].joints[j];
      ASSERT_LE(moved[j], limits.velocity_rad_s * 0.002 + 1e-12);
      ASSERT_GE(result.q_rad[j], limits.lower_rad);
      ASSERT_LE(result.q_rad[j], limits.upper_rad);
    }
    q = result.q_rad;
  }
  EXPECT_TRUE(result.limited & kIkNoConvergence);
  // It stretched towards the target instead of giving up: at full length the gripper is nearly as far out as it goes.
  const Vector3 shoulder = Vector3(robot().limbs[limb()].chain.getSegment(0).getFrameToTip().p.data);
  EXPECT_GT((at(q).gripper_B.position_m - shoulder).norm(), 0.30);
}

TEST_P(Kinematics, InverseKeepsToTheSpeedLimitAndGoesOnTowardsTheTarget) {
  InverseKinematics inverse(robot().limbs[limb()], kinematics_);
  const JointVector start = standing_angles();
  JointVector away = start;
  away[0] += 0.5;
  const IkResult result = inverse.step(at(away).gripper_B, start, 0.002);
  EXPECT_TRUE(result.limited & kIkSpeedLimit);
  EXPECT_NEAR((result.q_rad - start).cwiseAbs().maxCoeff(), robot().limbs[limb()].joints[0].velocity_rad_s * 0.002,
              1e-9);
  EXPECT_GT(result.q_rad[0], start[0]);
}

TEST_P(Kinematics, InverseAtAJointLimitUsesTheOthers) {
  InverseKinematics inverse(robot().limbs[limb()], kinematics_);
  JointVector q = standing_angles(), beyond = q;
  q[4] = robot().limbs[limb()].joints[4].upper_rad;
  beyond[4] = q[4] + 0.05;
  const IkResult result = inverse.solve(at(beyond).gripper_B, q, 50);
  EXPECT_TRUE(result.limited & kIkPositionLimit);
  EXPECT_LE(result.q_rad[4], robot().limbs[limb()].joints[4].upper_rad);
  EXPECT_LT(result.position_error_m, 0.01);
}

INSTANTIATE_TEST_SUITE_P(Limbs, Kinematics, testing::Range(0, kLimbs));

TEST(CentreOfMass, IsTheMeanOfAllLinks) {
  Random random(3);
  PerLimb<LimbState> states;
  Vector3 moment = robot().body_mass_kg * robot().body_com_B_m;
  double mass = robot().body_mass_kg;
  for (int l = 0; l < kLimbs; ++l) {
    const JointVector q = random_angles(random);
    LimbKinematics kinematics(robot().limbs[l]);
    kinematics.evaluate(q, states[l]);
    // Independently: KDL's own forward kinematics up to each segment.
    const KDL::Chain& chain = robot().limbs[l].chain;
    KDL::ChainFkSolverPos_recursive forward(chain);
    KDL::JntArray angles(kPlacing);
    angles.data = q.head<kPlacing>();
    for (unsigned int s = 0; s < chain.getNrOfSegments(); ++s) {
      KDL::Frame frame;
      forward.JntToCart(angles, frame, static_cast<int>(s) + 1);
      const KDL::RigidBodyInertia& inertia = chain.getSegment(s).getInertia();
      const KDL::Vector com = frame * inertia.getCOG();
      moment += inertia.getMass() * Vector3(com.data);
      mass += inertia.getMass();
    }
  }
  EXPECT_NEAR(mass, robot().total_mass_kg, 1e-12);
  EXPECT_NEAR(mass, 9.6, 1e-9);
  EXPECT_LT((centre_of_mass(robot(), states) - moment / mass).norm(), 1e-12);
}

}  // namespace
}  // namespace crux_test
