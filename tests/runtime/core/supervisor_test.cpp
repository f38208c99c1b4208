// The supervisor's states and the faults of msgs/faults.yaml.
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "core/robot/node_protocol.hpp"
#include "crux_msgs/bus_health_t.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

class SupervisorTest : public testing::Test {
 protected:
  SupervisorState update(Supervisor::Observation seen) {
    supervisor_.update(seen);
    return supervisor_.state();
  }
  void reach_climbing() {
    seen_.plan_loaded = seen_.may_take_over = true;
    update(seen_);
    seen_.command = command_t::START;
    ASSERT_EQ(update(seen_), SupervisorState::kClimbing);
    seen_.command = command_t::NONE;
    seen_.plan_started = true;
  }
  Supervisor::Observation with(FaultCode code) const {
    Supervisor::Observation seen = seen_;
    seen.faults = FaultEvent{code, 1, 2, 3.0, 4.0};
    return seen;
  }
  Supervisor::Observation with(int command) const {
    Supervisor::Observation seen = seen_;
    seen.command = command;
    return seen;
  }
  Supervisor supervisor_;
  Supervisor::Observation seen_;
};

TEST(Misfit, AlongTheFacesOfAGripThatHasSlippedIsASlide) {
  const StanceParameters& limits = robot().stance;
  const auto told = [&](double slid_m, double off_faces_m) {
    FaultMonitor monitor(robot());
    LoopErrors errors;
    errors.misfit_m[1] = 1.1 * limits.max_misfit_m;
    errors.misfit_off_faces_m[1] = off_faces_m;
    errors.slid_m[1] = slid_m;
    FaultList found;
    monitor.loop_faults(errors, 2.0 * robot().supervisor.persistence_s, found);
    return *found.begin();
  };
  EXPECT_EQ(told(0.0, 0.0).code, FaultCode::kStanceMisfit);
  EXPECT_EQ(told(0.002, 1.1 * limits.max_misfit_m).code, FaultCode::kStanceMisfit);
  const FaultEvent slid = told(0.002, 0.1 * limits.max_misfit_m);
  EXPECT_EQ(slid.code, FaultCode::kSlip);
  EXPECT_EQ(slid.limb, 1);
  EXPECT_GT(slid.value, slid.limit);
}

TEST_F(SupervisorTest, IdleUntilItMayTakeOver) {
  EXPECT_EQ(update(seen_), SupervisorState::kIdle);
  EXPECT_EQ(update(with(command_t::START)), SupervisorState::kIdle);
  EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kRefused);
  EXPECT_STREQ(supervisor_.refusal().text, "no plan is loaded");
  seen_.may_take_over = true;
  EXPECT_EQ(update(seen_), SupervisorState::kReady);
}

TEST_F(SupervisorTest, ClimbsHoldsResumesAndEndsHolding) {
  reach_climbing();
  EXPECT_EQ(update(with(command_t::HOLD)), SupervisorState::kHolding);
  EXPECT_EQ(update(with(command_t::START)), SupervisorState::kHolding);
  EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kRefused);
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kClimbing);
  seen_.plan_complete = seen_.arrived = true;
  EXPECT_EQ(update(seen_), SupervisorState::kHolding);
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kHolding);
  EXPECT_STREQ(supervisor_.refusal().text, "the plan is complete");
}

TEST_F(SupervisorTest, EachFaultLeadsWhereItsTableSays) {
  for (const crux_msgs::FaultInfo& info : crux_msgs::kFaults) {
    if (info.to == crux_msgs::robot_state_t::CLIMBING) continue;  // told by the program around the core
    supervisor_ = Supervisor();
    seen_ = {};
    reach_climbing();
    EXPECT_EQ(static_cast<int>(update(with(info.code))), info.to) << info.name;
    EXPECT_TRUE(supervisor_.news());
    EXPECT_EQ(supervisor_.fault().limb, 1);
    update(with(info.code));
    EXPECT_FALSE(supervisor_.news()) << "told once";
  }
}

