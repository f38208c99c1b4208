// A runtime that starts with its robot on the wall: what the run before left is believed where joints, fingers and
// force/torque sensors agree with it, and gone on with.
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "core/robot/node_protocol.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;
using crux_msgs::control_input_t;
using crux_msgs::restart_t;

constexpr int kLook = 900;    // cycles in which a new run has decided: longer than settle_time_s
constexpr int kEngage = 600;  // cycles in which its control has taken over
constexpr int kAge = 40;      // cycles before the end in which was left what is found

/// LF is in the air, half a swing on its way, as the first run ends.
class Restart : public testing::Test {
 protected:
  Restart() : first_(sample_plan()), second_(sample_plan()) {}

  void SetUp() override {
    ASSERT_TRUE(first_.until(SupervisorState::kReady, 20));
    first_.steps(1000);
    first_.step(command_t::START);
    climb_until(3.8);
    ASSERT_EQ(first_.result.reference[0].phase, static_cast<int>(LimbPhase::kLift));
  }

  void climb_until(double plan_time_s) {
    for (int i = 0; i < 20000 && first_.result.state.plan_time_s < plan_time_s * sample_plan().dt_s; ++i) {
      first_.step();
      if (i % kAge == 0) first_.core.leave(left_);
    }
  }

  /// The nodes hold, and the new run hears what they measure.
  void look(const std::function<void(control_input_t&)>& change = {}) {
    second_.plant = first_.plant;
    control_input_t& in = second_.plant.input();
    std::fill(std::begin(in.joint_state), std::end(in.joint_state), static_cast<std::int8_t>(NodeState::kHold));
    std::fill(std::begin(in.joint_faults), std::end(in.joint_faults), kFaultCommandTimeout);
    if (change) change(in);
    second_.core.restore(left_);
    for (int i = 0; i < kLook && told_.code == 0; ++i) {
      ++in.cycle;
      second_.core.step(in, second_.result);
      if (second_.result.has_fault) told_ = second_.result.fault;
    }
  }

  /// Control takes over. Until its feed-forward has, a node holds the load by the distance of its setpoint.
  void engage() {
    const control_input_t loaded = second_.plant.input();
    for (int i = 0; i < kEngage; ++i) {
      second_.plant.input().operator_command = command_t::NONE;
      second_.core.step(second_.plant.input(), second_.result);
      CycleResult felt = second_.result;
      for (int j = 0; j < kAllJoints; ++j) {
        if (felt.output.joint_mode[j] != static_cast<int>(NodeMode::kTrack)) continue;
        const double left_Nm = loaded.joint_torque_nm[j] - felt.output.joint_torque_nm[j];
        felt.output.joint_position_rad[j] -= left_Nm / robot().servo.position_gain_Nm_rad[j % kJoints];
      }
      second_.plant.obey(felt);
      std::copy_n(loaded.joint_torque_nm, kAllJoints, second_.plant.input().joint_torque_nm);
    }
  }

  void expect_refused(int limb, const std::string& part) {
    EXPECT_EQ(told_.code, static_cast<int>(FaultCode::kRestartRefused));
    EXPECT_EQ(told_.limb, limb);
    EXPECT_NE(in_words(second_.core.restart_refusal()).find(part), std::string::npos)
        << in_words(second_.core.restart_refusal());
    EXPECT_EQ(second_.core.state(), SupervisorState::kIdle);
    EXPECT_TRUE(second_.core.as_new());
    EXPECT_EQ(second_.core.load_plan(sample_plan()), "");
  }

  Climber first_, second_;
  restart_t left_{};
  crux_msgs::fault_t told_{};
};

