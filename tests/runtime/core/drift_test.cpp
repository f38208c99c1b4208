// Slow motions in mid-climb: what the core tells of them, and what it does.
#include <Eigen/LU>

#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr int kLimb = 3;

/// A cycle in which the limb's encoders read `off_rad` more than there is.
void step_off(Climber& run, const JointVector& off_rad) {
  double* const q_rad = run.plant.input().joint_position_rad + kLimb * kJoints;
  const JointVector there_rad = Eigen::Map<JointVector>(q_rad);
  Eigen::Map<JointVector>{q_rad} += off_rad;
  run.core.step(run.plant.input(), run.result);
  Eigen::Map<JointVector>{q_rad} = there_rad;
  run.plant.obey(run.result);
}

/// How much the limb's joints turn in a second where its gripper goes this way in the body frame.
JointVector turning(Climber& run, const Vector3& way_m) {
  LimbKinematics kinematics(robot().limbs[kLimb]);
  LimbState state;
  kinematics.evaluate(JointVector(run.plant.input().joint_position_rad + kLimb * kJoints), state);
  Vector6 way;
  way << way_m, Vector3::Zero();
  JointVector turned = JointVector::Zero();
  turned.head<kPlacing>() = state.jacobian_B.leftCols<kPlacing>().inverse() * way;
  return turned;
}

class Drifts : public Climbing {
 protected:
  void step(const JointVector& off_rad) { step_off(run_, off_rad); }
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
  const Vector3 way_m(-0.0012, 0.0008, 0.0004);  // in a second
  const JointVector off_rad_s = turning(run_, way_m);
  double time_s = 0.0;
  for (int i = 0; i < 2000 && !run_.result.has_fault; ++i) step(off_rad_s * (time_s += run_.plant.input().dt_s));
  ASSERT_TRUE(run_.result.has_fault);
  EXPECT_LT(time_s * way_m.norm(), 0.005);
  expect_answered(FaultCode::kHoldCreeps, before_N);
}

TEST_F(Drifts, WhatMovesTheStanceWhileAGripperClosesIsNoCreep) {
  for (int i = 0; i < 12000 && run_.result.reference[0].phase != static_cast<int>(LimbPhase::kClose); ++i) run_.step();
  ASSERT_EQ(run_.result.reference[0].phase, static_cast<int>(LimbPhase::kClose));
  const JointVector off_rad_s = turning(run_, {-0.0012, 0.0008, 0.0004});
  for (double time_s = 0.0; time_s < 1.6; time_s += run_.plant.input().dt_s) {
    loosen(run_.plant.input(), 0);  // it has not found its hold yet
    step(off_rad_s * time_s);
    ASSERT_FALSE(run_.result.has_fault && run_.result.fault.code == static_cast<int>(FaultCode::kHoldCreeps));
  }
}

/// Before the plan has begun: whether a motion of 1.5 mm/s that lasts so long is told.
bool told_before_start(double lasts_s) {
  Climber run(sample_plan());
  EXPECT_TRUE(run.until(SupervisorState::kReady, 20));
  const JointVector off_rad_s = turning(run, {-0.0012, 0.0008, 0.0004});
  for (double time_s = 0.0; time_s < 4.0 && !run.result.has_fault; time_s += run.plant.input().dt_s)
    step_off(run, off_rad_s * std::min(time_s, lasts_s));
  if (run.result.has_fault) {
    EXPECT_EQ(run.result.fault.code, static_cast<int>(FaultCode::kHoldCreeps));
  }
  return run.result.has_fault;
}

TEST(DriftsBeforeStart, WhatSettlesIsNoCreepAndWhatGoesOnIs) {
  EXPECT_FALSE(told_before_start(1.2));
  EXPECT_TRUE(told_before_start(4.0));
}

}  // namespace
}  // namespace crux_test