TEST_F(SupervisorTest, AGraverFaultReplacesALighterOneAndNotTheOtherWay) {
  reach_climbing();
  update(with(FaultCode::kGripLost));
  EXPECT_EQ(update(with(FaultCode::kBodyError)), SupervisorState::kHolding);
  EXPECT_EQ(supervisor_.fault().code, FaultCode::kGripLost);
  EXPECT_EQ(update(with(FaultCode::kNodeSilent)), SupervisorState::kFault);
  EXPECT_EQ(supervisor_.fault().code, FaultCode::kNodeSilent);
  EXPECT_EQ(update(with(FaultCode::kGripLost)), SupervisorState::kFault);
}

TEST_F(SupervisorTest, AllFaultsStandEachIsToldOnceAndTheyAreClearedOneByOne) {
  reach_climbing();
  Supervisor::Observation both = seen_;
  both.faults.add({FaultCode::kGripLost, 0, 7, 1.0, 2.0});
  both.faults.add({FaultCode::kGripLost, 3, 7, 1.0, 2.0});
  EXPECT_EQ(update(both), SupervisorState::kHolding);
  EXPECT_EQ(supervisor_.news().limb, 0);
  both.faults = FaultEvent{FaultCode::kSlip, 1, 7, 1.0, 2.0};  // while holding for the first
  update(both);
  EXPECT_EQ(supervisor_.news().limb, 3);
  update(both);
  EXPECT_EQ(supervisor_.news().code, FaultCode::kSlip);
  update(both);
  EXPECT_FALSE(supervisor_.news());
  ASSERT_EQ(supervisor_.standing().size(), 3U);
  EXPECT_EQ(supervisor_.fault().limb, 0) << "the first leads";

  Supervisor::Observation clears = with(command_t::CLEAR_FAULT);
  clears.command_value = static_cast<double>(FaultCode::kGripLost);
  update(clears);
  EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kAccepted);
  EXPECT_FALSE(supervisor_.rearm_requested());
  EXPECT_EQ(supervisor_.fault().code, FaultCode::kSlip);
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kHolding) << "one stands still";
  update(clears);
  EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kRefused);
  clears.command_value = static_cast<double>(FaultCode::kSlip);
  update(clears);
  EXPECT_TRUE(supervisor_.rearm_requested());
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kClimbing);
}

TEST_F(SupervisorTest, AFaultThatComesAgainAfterTheLinkWasBackLeadsAgain) {
  reach_climbing();
  update(with(FaultCode::kNodeSilent));
  Supervisor::Observation back = seen_;
  back.link_restored = true;
  EXPECT_EQ(update(back), SupervisorState::kHolding);
  EXPECT_EQ(update(with(FaultCode::kNodeSilent)), SupervisorState::kFault);
  EXPECT_TRUE(supervisor_.news());
}

TEST_F(SupervisorTest, AfterAFaultOnlyClearAndResumeLeadOn) {
  reach_climbing();
  update(with(FaultCode::kEventTimeout));
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kHolding);
  EXPECT_STREQ(supervisor_.refusal().text, "a fault stands; clear it first");
  update(with(command_t::CLEAR_FAULT));
  EXPECT_TRUE(supervisor_.rearm_requested());
  EXPECT_EQ(supervisor_.fault().code, FaultCode::kNone);
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kClimbing);
}

TEST_F(SupervisorTest, OutOfFaultTheWayLeadsThroughHoldingWhenThePlanHadBegun) {
  reach_climbing();
  update(with(FaultCode::kNotFinite));
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kFault);
  EXPECT_EQ(update(with(command_t::CLEAR_FAULT)), SupervisorState::kHolding);
  supervisor_ = Supervisor();
  reach_climbing();
  seen_.plan_started = seen_.may_take_over = false;
  update(with(FaultCode::kNotFinite));
  EXPECT_EQ(update(with(command_t::CLEAR_FAULT)), SupervisorState::kIdle);
}

TEST_F(SupervisorTest, AFaultOfTheLinkEndsByItselfButTheRobotDoesNotMoveOn) {
  for (const crux_msgs::FaultInfo& info : crux_msgs::kFaults) {
    if (info.to != crux_msgs::robot_state_t::FAULT) continue;
    supervisor_ = Supervisor();
    seen_ = {};
    reach_climbing();
    update(with(info.code));
    seen_.link_restored = true;
    EXPECT_EQ(update(seen_), info.recovers ? SupervisorState::kHolding : SupervisorState::kFault) << info.name;
    EXPECT_EQ(supervisor_.rearm_requested(), info.recovers) << info.name;
    EXPECT_EQ(update(with(command_t::RESUME)), info.recovers ? SupervisorState::kHolding : SupervisorState::kFault);
    EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kRefused) << "somebody has to see it first";
    update(with(command_t::CLEAR_FAULT));
    EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kClimbing);
  }
}