TEST_F(Restart, WithALimbInTheAirTheClimbGoesOn) {
  look();
  EXPECT_EQ(told_.code, static_cast<int>(FaultCode::kRestarted));
  EXPECT_NEAR(told_.value, first_.result.state.plan_time_s, 0.05);  // though it was left before
  EXPECT_EQ(second_.core.state(), SupervisorState::kHolding);
  EXPECT_EQ(second_.result.reference[0].phase, static_cast<int>(LimbPhase::kLift));

  const control_input_t before = second_.plant.input();
  engage();
  EXPECT_EQ(second_.result.output.joint_mode[0], static_cast<int>(NodeMode::kTrack));
  for (int j = 0; j < kAllJoints; ++j)
    EXPECT_NEAR(second_.plant.input().joint_position_rad[j], before.joint_position_rad[j], 0.004) << j;
  second_.step(command_t::RESUME);
  EXPECT_EQ(second_.result.command_verdict, CommandVerdict::kAccepted) << in_words(second_.result.command_refusal);
  for (int i = 0; i < 20000 && second_.core.state() == SupervisorState::kClimbing; ++i) second_.step();
  EXPECT_EQ(second_.result.state.fault_code, 0);
  EXPECT_EQ(second_.result.state.plan_complete, 1);
}

TEST_F(Restart, TheWayBackIsOpen) {
  look();
  engage();
  second_.step(command_t::REVERSE);
  EXPECT_EQ(second_.result.command_verdict, CommandVerdict::kAccepted) << in_words(second_.result.command_refusal);
  for (int i = 0; i < 20000 && second_.core.state() == SupervisorState::kClimbing; ++i) second_.step();
  EXPECT_EQ(second_.result.state.fault_code, 0);
  EXPECT_EQ(second_.result.reference[0].phase, static_cast<int>(LimbPhase::kStance));
}

TEST_F(Restart, AFaultThatStoodStandsOn) {
  left_.fault.code = static_cast<std::int16_t>(FaultCode::kSlip);
  left_.fault.limb = 2;
  look();
  EXPECT_EQ(told_.code, static_cast<int>(FaultCode::kSlip));
  EXPECT_EQ(told_.limb, 2);
  second_.steps(100);
  second_.step(command_t::RESUME);
  EXPECT_EQ(second_.result.command_verdict, CommandVerdict::kRefused);
}

TEST_F(Restart, NoSensorIsBelievedAlone) {
  look([](control_input_t& in) { in.finger_force_n[3] = 0.0; });
  expect_refused(3, "its fingers press with 0 N");
}

TEST_F(Restart, FingersThatStandElsewhereAreOnAnotherHold) {
  look([](control_input_t& in) { in.finger_opening_m[2] += 0.006; });
  expect_refused(2, "its fingers stand at");
}

TEST_F(Restart, SensorsThatFeelNoWeightAreOfARobotInAHand) {
  look([](control_input_t& in) { std::fill(std::begin(in.ft_force_g_n), std::end(in.ft_force_g_n), 0.0); });
  expect_refused(-1, "beside the robot's weight");
}

TEST_F(Restart, AGripperOffItsHoldIsNotOnIt) {
  look([](control_input_t& in) { in.joint_position_rad[kJoints + 1] += 0.4; });
  EXPECT_EQ(told_.code, static_cast<int>(FaultCode::kRestartRefused));
  EXPECT_EQ(second_.core.state(), SupervisorState::kIdle);
}

TEST_F(Restart, ALimbInTheAirThatPressesIsNotWhereItWas) {
  look([](control_input_t& in) {
    in.finger_force_n[0] = 30.0;
    in.finger_opening_m[0] = 0.02;
  });
  expect_refused(0, "it was in the air");
}

TEST_F(Restart, UntilAllNodesAreHeardNothingIsDecided) {
  look([](control_input_t& in) { in.joint_fresh[8] = 0; });
  EXPECT_EQ(told_.code, 0);
  EXPECT_EQ(second_.core.state(), SupervisorState::kIdle);
  second_.step(command_t::START);
  EXPECT_EQ(second_.result.command_verdict, CommandVerdict::kRefused);
}

TEST(LeftBehind, ThereIsNothingBeforeTheClimb) {
  Climber run(sample_plan());
  restart_t left{};
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.core.leave(left);
  EXPECT_EQ(left.plan_id, "");
}

}  // namespace
}  // namespace crux_test
