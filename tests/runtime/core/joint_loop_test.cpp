// Joints that answer late, and joints that oscillate.
#include <cmath>
#include <deque>
#include <numbers>

#include "core/estimate/delay_probe.hpp"
#include "core/estimate/oscillation_watch.hpp"
#include "core/robot/joint_loops.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr double kDt_s = 0.002;

/// A drive that makes of a torque what the description says, `dead` cycles late, beside a load and a position loop that
/// answers the motion.
class Drive {
 public:
  explicit Drive(int dead) : asked_Nm_(static_cast<std::size_t>(dead) + 1, 0.0) {}
  /// One cycle; returns what its status tells in the next.
  double told_Nm(double torque_Nm) {
    asked_Nm_.push_back(torque_Nm - 1.4 * speed_rad_s_ - 90.0 * angle_rad_);
    asked_Nm_.pop_front();
    made_Nm_ += (1.0 - std::exp(-1.0)) * (asked_Nm_.front() - made_Nm_);
    speed_rad_s_ += kDt_s * made_Nm_ / 0.03;
    angle_rad_ += kDt_s * speed_rad_s_;
    return 3.0 + made_Nm_;
  }

 private:
  std::deque<double> asked_Nm_;
  double made_Nm_ = 0.0, speed_rad_s_ = 0.0, angle_rad_ = 0.0;
};

TEST(DelayProbe, FindsTheCyclesThatADriveIsLate) {
  for (const int dead : {0, 1, 2, 4, 8, 16}) {
    DelayProbe probe;
    std::vector<Drive> drives(kAllJoints, Drive(dead));
    std::array<double, kAllJoints> told_Nm{};
    for (int i = 0; i < 1000 && !probe.done(); ++i) {
      probe.step(told_Nm.data());
      for (int j = 0; j < kAllJoints - 1; ++j) told_Nm[j] = drives[j].told_Nm(probe.torque_Nm(j));
    }
    ASSERT_TRUE(probe.done());
    for (int j = 0; j < kAllJoints - 1; ++j) EXPECT_EQ(probe.dead_cycles(j), dead) << "joint " << j;
    EXPECT_FALSE(probe.dead_cycles(kAllJoints - 1)) << "a joint that makes no torque";
  }
}

TEST(DelayProbe, AsksForNothingOnceItIsDone) {
  DelayProbe probe;
  EXPECT_EQ(probe.torque_Nm(0), 0.0);
  const std::array<double, kAllJoints> still{};
  double sum_Nm = 0.0;
  while (!probe.done()) {
    probe.step(still.data());
    sum_Nm += std::abs(probe.torque_Nm(3));
  }
  EXPECT_GT(sum_Nm, 1.0);
  EXPECT_EQ(probe.torque_Nm(3), 0.0);
}

/// The climb of a plant whose drives are `dead` cycles late in what they say of their torques.
class LateRobot : public testing::Test {
 protected:
  void step(int command = command_t::NONE) {
    run_.step(command);
    told_.emplace_back();
    std::copy_n(std::begin(run_.plant.input().joint_torque_nm), kAllJoints, told_.back().begin());
    std::ranges::copy(told_[told_.size() > dead_ ? told_.size() - 1 - dead_ : 0],
                      std::begin(run_.plant.input().joint_torque_nm));
  }
  Climber run_{sample_plan()};
  std::deque<std::array<double, kAllJoints>> told_;
  std::size_t dead_ = 0;
};

TEST_F(LateRobot, OneWhoseGainsBearItClimbs) {
  dead_ = 2;
  for (int i = 0; i < 100 && run_.core.state() != SupervisorState::kReady; ++i) step();
  for (int i = 0; i < 600; ++i) step();
  step(command_t::START);
  for (int i = 0; i < 1000; ++i) step();
  EXPECT_EQ(run_.core.state(), SupervisorState::kClimbing) << "fault " << run_.result.state.fault_code;
  EXPECT_GT(run_.result.state.plan_time_s, 0.0);
}