TEST_F(SupervisorTest, BeforeThePlanHasBegunTheLinksReturnLeadsBackToReady) {
  for (const FaultCode code : {FaultCode::kBusOff, FaultCode::kBusPassive}) {  // one to FAULT, one to HOLDING
    supervisor_ = Supervisor();
    seen_ = {};
    seen_.plan_loaded = seen_.may_take_over = true;
    update(seen_);
    update(with(code));
    EXPECT_NE(supervisor_.state(), SupervisorState::kReady);
    update(seen_);
    EXPECT_NE(supervisor_.state(), SupervisorState::kReady) << "not before the link is well";
    seen_.link_restored = true;
    EXPECT_EQ(update(seen_), SupervisorState::kReady);
    EXPECT_FALSE(supervisor_.fault());
    seen_.link_restored = false;
    for (int i = 0; i < 10; ++i) EXPECT_EQ(update(seen_), SupervisorState::kReady);
  }
}

TEST_F(SupervisorTest, AStepBeginsThePlanAndEndsHolding) {
  seen_.plan_loaded = seen_.may_take_over = true;
  update(seen_);
  EXPECT_EQ(update(with(command_t::STEP)), SupervisorState::kClimbing);
  EXPECT_EQ(supervisor_.motion(), Motion::kStep);
  EXPECT_TRUE(supervisor_.departs());
  seen_.plan_started = true;
  update(seen_);
  EXPECT_FALSE(supervisor_.departs());
  seen_.arrived = true;
  EXPECT_EQ(update(seen_), SupervisorState::kHolding);
  EXPECT_EQ(update(with(command_t::STEP)), SupervisorState::kClimbing);
  seen_.arrived = false;
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kClimbing);
  EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kRefused);
}

TEST_F(SupervisorTest, AStepWhileClimbingSaysWhereToStop) {
  reach_climbing();
  EXPECT_EQ(update(with(command_t::STEP)), SupervisorState::kClimbing);
  EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kAccepted);
  EXPECT_EQ(supervisor_.motion(), Motion::kStep);
}

TEST_F(SupervisorTest, GoesBackOnlyFromHoldingAndWhereAVerifiedStanceLies) {
  const auto refusal = [this](int command) {
    update(with(command));
    EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kRefused);
    return std::string(supervisor_.refusal().text);
  };
  EXPECT_NE(refusal(command_t::REVERSE).find("only a robot that is holding"), std::string::npos);
  reach_climbing();
  seen_.can_reverse = true;
  EXPECT_NE(refusal(command_t::REVERSE).find("hold it first"), std::string::npos);
  update(with(FaultCode::kEventTimeout));
  EXPECT_NE(refusal(command_t::REVERSE).find("a fault stands"), std::string::npos);
  update(with(command_t::CLEAR_FAULT));
  seen_.can_reverse = false;
  EXPECT_NE(refusal(command_t::REVERSE).find("no verified stance"), std::string::npos);
  seen_.can_reverse = true;
  EXPECT_EQ(update(with(command_t::REVERSE)), SupervisorState::kClimbing);
  EXPECT_EQ(supervisor_.motion(), Motion::kReverse);
  EXPECT_NE(refusal(command_t::STEP).find("goes backward"), std::string::npos);
  seen_.arrived = true;
  EXPECT_EQ(update(seen_), SupervisorState::kHolding);
  seen_.walks = true;
  EXPECT_NE(refusal(command_t::REVERSE).find("a walk"), std::string::npos);
  EXPECT_NE(refusal(command_t::STEP).find("a walk"), std::string::npos);
}

TEST_F(SupervisorTest, NoHandTurnsBackWhileItsGraspIsPulled) {
  reach_climbing();
  seen_.can_reverse = seen_.testing = true;
  update(with(command_t::HOLD));
  EXPECT_EQ(update(with(command_t::REVERSE)), SupervisorState::kHolding);
  EXPECT_NE(std::string(supervisor_.refusal().text).find("being tested by a pull"), std::string::npos);
  EXPECT_EQ(update(with(command_t::RESUME)), SupervisorState::kClimbing);
  update(with(command_t::HOLD));
  seen_.testing = false;
  EXPECT_EQ(update(with(command_t::REVERSE)), SupervisorState::kClimbing);
  update(with(command_t::HOLD));
  seen_.testing = true;
  EXPECT_EQ(update(with(command_t::STEP)), SupervisorState::kHolding);
  EXPECT_EQ(update(with(command_t::REVERSE)), SupervisorState::kClimbing);
}

