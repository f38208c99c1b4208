// Slow motions in mid-climb: what the core tells of them, and what it does.
#include <Eigen/LU>

#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr int kLimb = 3;

class Drifts : public Climbing {
 protected:
  /// A cycle in which the limb's encoders read `off_rad` more than there is.
  void step(const JointVector& off_rad) {
    double* const q_rad = run_.plant.input().joint_position_rad + kLimb * kJoints;
    const JointVector there_rad = Eigen::Map<JointVector>(q_rad);
    Eigen::Map<JointVector>{q_rad} += off_rad;
    run_.core.step(run_.plant.input(), run_.result);
    Eigen::Map<JointVector>{q_rad} = there_rad;
    run_.plant.obey(run_.result);
  }
  double load_N() const { return Vector3(run_.result.telemetry[kLimb].force_reference_w_n).norm(); }
  void expect_answered(FaultCode code, double before_N) {
    EXPECT_EQ(run_.result.fault.code, static_cast<int>(code));
    EXPECT_EQ(run_.result.fault.limb, kLimb);
    EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
    const double plan_time_s = run_.result.state.plan_time_s;
    run_.steps(200);
    EXPECT_LT(load_N(), 0.6 * before_N) << "its load goes off";
    EXPECT_LE(run_.result.state.plan_time_s, plan_time_s) << "no other limb leaves";
    run_.step(command_t::CLEAR_FAULT);
    run_.steps(300);
    EXPECT_NEAR(load_N(), before_N, 0.3 * before_N);
  }
};

TEST_F(Drifts, AnEncoderIsToldByItsJointBeforeItIsFarOff) {
  const double before_N = load_N();
  JointVector off_rad = JointVector::Zero();
  const int joint = 2;
  for (int i = 0; i < 4000 && !run_.result.has_fault; ++i) {
    off_rad[joint] += 0.002 * run_.plant.input().dt_s;
    step(off_rad);
  }
  ASSERT_TRUE(run_.result.has_fault);
  EXPECT_EQ(run_.result.fault.node, robot().can.nodes.joints[joint]);
  EXPECT_LT(off_rad[joint], 0.012) << "the gripper seems to be 5 mm off";
  expect_answered(FaultCode::kEncoderDrifts, before_N);
}

TEST_F(Drifts, AHoldThatGivesWayIsToldBeforeItHasMovedFar) {
  const double before_N = load_N();
  LimbKinematics kinematics(robot().limbs[kLimb]);
  JointVector q_rad = Eigen::Map<JointVector>(run_.plant.input().joint_position_rad + kLimb * kJoints);
  LimbState state;
  kinematics.evaluate(q_rad, state);
  Vector6 way;
  way << -0.0012, 0.0008, 0.0004, Vector3::Zero();  // in a second, and no turn
  const JointVector off_rad_s = state.jacobian_B.inverse() * way;
  double time_s = 0.0;
  for (int i = 0; i < 2000 && !run_.result.has_fault; ++i) step(off_rad_s * (time_s += run_.plant.input().dt_s));
  ASSERT_TRUE(run_.result.has_fault);
  EXPECT_LT(time_s * way.norm(), 0.005);
  expect_answered(FaultCode::kHoldCreeps, before_N);
}

}  // namespace
}  // namespace crux_test