TEST_F(LateRobot, OneWhoseGainsDoNotBearItIsRefused) {
  dead_ = 6;
  for (int i = 0; i < 1000 && !run_.result.has_fault; ++i) step();
  ASSERT_TRUE(run_.result.has_fault);
  EXPECT_EQ(run_.result.fault.code, static_cast<int>(FaultCode::kJointLate));
  EXPECT_NEAR(run_.result.fault.limit, robot().delay_margin_s / 2.0, 1e-12);
  EXPECT_GT(run_.result.fault.value, robot().servo.dead_time_s);
  EXPECT_EQ(run_.core.state(), SupervisorState::kFault) << "the nodes hold by themselves";
  step(command_t::START);
  EXPECT_EQ(run_.result.command_verdict, CommandVerdict::kRefused);
}

/// Angles of joint 4 of RF that swing; true when it was told within `seconds`.
bool told(double width_rad, double frequency_Hz, double decay_1_s, double seconds, double drift_rad_s = 0.0) {
  OscillationWatch watch(robot(), 1);
  for (double t_s = 0.0; t_s < seconds; t_s += kDt_s) {
    JointVector q_rad = JointVector::Constant(0.5);
    q_rad[3] += drift_rad_s * t_s +
                width_rad / 2.0 * std::exp(-decay_1_s * t_s) * std::sin(2.0 * std::numbers::pi * frequency_Hz * t_s);
    watch.look(q_rad, kDt_s);
    if (!watch.fault()) continue;
    EXPECT_EQ(watch.fault().code, FaultCode::kJointOscillates);
    EXPECT_EQ(watch.fault().limb, 1);
    EXPECT_EQ(watch.fault().node, robot().can.nodes.joints[3]);
    if (drift_rad_s == 0.0) {
      EXPECT_NEAR(watch.fault().value, width_rad, 0.1 * width_rad);
    }
    return true;
  }
  return false;
}

TEST(OscillationWatch, AJointThatOscillatesIsToldWithinThreeTenths) {
  const double width_rad = 3.0 * robot().supervisor.oscillation_rad;
  for (const double frequency_Hz : {12.0, 16.0, 25.0, 50.0}) {
    EXPECT_TRUE(told(width_rad, frequency_Hz, 0.0, 0.3)) << frequency_Hz;
    EXPECT_TRUE(told(width_rad, frequency_Hz, 0.0, 0.3, 0.05)) << "while it is moved, at " << frequency_Hz;
  }
}

TEST(OscillationWatch, ShakingThatDiesDownOrIsSlowOrSmallIsNone) {
  const double width_rad = 3.0 * robot().supervisor.oscillation_rad;
  EXPECT_FALSE(told(10.0 * width_rad, 15.0, 6.0, 5.0));
  EXPECT_FALSE(told(10.0 * width_rad, 4.0, 0.0, 5.0));
  EXPECT_FALSE(told(0.8 * robot().supervisor.oscillation_rad, 20.0, 0.0, 5.0));
}

TEST(Oscillation, InHoldingItIsAnsweredByTheNodesOwnHold) {
  Climber run(sample_plan());
  ASSERT_TRUE(run.until(SupervisorState::kReady, 100));
  run.steps(800);
  run.step(command_t::START);
  run.steps(500);
  run.step(command_t::HOLD);
  ASSERT_EQ(run.core.state(), SupervisorState::kHolding);
  int cycles = 0;
  for (; cycles < 1000 && !run.result.has_fault; ++cycles) {
    const double before_rad = run.plant.input().joint_position_rad[10];
    run.plant.input().joint_position_rad[10] +=
        1.5 * robot().supervisor.oscillation_rad * std::sin(2.0 * std::numbers::pi * 20.0 * kDt_s * cycles);
    run.step();
    run.plant.input().joint_position_rad[10] = before_rad;
  }
  ASSERT_TRUE(run.result.has_fault);
  EXPECT_LE(cycles * kDt_s, 0.3);
  EXPECT_EQ(run.result.fault.code, static_cast<int>(FaultCode::kJointOscillates));
  EXPECT_EQ(run.result.fault.limb, 1);
  EXPECT_EQ(run.result.fault.node, robot().can.nodes.joints[3]);
  EXPECT_EQ(run.core.state(), SupervisorState::kFault);
}

}  // namespace
}  // namespace crux_test