TEST_F(SupervisorTest, TheSpeedIsBetweenStandingStillAndThePlans) {
  Supervisor::Observation seen = with(command_t::SPEED);
  for (const double scale : {0.0, 0.3, 1.0}) {
    seen.command_value = scale;
    update(seen);
    EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kAccepted);
    EXPECT_EQ(supervisor_.speed_scale(), scale);
  }
  for (const double scale : {-0.1, 1.5, std::nan(""), std::numeric_limits<double>::infinity()}) {
    seen.command_value = scale;
    update(seen);
    EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kRefused);
    EXPECT_EQ(supervisor_.speed_scale(), 1.0);
  }
  seen.command_value = 1.5;
  update(seen);
  EXPECT_EQ(in_words(supervisor_.refusal()),
            "the speed scale would be 1.5, right is 0 (stand still) to 1 (as planned)");
}

TEST_F(SupervisorTest, AWalkKeepsThePlansSpeed) {
  seen_.plan_loaded = seen_.may_take_over = true;
  Supervisor::Observation slow = with(command_t::SPEED);
  slow.command_value = 0.5;
  EXPECT_EQ(update(slow), SupervisorState::kReady);
  seen_.walks = slow.walks = true;
  EXPECT_EQ(update(with(command_t::START)), SupervisorState::kReady);
  EXPECT_NE(std::string(supervisor_.refusal().text).find("crux speed 1"), std::string::npos);
  update(slow);
  EXPECT_EQ(supervisor_.verdict(), CommandVerdict::kRefused);
  slow.command_value = 1.0;
  update(slow);
  EXPECT_EQ(update(with(command_t::START)), SupervisorState::kClimbing);
}

TEST_F(SupervisorTest, WhatNodesReportWhileTheyAreRearmedIsThePast) {
  reach_climbing();
  Supervisor::Observation seen = with(FaultCode::kNodeHolds);
  seen.rearming = true;
  EXPECT_EQ(update(seen), SupervisorState::kClimbing);
}

class Faults : public testing::Test {
 protected:
  void SetUp() override {
    run_ = std::make_unique<Climber>(sample_plan());
    ASSERT_TRUE(run_->until(SupervisorState::kReady, 20));
    run_->steps(1000);
    run_->step(command_t::START);
    ASSERT_EQ(run_->core.state(), SupervisorState::kClimbing);
    run_->steps(150);
    ASSERT_GT(run_->result.state.plan_time_s, 0.1);
  }
  /// Steps until a fault is told; fails when another one comes or none in n cycles.
  void expect_fault(FaultCode code, SupervisorState next, int limb, int node, int n = 200) {
    for (int i = 0; i < n && !run_->result.has_fault; ++i) spoiled_step();
    ASSERT_TRUE(run_->result.has_fault);
    EXPECT_EQ(run_->result.fault.code, static_cast<int>(code));
    EXPECT_EQ(run_->result.fault.limb, limb);
    EXPECT_EQ(run_->result.fault.node, node);
    EXPECT_EQ(run_->core.state(), next);
    EXPECT_EQ(run_->result.state.fault_code, static_cast<int>(code));
  }
  void spoiled_step() {
    spoil_(input());
    run_->step();
  }
  void expect_all_joint_modes(NodeMode mode) const {
    for (const std::int8_t m : run_->result.output.joint_mode) EXPECT_EQ(m, static_cast<std::int8_t>(mode));
    for (const std::int8_t m : run_->result.output.gripper_mode) EXPECT_EQ(m, static_cast<std::int8_t>(mode));
  }
  crux_msgs::control_input_t& input() { return run_->plant.input(); }
  std::unique_ptr<Climber> run_;
  int spoiled_ = 0;
  std::function<void(crux_msgs::control_input_t&)> spoil_ = [](crux_msgs::control_input_t&) {};
};

