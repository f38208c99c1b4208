// A limb of four joints: yaw, and three pitches in one plane.
#include <gtest/gtest.h>

#include <kdl/frames.hpp>

#include "core/limb/yielding_part.hpp"
#include "core/robot/inverse_kinematics.hpp"
#include "core/robot/still_turns.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

LimbDescription four_joints(const KDL::Vector& first_axis = {0, 0, 1}) {
  LimbDescription limb;
  limb.driven = 4;
  const auto add = [&limb](const KDL::Vector& axis, const KDL::Vector& to_next) {
    limb.chain.addSegment(KDL::Segment(KDL::Joint(KDL::Vector::Zero(), axis, KDL::Joint::RotAxis), KDL::Frame(to_next),
                                       KDL::RigidBodyInertia(0.3)));
  };
  add(first_axis, {0, 0, 0});
  add({0, -1, 0}, {0.15, 0, 0});
  add({0, 1, 0}, {0.2, 0, 0});
  add({0, 1, 0}, {0, 0, -0.12});
  limb.joints = {{{-1.9, 1.9, 4.8, 12}, {-1.2, 2.0, 4.8, 12}, {0.25, 2.75, 4.8, 12}, {-2.2, 2.2, 4.8, 6}}};
  return limb;
}

TEST(StillTurns, AreAboutTheAxesThatTheJointsDoNotTurnTheGripperAbout) {
  LimbDescription limb = four_joints();
  ASSERT_TRUE(add_still_turns(limb));
  ASSERT_EQ(limb.chain.getNrOfJoints(), static_cast<unsigned>(kPlacing));
  LimbKinematics kinematics(limb);
  LimbState state;
  JointVector q_rad;
  q_rad << 0.3, 0.8, 1.6, -0.8, 0.0, 0.0, 0.0;
  kinematics.evaluate(q_rad, state);
  EXPECT_TRUE(state.jacobian_B.rightCols<3>().isZero());
  EXPECT_EQ(state.distal_mass_kg[4], 0.0);
  Pose gripper_B, turned_B;
  LimbJacobian jacobian;
  kinematics.evaluate(q_rad, gripper_B, jacobian);
  turned_B = gripper_B;
  turned_B.rotation = gripper_B.rotation * rotation_z(0.1);
  InverseKinematics inverse(limb, kinematics);
  const IkResult found = inverse.solve(turned_B, q_rad, 50);
  EXPECT_EQ(found.limited, 0);
  EXPECT_TRUE(found.q_rad.head<4>().isApprox(q_rad.head<4>(), 1e-5));  // a turn on the spot is none of the joints'
  EXPECT_NEAR(found.q_rad.tail<3>().norm(), 0.1, 1e-6);
}

TEST(StillTurns, AreRefusedWhereJointsMoveTheGripperInAPlane) {
  LimbDescription limb = four_joints({0, 1, 0});
  EXPECT_FALSE(add_still_turns(limb));
}

TEST(YieldingPart, IsWhatTheJointsFeelAndCanAnswer) {
  LimbDescription limb = four_joints();
  ASSERT_TRUE(add_still_turns(limb));
  LimbKinematics kinematics(limb);
  LimbState state;
  JointVector q_rad;
  q_rad << 0.3, 0.8, 1.6, -0.8, 0.0, 0.0, 0.0;
  kinematics.evaluate(q_rad, state);
  AdmittanceParameters gains;
  gains.damping_Ns_m = 400.0;
  gains.rotational_damping_Nms_rad = 9.0;
  const Wrench wrench{{3.0, -2.0, 5.0}, {0.4, -0.3, 0.7}};
  const Wrench part = yielding_part(state, wrench, gains);
  const auto torque_Nm = [&state](const Wrench& w) {
    return JointVector(state.jacobian_B.topRows<3>().transpose() * w.force_N +
                       state.jacobian_B.bottomRows<3>().transpose() * w.moment_Nm);
  };
  EXPECT_TRUE(torque_Nm(part).isApprox(torque_Nm(wrench), 1e-6));
  Vector6 twist;
  twist << part.force_N / gains.damping_Ns_m, part.moment_Nm / gains.rotational_damping_Nms_rad;
  const Eigen::Matrix<double, 6, 4> motions = state.jacobian_B.leftCols<4>();
  const Eigen::Matrix4d square = motions.transpose() * motions;
  const Vector6 made = motions * square.inverse() * motions.transpose() * twist;
  EXPECT_TRUE(made.isApprox(twist, 1e-6));
}

}  // namespace
}  // namespace crux_test
