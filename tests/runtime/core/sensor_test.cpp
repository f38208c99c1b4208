// Sensors that say wrong things, and a hold that is gone: what is told, and what the robot does then.
#include <algorithm>
#include <utility>

#include "fixture.hpp"

namespace crux_test {
namespace {

using crux_msgs::command_t;

constexpr int kIntoSwing = 3600;  // LF is in the air

class Sensors : public Climbing {
 protected:
  /// Cycles until a fault is told, at most n; what `spoil` does to the inputs comes before each.
  template <class Spoil>
  int until_fault(Spoil spoil, int n) {
    for (int i = 1; i <= n; ++i) {
      spoil(run_.plant.input());
      if (run_.step().has_fault) return i;
    }
    return n + 1;
  }
  void expect_fault(FaultCode code, int limb, int node) const {
    EXPECT_EQ(run_.result.fault.code, static_cast<int>(code));
    EXPECT_EQ(run_.result.fault.limb, limb);
    EXPECT_EQ(run_.result.fault.node, node);
    EXPECT_EQ(run_.core.state(), SupervisorState::kHolding);
  }
  Vector3 offset_m(int limb) const { return Vector3(run_.result.telemetry[limb].admittance_offset_m); }
  Vector3 planned_force_N(int limb) const { return Vector3(run_.result.telemetry[limb].force_reference_w_n); }
};

TEST_F(Sensors, AnEncoderThatJumpsIsNamedAtOnceAndItsJointStaysWhereItIs) {
  const double before_rad = run_.result.output.joint_position_rad[15];
  double jump_rad = 0.1;
  const auto jumped = [&](crux_msgs::control_input_t& in) {
    in.joint_position_rad[15] += std::exchange(jump_rad, 0.0);
  };
  EXPECT_EQ(until_fault(jumped, 10), 1);
  expect_fault(FaultCode::kEncoderJumped, 2, 2);
  EXPECT_NEAR(run_.result.output.joint_position_rad[15] - before_rad, 0.1, 1e-3);  // as its encoder counts now
}

TEST_F(Sensors, AJointAsQuickAsItMayBeIsNoJump) {
  const double most_rad = robot().limbs[2].joints[1].velocity_rad_s * run_.plant.input().dt_s;
  EXPECT_EQ(until_fault([&](crux_msgs::control_input_t& in) { in.joint_position_rad[15] += most_rad; }, 3), 4);
}

TEST_F(Sensors, AJointThatWasAskedLateHasTurnedFurther) {
  const double late_s = 0.9 * robot().supervisor.max_late_s;
  const double most_rad = robot().limbs[2].joints[1].velocity_rad_s * (run_.plant.input().dt_s + late_s);
  run_.plant.input().late_s = late_s;
  ASSERT_FALSE(run_.step().has_fault);
  run_.plant.input().late_s = 0.0;
  run_.plant.input().joint_position_rad[15] += most_rad;
  EXPECT_FALSE(run_.step().has_fault) << run_.result.fault.code;
  run_.plant.input().joint_position_rad[15] += most_rad;
  EXPECT_TRUE(run_.step().has_fault);
  expect_fault(FaultCode::kEncoderJumped, 2, 2);
}

TEST_F(Sensors, AnEncoderThatFreezesInASwingIsNamed) {
  run_.steps(kIntoSwing);
  const double frozen_rad = run_.plant.input().joint_position_rad[1];
  const auto freeze = [&](crux_msgs::control_input_t& in) { in.joint_position_rad[1] = frozen_rad; };
  EXPECT_LT(until_fault(freeze, 500), 250);
  expect_fault(FaultCode::kEncoderFrozen, 0, 2);
}

TEST_F(Sensors, ALimbWhoseEncoderFrozeStandsStillAndTheBodyIsWhereTheOthersSayItIs) {
  const double frozen_rad = run_.plant.input().joint_position_rad[15];
  const auto freeze = [&](crux_msgs::control_input_t& in) { in.joint_position_rad[15] = frozen_rad; };
  ASSERT_LT(until_fault(freeze, 12000), 12000);
  expect_fault(FaultCode::kEncoderFrozen, 2, 2);
  const auto commands_rad = [&] {
    return Eigen::Map<const JointVector>(run_.result.output.joint_position_rad + 2 * kJoints).eval();
  };
  const auto body_m = [&] { return Vector3(run_.result.state.body_position_w_m); };
  run_.step();
  const JointVector before_rad = commands_rad();
  const Vector3 before_m = body_m();
  for (int i = 0; i < 1000; ++i) {
    freeze(run_.plant.input());
    run_.plant.input().joint_position_rad[14] += 2e-5 * i;  // to 20 mrad: what its other joints say
    run_.plant.input().ft_force_g_n[7] += 20.0;
    run_.step();
  }
  EXPECT_EQ(commands_rad(), before_rad);
  EXPECT_LT((body_m() - before_m).norm(), 2.5e-4);
}

TEST_F(Sensors, AJointThatIsToStandStillMayReadTheSameForEver) {
  run_.step(command_t::HOLD);
  const double still_rad = run_.plant.input().joint_position_rad[1];
  EXPECT_EQ(until_fault([&](crux_msgs::control_input_t& in) { in.joint_position_rad[1] = still_rad; }, 2000), 2001);
}

/// Of one joint, whose command moves on at 20 mrad/s after it was to stand.
class EncoderReadings : public testing::Test {
 protected:
  static constexpr double kDt_s = 0.002, kCount_rad = 1.07e-5;