TEST_F(Faults, ASilentNodeStopsControlAndTheNodesHold) {
  spoil_ = [](crux_msgs::control_input_t& in) { in.joint_fresh[9] = 0; };
  expect_fault(FaultCode::kNodeSilent, SupervisorState::kFault, 1, 3);
  expect_all_joint_modes(NodeMode::kHold);
  EXPECT_GT(run_->result.state.missed_cycles, robot().supervisor.silent_cycles);
}

TEST_F(Faults, SilenceOfAllNodesIsNotToldAsOneNodes) {
  spoil_ = [this](crux_msgs::control_input_t& in) {
    std::ranges::fill(in.joint_fresh, 0);
    std::ranges::fill(in.gripper_fresh, 0);
    if (spoiled_++ < 3) in.joint_fresh[0] = 1;  // one gets some last words in
  };
  expect_fault(FaultCode::kAllNodesSilent, SupervisorState::kFault, -1, 0);
  EXPECT_EQ(run_->result.fault.value, robot().supervisor.silent_cycles + 1);
}

TEST_F(Faults, SilenceOfAWholeBusIsToldAsItsNodes) {
  spoil_ = [](crux_msgs::control_input_t& in) {
    for (int j = 0; j < kJoints; ++j) in.joint_fresh[kJoints + j] = 0;
    in.gripper_fresh[1] = 0;
  };
  expect_fault(FaultCode::kNodeSilent, SupervisorState::kFault, 1, 1);
}

TEST_F(Faults, TheStateOfABusIsAFaultAtOnceAndTheGravestIsTold) {
  input().bus_state[1] = crux_msgs::bus_health_t::PASSIVE;
  input().bus_state[3] = crux_msgs::bus_health_t::OFF;
  expect_fault(FaultCode::kBusOff, SupervisorState::kFault, 3, 0, 1);
  expect_all_joint_modes(NodeMode::kHold);
}

TEST_F(Faults, OneCycleThatFoundNoRoomIsBridged) {
  for (int i = 0; i < 10; ++i) {
    input().bus_state[0] = i % 2 == 0 ? crux_msgs::bus_health_t::FULL : crux_msgs::bus_health_t::ACTIVE;
    run_->step();
  }
  EXPECT_EQ(run_->core.state(), SupervisorState::kClimbing);
  spoil_ = [](crux_msgs::control_input_t& in) { in.bus_state[0] = crux_msgs::bus_health_t::FULL; };
  expect_fault(FaultCode::kBusFull, SupervisorState::kFault, 0, 0, 2);
}

TEST_F(Faults, ABusThatIsBackLeadsToHoldingAndNeverToClimbing) {
  spoil_ = [](crux_msgs::control_input_t& in) { in.bus_state[2] = crux_msgs::bus_health_t::DOWN; };
  expect_fault(FaultCode::kBusDown, SupervisorState::kFault, 2, 0, 1);
  for (int i = 0; i < 100; ++i) spoiled_step();
  EXPECT_EQ(run_->core.state(), SupervisorState::kFault);
  input().bus_state[2] = crux_msgs::bus_health_t::ACTIVE;
  const int settle_cycles = static_cast<int>(robot().supervisor.settle_time_s * robot().can.rate_Hz);
  run_->steps(settle_cycles - 2);
  EXPECT_EQ(run_->core.state(), SupervisorState::kFault);
  run_->steps(4);
  EXPECT_EQ(run_->core.state(), SupervisorState::kHolding);
  run_->steps(2000);
  EXPECT_EQ(run_->core.state(), SupervisorState::kHolding);
  expect_all_joint_modes(NodeMode::kTrack);
  EXPECT_EQ(run_->step(command_t::RESUME).command_verdict, CommandVerdict::kRefused);
}

TEST_F(Faults, AFewLostStatusesAreBridged) {
  for (int i = 0; i < 200; ++i) {
    for (std::int8_t& fresh : input().joint_fresh) fresh = i % 4 == 0 ? 1 : 0;
    run_->step();
  }
  EXPECT_EQ(run_->core.state(), SupervisorState::kClimbing);
}

TEST_F(Faults, AnUnfitNodeIsNamed) {
  spoil_ = [](crux_msgs::control_input_t& in) { in.gripper_state[2] = static_cast<std::int8_t>(NodeState::kFault); };
  expect_fault(FaultCode::kNodeFault, SupervisorState::kFault, 2, 7);
}

