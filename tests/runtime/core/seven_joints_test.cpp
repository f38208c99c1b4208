// A limb of seven joints: of the angles that place its gripper, those count that are none off the middle of the joints'
// ranges in the way that leaves the gripper at rest there.
#include <gtest/gtest.h>

#include <Eigen/LU>

#include "core/robot/inverse_kinematics.hpp"
#include "core/robot/still_turns.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

LimbDescription seven_joints() {
  LimbDescription limb;
  limb.driven = 7;
  const auto add = [&limb](const KDL::Vector& axis, const KDL::Vector& to_next) {
    limb.chain.addSegment(KDL::Segment(KDL::Joint(KDL::Vector::Zero(), axis, KDL::Joint::RotAxis), KDL::Frame(to_next),
                                       KDL::RigidBodyInertia(0.3)));
  };
  add({0, 0, 1}, {0.02, 0, 0});
  add({0, -1, 0}, {0.075, 0, 0});
  add({1, 0, 0}, {0.075, 0, 0});
  add({0, 1, 0}, {0.2, 0, 0});
  add({0, 1, 0}, {0, 0, 0});
  add({1, 0, 0}, {0, 0, 0});
  add({0, 0, 1}, {0, 0, -0.12});
  const double low_rad[] = {-1.9, -1.2, -0.7, 0.25, -2.2, -1.5, -3.0},
               high_rad[] = {1.9, 2.0, 0.9, 2.75, 2.2, 1.5, 3.0};
  for (std::size_t j = 0; j < limb.joints.size(); ++j) limb.joints[j] = {low_rad[j], high_rad[j], 4.8, 12.0};
  return limb;
}

class SevenJoints : public testing::Test {
 protected:
  SevenJoints() {
    for (int j = 0; j < kJoints; ++j) middle_rad_[j] = (limb_.joints[j].lower_rad + limb_.joints[j].upper_rad) / 2.0;
    way_ = at(middle_rad_).jacobian_B.fullPivLu().kernel().col(0).normalized();
  }

  LimbState at(const JointVector& q_rad) {
    LimbState state;
    kinematics_.evaluate(q_rad, state);
    return state;
  }

  LimbDescription limb_ = seven_joints();
  LimbKinematics kinematics_{limb_};
  InverseKinematics inverse_{limb_, kinematics_};
  JointVector middle_rad_, way_;
};

TEST_F(SevenJoints, HaveNoTurnsThatStandStill) {
  ASSERT_TRUE(add_still_turns(limb_));
  EXPECT_EQ(limb_.chain.getNrOfJoints(), 7U);
  EXPECT_EQ(limb_.turns(), 7);
}

TEST_F(SevenJoints, TheAnglesOfAPoseAreThoseThatAreNoneOfTheSpareWayOff) {
  Random random(7);
  for (int i = 0; i < 50; ++i) {
    JointVector off_rad;
    for (int j = 0; j < kJoints; ++j) off_rad[j] = random.uniform(-0.25, 0.25);
    const JointVector q_rad = middle_rad_ + off_rad - way_ * way_.dot(off_rad);
    const IkResult found = inverse_.solve(at(q_rad).gripper_B, middle_rad_, 60);
    ASSERT_EQ(found.limited, 0);
    ASSERT_LT((found.q_rad - q_rad).norm(), 1e-4) << "pose " << i;
  }
}

TEST_F(SevenJoints, OneThatTheirMotionLeftComesBackWithTheGripperAtRest) {
  JointVector command_rad = middle_rad_ + 0.1 * way_;
  const Pose target_B = at(command_rad).gripper_B;
  for (int cycle = 0; cycle < 300; ++cycle) {
    const JointVector last_rad = command_rad;
    command_rad = inverse_.step(target_B, last_rad, 0.002).q_rad;
    ASSERT_LT((command_rad - last_rad).norm(), 1e-3) << "cycle " << cycle;
    ASSERT_LT((at(command_rad).gripper_B.position_m - target_B.position_m).norm(), 1e-6) << "cycle " << cycle;
  }
  EXPECT_NEAR(way_.dot(command_rad - middle_rad_), 0.0, 1e-6);
}

TEST_F(SevenJoints, AJointAtItsLimitCostsTheSpareWayAndNotThePose) {
  JointVector beyond_rad = middle_rad_;
  beyond_rad[2] = limb_.joints[2].upper_rad + 0.02;
  const IkResult found = inverse_.solve(at(beyond_rad).gripper_B, middle_rad_, 100);
  EXPECT_LT(found.position_error_m, 1e-5);
  EXPECT_LE(found.q_rad[2], limb_.joints[2].upper_rad);
}

}  // namespace
}  // namespace crux_test