  void stand(double noise_rad) {
    for (int i = 0; i < 1000; ++i) watch_.look(1, read(noise_rad), 0.0, kDt_s);
  }
  double read(double noise_rad) { return kCount_rad * std::round(random_.uniform(-noise_rad, noise_rad) / kCount_rad); }
  /// How far [rad] the command gets until the encoder counts as frozen, at most to `most_rad`.
  template <class Reading>
  double until_frozen_rad(double most_rad, Reading reading) {
    double command_rad = 0.0;
    while (command_rad < most_rad && !watch_.frozen()) watch_.look(1, reading(), command_rad += 4e-5, kDt_s);
    return command_rad;
  }

  EncoderWatch watch_{robot(), 2};
  Random random_;
};

TEST_F(EncoderReadings, AJointThatSticksHasNoFrozenEncoder) {
  const double stiction_Nm = 1.5, breaks_away_rad = stiction_Nm / robot().servo.position_gain_Nm_rad[1];
  stand(0.0);
  EXPECT_GE(until_frozen_rad(breaks_away_rad, [] { return 0.0; }), breaks_away_rad);
  stand(5e-5);
  EXPECT_GE(until_frozen_rad(1.0, [&] { return read(5e-5); }), 1.0) << "with the noise of a real encoder";
}

TEST_F(EncoderReadings, AnEncoderThatHoveredAndReadsTheSameHasFrozen) {
  stand(5e-5);
  EXPECT_LT(until_frozen_rad(1.0, [] { return 0.0; }), 0.0035);
}

TEST_F(EncoderReadings, NoFrictionHoldsAJointAgainstAnyTorque) {
  stand(0.0);
  EXPECT_LT(until_frozen_rad(1.0, [] { return 0.0; }), 0.030);
}

TEST_F(Sensors, AForceTorqueSensorThatReadsZeroIsNamedAndNotYieldedTo) {
  run_.steps(kIntoSwing);
  const auto zero = [](crux_msgs::control_input_t& in) {
    std::fill_n(in.ft_force_g_n + 9, 3, 0.0);
    std::fill_n(in.ft_moment_g_nm + 9, 3, 0.0);
  };
  EXPECT_LT(until_fault(zero, 500), 50);  // 0.1 s
  expect_fault(FaultCode::kFtImplausible, 3, 7);
  const Vector3 before_m = offset_m(3);
  for (int i = 0; i < 1000; ++i) {
    zero(run_.plant.input());
    run_.step();
  }
  EXPECT_LT((offset_m(3) - before_m).norm(), 2e-4);
}

TEST_F(Sensors, GearsThatStickSayNothingAgainstAForceTorqueSensor) {
  constexpr double kSticks_Nm = 1.5;
  run_.steps(kIntoSwing);
  const auto stick = [](crux_msgs::control_input_t& in) {
    for (int j = 0; j < kAllJoints; ++j) in.joint_torque_nm[j] += j % 2 == 0 ? kSticks_Nm : -kSticks_Nm;
  };
  EXPECT_GT(until_fault(stick, 500), 500);
}

TEST_F(Sensors, AForceTorqueSensorThatFreezesInASwingIsNamedAsItsLimbTakesUpLoad) {
  run_.steps(kIntoSwing);
  const crux_msgs::control_input_t still = run_.plant.input();
  const auto freeze = [&still](crux_msgs::control_input_t& in) {
    std::copy_n(still.ft_force_g_n, 3, in.ft_force_g_n);
    std::copy_n(still.ft_moment_g_nm, 3, in.ft_moment_g_nm);
  };
  ASSERT_LT(until_fault(freeze, 12000), 12000);
  expect_fault(FaultCode::kFtImplausible, 0, 7);
  EXPECT_LT(offset_m(0).norm(), 5e-3) << "it was yielded to before";
}

TEST_F(Sensors, ALimbWhoseHoldIsGoneBearsNothingMoreAndTheOthersItsShare) {
  const double before_N = planned_force_N(2).norm();
  ASSERT_GT(before_N, 5.0);
  const auto gone = [](crux_msgs::control_input_t& in) {
    loosen(in, 2);
    std::fill_n(in.ft_force_g_n + 6, 3, 0.0);
  };
  EXPECT_LT(until_fault(gone, 100), 30);
  expect_fault(FaultCode::kGripLost, 2, 7);
  gone(run_.plant.input());
  run_.step();
  EXPECT_EQ(planned_force_N(2).norm(), 0.0);
  Vector3 sum_N = Vector3::Zero();
  for (int l = 0; l < kLimbs; ++l) sum_N += planned_force_N(l);
  const Vector3 weight_N = robot().total_mass_kg * Vector3(sample_plan().gravity_w_m_s2);
  EXPECT_LT((sum_N + weight_N).norm(), 0.1);
  run_.steps(5);
  run_.step(command_t::CLEAR_FAULT);  // somebody has looked
  run_.steps(100);
  EXPECT_GT(planned_force_N(2).norm(), 5.0);
}

TEST_F(Sensors, ALimbInTheAirGoesBackToItsHoldWhenAnotherHasLostItsOwn) {
  const auto phase = [&] { return static_cast<LimbPhase>(run_.result.reference[0].phase); };
  for (int i = 0; i < 6000 && phase() != LimbPhase::kSwing; ++i) run_.step();
  ASSERT_EQ(phase(), LimbPhase::kSwing);
  const auto gone = [](crux_msgs::control_input_t& in) { loosen(in, 2); };
  ASSERT_LE(until_fault(gone, 200), 200);
  expect_fault(FaultCode::kGripLost, 2, 7);
  for (int i = 0; i < 6000 && phase() != LimbPhase::kStance; ++i) {
    gone(run_.plant.input());
    run_.step();  // what this does to the others is told beside it
    ASSERT_EQ(run_.result.state.fault_code, static_cast<int>(FaultCode::kGripLost));
    ASSERT_EQ(run_.core.state(), SupervisorState::kHolding);
  }
  EXPECT_EQ(phase(), LimbPhase::kStance);
  EXPECT_GT(run_.plant.input().finger_force_n[0], robot().supervisor.min_stance_force_N);
  EXPECT_GT(planned_force_N(0).norm(), 5.0);
  double plan_time_s = 0.0;
  for (int i = 0; i < 1500; ++i) {
    if (i == 1000) plan_time_s = run_.result.state.plan_time_s;
    gone(run_.plant.input());
    run_.step();
  }
  EXPECT_EQ(run_.result.state.plan_time_s, plan_time_s) << "in the stance before the clock stands";
}

TEST_F(Sensors, AGripperThatHasClosedTakesUpLoadWhenAnotherHasLostItsHold) {
  const auto closes = [&] { return run_.result.reference[0].phase == static_cast<int>(LimbPhase::kClose); };
  const auto presses = [&] { return run_.plant.input().finger_force_n[0] > robot().control.contact_force_N; };
  for (int i = 0; i < 12000 && !(closes() && planned_force_N(0).norm() > 0.0); ++i) run_.step();
  ASSERT_TRUE(closes() && presses());
  ASSERT_LT(planned_force_N(0).norm(), 1.0) << "its pull has just begun";
  const auto gone = [](crux_msgs::control_input_t& in) { loosen(in, 2); };
  ASSERT_LE(until_fault(gone, 200), 200);
  expect_fault(FaultCode::kGripLost, 2, 7);
  for (int i = 0; i < 2000; ++i) {
    gone(run_.plant.input());
    run_.step();
    ASSERT_TRUE(presses()) << "cycle " << i;
    ASSERT_EQ(run_.core.state(), SupervisorState::kHolding);
    if (i == 5) {
      EXPECT_GT(planned_force_N(0).norm(), 5.0) << "at once";
    }
  }
  EXPECT_EQ(run_.result.reference[0].phase, static_cast<int>(LimbPhase::kStance));
  EXPECT_GT(planned_force_N(0).norm(), 5.0);
}

TEST_F(Sensors, AGripAboutToOpenTakesItsLoadBackWhenAnotherHasLostItsHold) {
  const auto gives_off = [&] { return run_.result.reference[0].phase == static_cast<int>(LimbPhase::kUnload); };
  for (int i = 0; i < 6000 && !(gives_off() && run_.result.reference[0].load == 0.0); ++i) run_.step();
  ASSERT_TRUE(gives_off());
  ASSERT_LT(planned_force_N(0).norm(), 1.0);
  const auto gone = [](crux_msgs::control_input_t& in) { loosen(in, 2); };
  ASSERT_LE(until_fault(gone, 200), 200);
  expect_fault(FaultCode::kGripLost, 2, 7);
  for (int i = 0; i < 500; ++i) {
    gone(run_.plant.input());
    run_.step();
    ASSERT_TRUE(gives_off());
    if (i >= 5) {
      ASSERT_GT(planned_force_N(0).norm(), 5.0) << "cycle " << i;
    }
  }
}

TEST_F(Sensors, AGripperThatComesDownGoesOnAndClosesWhereItStandsWhenAnotherHasLostItsHold) {
  const auto phase = [&] { return static_cast<LimbPhase>(run_.result.reference[0].phase); };
  for (int i = 0; i < 12000 && phase() != LimbPhase::kDescend; ++i) run_.step();
  ASSERT_EQ(phase(), LimbPhase::kDescend);
  const double down_s = run_.result.state.plan_time_s, above_rad = run_.plant.input().joint_position_rad[1];
  const auto gone = [&](crux_msgs::control_input_t& in) {
    loosen(in, 2);
    in.joint_position_rad[1] = above_rad;  // it never comes to where its hold seems to be
  };
  ASSERT_LE(until_fault(gone, 200), 200);
  expect_fault(FaultCode::kGripLost, 2, 7);
  for (int i = 0; i < 2000; ++i) {
    gone(run_.plant.input());
    run_.step();
    ASSERT_GE(run_.result.state.plan_time_s, down_s);
    ASSERT_EQ(run_.core.state(), SupervisorState::kHolding);
  }
  EXPECT_EQ(phase(), LimbPhase::kClose);
  EXPECT_LT(run_.result.output.finger_opening_m[0], run_.result.output.finger_opening_m[1]) << "its fingers close";
}

TEST_F(Sensors, AFingerForceThatReadsZeroIsNamedAndTheGripHoldsOnByItsOpening) {
  const double opening_m = run_.result.output.finger_opening_m[1];
  const auto zero = [](crux_msgs::control_input_t& in) { in.finger_force_n[1] = 0.0; };
  EXPECT_LT(until_fault(zero, 500), 50);
  expect_fault(FaultCode::kFingerForceImplausible, 1, 7);
  for (int i = 0; i < 1000; ++i) {
    zero(run_.plant.input());
    run_.step();
  }
  EXPECT_EQ(run_.result.state.fault_code, static_cast<int>(FaultCode::kFingerForceImplausible));  // and not a lost grip
  EXPECT_NEAR(run_.result.output.finger_opening_m[1], opening_m, 1e-3);
}

TEST_F(Sensors, AFingerForceThatFreezesHighDoesNotOpenTheGrip) {
  const double frozen_N = 58.0, least_m = run_.result.output.finger_opening_m[1];
  const auto freeze = [&](crux_msgs::control_input_t& in) { in.finger_force_n[1] = frozen_N; };
  for (int i = 0; i < 1000; ++i) {
    freeze(run_.plant.input());
    run_.step();
    EXPECT_LT(run_.result.output.finger_opening_m[1], least_m + 5e-4);
  }
}

TEST_F(Sensors, AFingerForceThatFreezesHighIsNamedWhenItsFingersAreOpen) {
  const double frozen_N = run_.plant.input().finger_force_n[0];
  ASSERT_GT(frozen_N, robot().supervisor.max_finger_residual_N);
  const auto freeze = [&](crux_msgs::control_input_t& in) { in.finger_force_n[0] = frozen_N; };
  ASSERT_LT(until_fault(freeze, kIntoSwing), kIntoSwing);
  expect_fault(FaultCode::kFingerForceImplausible, 0, 7);
  EXPECT_EQ(run_.result.reference[0].load, 0.0);  // before it could pass for a grip
}

TEST_F(Sensors, FingersThatJamInTheAirGripNothingHoweverHardTheyPress) {
  run_.steps(kIntoSwing);
  const double jammed_m = run_.plant.input().finger_opening_m[0];
  const auto jam = [&](crux_msgs::control_input_t& in) {
    in.finger_opening_m[0] = jammed_m;
    if (run_.result.reference[0].phase == static_cast<int>(LimbPhase::kClose)) in.finger_force_n[0] = 58.0;
  };
  ASSERT_LT(until_fault(jam, 20000), 20000);
  expect_fault(FaultCode::kEventTimeout, 0, 0);
  EXPECT_EQ(run_.result.reference[0].load, 0.0);
}

TEST_F(Sensors, AHoldThatIsNotThereIsMissingAndNoSensorIsBlamed) {
  run_.steps(kIntoSwing);
  const double stop_m = robot().gripper.opening_m.low;
  const auto miss = [&](crux_msgs::control_input_t& in) {
    in.finger_opening_m[0] = std::max(run_.result.output.finger_opening_m[0], stop_m);
    in.finger_force_n[0] = 0.0;
  };
  ASSERT_LT(until_fault(miss, 20000), 20000);
  expect_fault(FaultCode::kHoldMissing, 0, 7);
  EXPECT_LT(run_.result.fault.value, run_.result.fault.limit);
  EXPECT_EQ(run_.result.reference[0].load, 0.0);
}

TEST(Start, AHoldThatIsNotThereIsMissingBeforeTheClimbBegins) {
  Climber run{sample_plan()};
  ASSERT_TRUE(run.until(SupervisorState::kReady, 20));
  run.step(command_t::START);
  for (int i = 0; i < 3000 && !run.result.has_fault; ++i) {
    crux_msgs::control_input_t& in = run.plant.input();
    in.finger_opening_m[1] = std::max(run.result.output.finger_opening_m[1], robot().gripper.opening_m.low);
    in.finger_force_n[1] = 0.0;
    run.step();
  }
  ASSERT_TRUE(run.result.has_fault);
  EXPECT_EQ(run.result.fault.code, static_cast<int>(FaultCode::kHoldMissing));
  EXPECT_EQ(run.result.fault.limb, 1);
  EXPECT_LT(run.result.fault.value, run.result.fault.limit);
  EXPECT_EQ(run.result.state.plan_time_s, 0.0);
}

TEST_F(Sensors, ACycleThatBeginsTooLateIsTold) {
  const double limit_s = robot().supervisor.max_late_s;
  run_.plant.input().late_s = 0.9 * limit_s;
  EXPECT_FALSE(run_.step().has_fault);
  run_.plant.input().late_s = 1.1 * limit_s;
  EXPECT_TRUE(run_.step().has_fault);
  expect_fault(FaultCode::kCycleLate, -1, 0);
}

}  // namespace
}  // namespace crux_test