TEST_F(Faults, AStoppedBridgeMakesANodeUnfit) {
  input().joint_faults[15] = 0x02;  // cause 11 of msgs/can
  expect_fault(FaultCode::kNodeFault, SupervisorState::kFault, 2, 2);
}

TEST_F(Faults, ALostThermometerMakesANodeUnfit) {
  input().gripper_faults[1] = 0x04;  // cause 12
  expect_fault(FaultCode::kNodeFault, SupervisorState::kFault, 1, 7);
}

TEST_F(Faults, ABoardThatIsNotCalibratedIsUnfit) {
  input().joint_faults[15] = 0x80;  // cause 13
  expect_fault(FaultCode::kNodeFault, SupervisorState::kFault, 2, 2);
}

TEST_F(Faults, TwoNodesWithOneNumberAreToldBeforeTheirSilence) {
  spoil_ = [](crux_msgs::control_input_t& in) {
    in.joint_faults[8] = kFaultTwoSenders;
    in.joint_fresh[8] = 0;
  };
  expect_fault(FaultCode::kNodeTwice, SupervisorState::kFault, 1, 2);
}

TEST_F(Faults, ANodeThatLatchedItsHoldMakesTheRobotHoldAndCanBeRearmed) {
  input().joint_faults[15] = kFaultCommandTimeout;
  expect_fault(FaultCode::kNodeHolds, SupervisorState::kHolding, 2, 2);
  run_->steps(10);
  EXPECT_EQ(run_->step(command_t::RESUME).command_verdict, CommandVerdict::kRefused);
  run_->step(command_t::CLEAR_FAULT);  // the plant obeys REARM by clearing the fault bit
  run_->steps(100);
  EXPECT_EQ(input().joint_faults[15], 0);
  expect_all_joint_modes(NodeMode::kTrack);
  EXPECT_EQ(run_->step(command_t::RESUME).command_verdict, CommandVerdict::kAccepted);
  EXPECT_TRUE(run_->until(SupervisorState::kHolding, 20000));
  EXPECT_EQ(run_->result.state.plan_complete, 1);
}

TEST_F(Faults, AfterASilentNodeIsBackTheClimbGoesOnWithoutAJolt) {
  for (int i = 0; i < 3600; ++i) run_->step();  // into LF's swing
  ASSERT_EQ(run_->result.reference[0].phase, static_cast<int>(LimbPhase::kLift));
  for (int i = 0; i < 20; ++i) {
    input().gripper_fresh[2] = 0;
    run_->step();
  }
  ASSERT_EQ(run_->core.state(), SupervisorState::kFault);
  input().gripper_fresh[2] = 1;
  EXPECT_EQ(run_->step(command_t::CLEAR_FAULT).state.supervisor_state, crux_msgs::robot_state_t::HOLDING);
  std::vector<double> before(input().joint_position_rad, input().joint_position_rad + kAllJoints);
  for (int i = 0; i < 500; ++i) {
    run_->step();
    for (int j = 0; j < kAllJoints; ++j) {
      ASSERT_LT(std::abs(input().joint_position_rad[j] - before[j]), 1.0 * 0.002) << "joint " << j << " cycle " << i;
      before[j] = input().joint_position_rad[j];
    }
  }
  expect_all_joint_modes(NodeMode::kTrack);
  EXPECT_EQ(run_->step(command_t::RESUME).command_verdict, CommandVerdict::kAccepted);
  EXPECT_TRUE(run_->until(SupervisorState::kHolding, 20000));
  EXPECT_EQ(run_->result.state.plan_complete, 1);
}

TEST_F(Faults, ANodeThatHoldsThoughToldToTrackIsNamed) {
  spoil_ = [](crux_msgs::control_input_t& in) { in.joint_state[0] = static_cast<std::int8_t>(NodeState::kHold); };
  expect_fault(FaultCode::kNodeHolds, SupervisorState::kHolding, 0, 1);
}

TEST_F(Faults, NodesOfAllLimbsThatHoldAreNotToldAsOneNode) {
  spoil_ = [](crux_msgs::control_input_t& in) {
    for (int l = 0; l < kLimbs; ++l) in.joint_faults[l * kJoints + 1] = kFaultCommandTimeout;
  };
  expect_fault(FaultCode::kAllNodesHold, SupervisorState::kHolding, -1, 0);
}

TEST_F(Faults, NodesOfThreeLimbsThatHoldAreToldAsTheFirst) {
  spoil_ = [](crux_msgs::control_input_t& in) {
    for (int l = 1; l < kLimbs; ++l) in.gripper_faults[l] = kFaultCommandTimeout;
  };
  expect_fault(FaultCode::kNodeHolds, SupervisorState::kHolding, 1, 7);
}

TEST_F(Faults, ASilentSensorMakesTheRobotHold) {
  spoil_ = [](crux_msgs::control_input_t& in) { in.ft_fresh[3] = 0; };
  expect_fault(FaultCode::kFtSilent, SupervisorState::kHolding, 3, 7);
  expect_all_joint_modes(NodeMode::kTrack);
}

TEST_F(Faults, ASensorWithoutANumberIsNotCalledSilent) {
  spoil_ = [](crux_msgs::control_input_t& in) { in.ft_status[3] = kFtNotReady; };
  expect_fault(FaultCode::kFtNotReady, SupervisorState::kHolding, 3, 7);
  EXPECT_EQ(run_->result.fault.value, kFtNotReady) << "what came";
}

TEST_F(Faults, AnOverloadedSensorMakesTheRobotHold) {
  spoil_ = [](crux_msgs::control_input_t& in) { in.ft_status[1] = kFtOverload; };
  expect_fault(FaultCode::kFtOverload, SupervisorState::kHolding, 1, 7);
}

TEST_F(Faults, NotANumberStopsControlAndNeverReachesTheNodes) {
  spoil_ = [](crux_msgs::control_input_t& in) { in.joint_position_rad[4] = std::nan(""); };
  expect_fault(FaultCode::kNotFinite, SupervisorState::kFault, -1, 0);
  for (const double q : run_->result.output.joint_position_rad) EXPECT_TRUE(std::isfinite(q));
  for (const double t : run_->result.output.joint_torque_nm) EXPECT_TRUE(std::isfinite(t));
}

TEST_F(Faults, AJointThatDoesNotFollowIsNamed) {
  run_->steps(3600);  // into LF's swing: nothing else is amiss where its joint goes
  double limp_rad = input().joint_position_rad[1];
  spoil_ = [&limp_rad](crux_msgs::control_input_t& in) { in.joint_position_rad[1] = limp_rad -= 0.01; };
  expect_fault(FaultCode::kTrackingError, SupervisorState::kHolding, 0, 2);
}

TEST_F(Faults, ALostGripIsNamed) {
  spoil_ = [](crux_msgs::control_input_t& in) { loosen(in, 2); };
  expect_fault(FaultCode::kGripLost, SupervisorState::kHolding, 2, 7);
  EXPECT_NEAR(run_->result.fault.value, 0.5, 1e-12);
}

TEST_F(Faults, AGripThatFlickersIsNotLost) {
  for (int i = 0; i < 300; ++i) {
    if (i % 3 != 0) loosen(input(), 2);
    run_->step();
  }
  EXPECT_EQ(run_->core.state(), SupervisorState::kClimbing);
}

TEST_F(Faults, AnEventThatDoesNotComeEndsInHolding) {
  spoil_ = [this](crux_msgs::control_input_t& in) {  // LF's fingers are stuck
    const GripperDescription& gripper = robot().gripper;
    in.finger_opening_m[0] = 0.03;
    in.finger_force_n[0] =
        std::max(gripper.stiffness_N_m * (0.03 - run_->result.output.finger_opening_m[0]), -gripper.max_finger_force_N);
  };
  expect_fault(FaultCode::kEventTimeout, SupervisorState::kHolding, 0, 0, 10000);
  EXPECT_NEAR(run_->result.state.plan_time_s, 7.0, 0.01);
}

TEST_F(Faults, HoldingFreezesThePlanAndKeepsTheStanceControlled) {
  run_->step(command_t::HOLD);
  const double time_s = run_->result.state.plan_time_s;
  run_->steps(500);
  EXPECT_EQ(run_->result.state.plan_time_s, time_s);
  expect_all_joint_modes(NodeMode::kTrack);
  run_->step(command_t::RESUME);
  run_->steps(10);
  EXPECT_GT(run_->result.state.plan_time_s, time_s);
}

}  // namespace
}  // namespace crux_test
