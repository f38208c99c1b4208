// The rigid fit of the stance: grippers that stand still on the wall under a body that moves, and one that does not.
#include "core/estimate/stance_fit.hpp"

#include <Eigen/Geometry>

#include <utility>

#include "core/estimate/compliance_estimator.hpp"
#include "core/estimate/drift_watch.hpp"
#include "core/estimate/slip_watch.hpp"
#include "core/estimate/weight_balance.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

constexpr double kDt_s = 0.002;

/// Grippers on a wall, and a body that moves as climbs do.
class Stance : public testing::Test {
 protected:
  Stance() {
    Random random(7);
    for (int l = 0; l < kLimbs; ++l) {
      gripper_W_[l].position_m = {l < 2 ? 0.14 : -0.14, l % 2 == 0 ? 0.36 : -0.36, 0.035};
      gripper_W_[l].position_m += random.vector(0.05);
      gripper_W_[l].rotation = rotation_z(random.uniform(-1.5, 1.5)) * random.rotation(0.05);
    }
  }
  /// Cycles in which each gripper moves by `slide_W_m` and turns by `turn_rad` in a second.
  void cycles(int n, int limb = 0, const Vector3& slide_m_s = Vector3::Zero(),
              const Vector3& turn_rad_s = Vector3::Zero()) {
    for (int i = 0; i < n; ++i) {
      if (!stands_) body_s_ += kDt_s;
      const Pose body_W = {rotation_exp({0.05 * std::sin(body_s_), 0.03 * body_s_, 0.04 * body_s_}),
                           {0.02 * body_s_, 0.02 * std::sin(2.0 * body_s_), 0.18}};
      Pose& moved_W = gripper_W_[limb];
      moved_W.position_m += kDt_s * moved_W.rotation * slide_m_s;
      moved_W.rotation = orthonormalised(moved_W.rotation * rotation_exp(kDt_s * turn_rad_s));
      PerLimb<FittedLimb> limbs;
      for (int l = 0; l < kLimbs; ++l) {
        states_[l].gripper_B = body_W.inverse() * gripper_W_[l];
        states_[l].jacobian_B.setIdentity();
        limbs[l] = {&states_[l], JointVector::Constant(idle_[l] ? 0.1 : 5.0), force_B_N_, holds_[l]};
      }
      fit_.update(limbs, kDt_s);
    }
  }
  double most_off_m() const {
    double most = 0.0;
    for (int l = 0; l < kLimbs; ++l) most = std::max(most, fit_.since_contact(l).shift_G_m.norm());
    return most;
  }

  PerLimb<Pose> gripper_W_;
  PerLimb<bool> holds_{true, true, true, true};
  StanceFit fit_{robot().stance, robot().gripper.pad_radius_m};
  double body_s_ = 0.0;
  bool stands_ = false;                  ///< the body
  Vector3 force_B_N_ = Vector3::Zero();  ///< on each gripper
  PerLimb<bool> idle_{};                 ///< its joints bear no torque: they may go through their play
  PerLimb<LimbState> states_;
};

TEST_F(Stance, GrippersThatStandStillFitHoweverTheBodyMoves) {
  cycles(2000);
  EXPECT_LT(most_off_m(), 1e-6);
}

TEST_F(Stance, AGripperThatSlidesIsNamedWithItsWay) {
  cycles(100);
  for (int l = 0; l < kLimbs; ++l) {
    const Vector3 before_m = fit_.since_contact(l).shift_G_m;
    const double turned_rad = fit_.since_contact(l).turn_G_rad.x();
    cycles(25, l, {0.0, 0.02, -0.03}, {0.1, 0.0, 0.0});
    EXPECT_EQ(fit_.odd_limb(), l);
    const Vector3 slid_m = fit_.since_contact(l).shift_G_m - before_m;
    EXPECT_LT((slid_m - 0.05 * Vector3(0.0, 0.02, -0.03)).norm(), 2e-4);
    EXPECT_NEAR(fit_.since_contact(l).turn_G_rad.x() - turned_rad, 0.005, 1e-3);
    cycles(2000);  // until it is forgotten
  }
}

TEST_F(Stance, WhatMovedBeforeANewPlanIsTakenOverDoesNotCount) {
  cycles(600);
  cycles(600, 2, {0.0, 0.03, 0.0});
  ASSERT_GT(most_off_m(), robot().stance.max_misfit_m);
  fit_.begin_anew();
  cycles(600);
  EXPECT_LT(most_off_m(), 1e-6);
  EXPECT_FALSE(fit_.moved(2).alone);
  cycles(25, 1, {0.0, 0.02, 0.0});
  EXPECT_EQ(fit_.odd_limb(), 1);
}

TEST_F(Stance, OfThreeGripsTheOneThatSlidesIsNamedToo) {
  holds_[2] = false;
  cycles(500);
  cycles(25, 1, {0.0, 0.05, 0.0});
  EXPECT_EQ(fit_.odd_limb(), 1);
  EXPECT_TRUE(fit_.moved(0).alone);
  EXPECT_NEAR(fit_.moved(0).way_m.x(), 0.0025, 1e-4);
}

TEST_F(Stance, TheLimbThatMovedSinceContactIsToldWhicheverMovesNow) {
  holds_[2] = false;
  cycles(500);
  cycles(250, 1, Vector3::Zero(), {0.2, 0.0, 0.0});
  cycles(25, 3, {0.0, 0.005, 0.0});
  EXPECT_EQ(fit_.odd_limb(), 3);
  EXPECT_NEAR(fit_.misfit_m(1), 0.1 * 0.25, 5e-4);
  EXPECT_GT(fit_.since_contact(3).shift_G_m.norm(), 0.01);  // by what the others make of it
  EXPECT_EQ(fit_.misfit_m(0) + fit_.misfit_m(3), 0.0);
}

TEST_F(Stance, TwoGripsCannotTellWhichOfThemMoves) {
  holds_[2] = holds_[3] = false;
  cycles(500);
  cycles(25, 1, {0.0, 0.05, 0.0});
  EXPECT_EQ(fit_.odd_limb(), -1);
}

TEST_F(Stance, ALimbThatTakesAnotherHoldIsCountedFromThere) {
  cycles(100);
  holds_[0] = false;
  cycles(100, 0, {0.3, -0.2, 0.1}, {0.0, 0.0, 0.5});
  holds_[0] = true;
  cycles(500);
  EXPECT_LT(most_off_m(), 1e-6);
}

TEST_F(Stance, WhatIsSlowMovesLittleInAWindowButCountsSinceContact) {
  cycles(5000, 3, {0.0, 0.0005, 0.0});
  EXPECT_NEAR(fit_.moved(2).way_m.norm(), 0.0005, 1e-4);
  EXPECT_NEAR(fit_.since_contact(3).shift_G_m.y(), 0.005, 2e-4);
}

TEST_F(Stance, AHoldThatGivesWaySlowlyIsNamedWithItsWay) {
  for (const bool four : {true, false}) {
    holds_[3] = four;
    for (int l = 0; l < 3; ++l) {
      cycles(6000);
      cycles(1600, l, {0.0006, -0.0009, 0.0});  // for the second window
      const StanceFit::Drift& drift = fit_.drift(1);
      EXPECT_TRUE(drift.steady) << four;
      EXPECT_EQ(drift.limb, l) << four;
      EXPECT_EQ(drift.joint, -1) << four;
      EXPECT_LT((drift.shift_G_m - 3.0 * Vector3(0.0006, -0.0009, 0.0)).norm(), 3e-4) << four;
      EXPECT_FALSE(fit_.drift(2).steady) << "it has not gone on for 8 s";
    }
    cycles(6000);
    for (int window = 0; window < StanceFit::kDrifts; ++window)
      EXPECT_LT(fit_.drift(window).shift_G_m.norm(), 1e-5) << "it is over";
  }
}

TEST_F(Stance, WhatMovesAtOnceHasNotMovedSlowly) {
  cycles(6000);
  for (int i = 0; i < 4; ++i) {
    cycles(50, 1, {0.0, 0.05, 0.0});  // as through play
    for (int k = 0; k < 120; ++k) {
      cycles(25);
      for (int window = 0; window < StanceFit::kDrifts - 1; ++window) ASSERT_FALSE(fit_.drift(window).steady) << k;
    }
  }
}

TEST_F(Stance, AnEncoderThatDriftsIsNamedByItsJoint) {
  const Pose body_W = {Matrix3::Identity(), {0.0, 0.0, 0.18}};
  const std::array<Vector3, kPlacing> hinge_B_m = {Vector3{0.1, 0.1, 0.0}, {0.1, 0.13, 0.0}, {0.1, 0.25, 0.1},
                                                   {0.1, 0.3, 0.05},       {0.1, 0.35, 0.0}, {0.1, 0.36, -0.1}};
  const std::array<Vector3, kPlacing> axis = {Vector3::UnitZ(), Vector3::UnitX(), Vector3::UnitX(),
                                              Vector3::UnitX(), Vector3::UnitY(), Vector3::UnitZ()};
  for (int joint = 0; joint < kPlacing; ++joint) {
    StanceFit fit(robot().stance, robot().gripper.pad_radius_m);
    double drifted_rad = 0.0;
    for (int i = 0; i < 4400; ++i) {
      drifted_rad += 0.001 * kDt_s;
      PerLimb<FittedLimb> limbs;
      for (int l = 0; l < kLimbs; ++l) {
        states_[l].gripper_B = body_W.inverse() * gripper_W_[l];
        states_[l].jacobian_B.setZero();
        for (int j = 0; j < kPlacing; ++j) {
          const Vector3 arm_m = states_[l].gripper_B.position_m - hinge_B_m[j];
          states_[l].jacobian_B.col(j) << axis[j].cross(arm_m), axis[j];
        }
        limbs[l] = {&states_[l], JointVector::Constant(5.0), Vector3::Zero(), true};
      }
      Pose& seen_B = states_[2].gripper_B;
      const Matrix3 turn = rotation_exp(drifted_rad * axis[joint]);
      seen_B = {turn * seen_B.rotation, hinge_B_m[joint] + turn * (seen_B.position_m - hinge_B_m[joint])};
      fit.update(limbs, kDt_s);
    }
    EXPECT_TRUE(fit.drift(2).steady) << joint;
    EXPECT_EQ(fit.drift(2).limb, 2) << joint;
    EXPECT_EQ(fit.drift(2).joint, joint);
    EXPECT_NEAR(fit.drift(2).joint_rad, 0.008, 3e-4) << joint;
  }
}

TEST_F(Stance, WhatSeemsToMoveInMotionIsSuspectedAndToldOnlyWhereTheRobotStands) {
  DriftWatch watch(robot().stance);
  const auto look = [&](int n, double creep_m_s) {
    for (int i = 0; i < n; ++i) {
      cycles(1, 2, {0.0, creep_m_s, 0.0});
      watch.update(fit_, {}, true, true, kDt_s);
    }
  };
  cycles(1000);
  look(600, 0.0015);
  EXPECT_EQ(watch.suspected(), 2) << "1.2 mm";
  look(400, 0.0);
  EXPECT_EQ(watch.suspected(), 2);
  look(400, 0.0);
  EXPECT_EQ(watch.suspected(), -1) << "it was none";
  look(2000, 0.0015);
  EXPECT_EQ(watch.told().limb, -1) << "the body moves";
  stands_ = true;
  look(400, 0.0015);
  EXPECT_EQ(watch.told().limb, -1);
  look(200, 0.0015);
  EXPECT_EQ(watch.told().limb, 2);
  EXPECT_EQ(watch.told().joint, -1);
  EXPECT_NEAR(watch.told().moved / watch.told().within_s, 0.0015, 1e-4);
}

TEST_F(Stance, WhatGivesUnderALoadThatChangesDoesNotCreep) {
  DriftWatch watch(robot().stance);
  stands_ = true;
  cycles(1000);
  for (int i = 0; i < 2000; ++i) {
    force_B_N_.x() = 0.02 * i;
    cycles(1, 2, {0.0, 0.0008, 0.0});
    watch.update(fit_, {}, true, false, kDt_s);
  }
  EXPECT_EQ(watch.told().limb, -1);
}

TEST_F(Stance, WhatAnIdleJointsPlayExplainsIsNoSlip) {
  cycles(500);
  idle_.fill(true);  // each joint moves its gripper along, or about, one axis
  cycles(25, 1, {0.0, 0.05, 0.0});
  EXPECT_LT(fit_.moved(0).way_m.norm(), 1e-4);
  EXPECT_GT(fit_.play_m(), 0.0012);
}

TEST_F(Stance, AGripperHasSlidHoweverItTurnedWhereItsJointsAreLoaded) {
  cycles(600);
  cycles(100, 1, {0.0, 0.05, 0.0}, {0.15, 0.0, 0.0});
  EXPECT_NEAR(fit_.slid_m(1), 0.010, 5e-4);
  EXPECT_LT(fit_.slid_m(0), 0.003);
}

TEST_F(Stance, AGripperHasSlidByWhatPlayOfItsIdleJointsDoesNotExplain) {
  idle_[2] = true;  // each joint moves its gripper along one axis of the body, by 10 mm of play at most
  cycles(200, 2, {0.0, 0.05, 0.0});
  const Matrix3& rotation_BG = states_[2].gripper_B.rotation;
  const Vector3 way_B_m = rotation_BG.col(1) * 0.020;
  const Vector3 left_B_m = way_B_m - way_B_m.cwiseMax(-0.010).cwiseMin(0.010);
  EXPECT_NEAR(fit_.slid_m(2), (rotation_BG.transpose() * left_B_m).tail<2>().norm(), 5e-4);
}

TEST_F(Stance, WhatPlayOfTheOthersLeavesInDoubtIsNotSlid) {
  cycles(200, 2, {0.0, 0.05, 0.0});
  EXPECT_NEAR(fit_.slid_m(2), 0.020, 5e-4);
  idle_ = {true, true, false, true};
  cycles(25, 1, {0.0, 0.05, 0.0});  // play is seen
  EXPECT_LT(fit_.slid_m(2), 0.018);
  EXPECT_GT(fit_.slid_m(2), 0.010);
}

TEST_F(Stance, WhatSeemsToMoveWhereItsGripIsKnownToBeLessUsedHasNotSlid) {
  SlipWatch watch(robot().stance), unknown(robot().stance);  // of the latter, after the first slip what is used
  const auto cycles_with = [&](int n, double used, const Vector3& slide_m_s) {
    for (int i = 0; i < n; ++i) {
      cycles(1, 1, slide_m_s);
      watch.update(1, fit_, true, used, kDt_s);
      unknown.update(1, fit_, true, used < 0.5 ? 0.0 : used, kDt_s);
    }
  };
  cycles_with(600, 0.5, Vector3::Zero());
  cycles_with(40, 0.5, {0.0, 0.05, 0.0});
  EXPECT_TRUE(watch.slips());
  cycles_with(700, 0.2, Vector3::Zero());
  EXPECT_FALSE(watch.slips());
  cycles_with(1250, 0.2, {0.0, 0.002, 0.0});
  EXPECT_FALSE(watch.slips());
  cycles_with(700, 0.2, Vector3::Zero());
  cycles_with(30, 0.5, {0.0, 0.05, 0.0});
  EXPECT_TRUE(watch.slips());
  EXPECT_NEAR(watch.slid_m(), 0.007, 5e-4);  // 4 and 3 mm; 5 mm were play
  EXPECT_GT(unknown.slid_m(), 0.011);        // one sensor that says nothing hides no slide
}

TEST_F(Stance, AGripThatMovesSqueezesAndOneWhoseFrictionIsUsedUpAsWellSlips) {
  SlipWatch fresh(robot().stance), used_up(robot().stance);
  double first_used = 0.8;
  const auto watch = [&](int n, double used, const Vector3& slide_m_s) {
    for (int i = 0; i < n; ++i) {
      cycles(1, 1, slide_m_s);
      fresh.update(1, fit_, true, std::exchange(first_used, 0.1 * used), kDt_s);
      used_up.update(1, fit_, true, used, kDt_s);
    }
  };
  watch(600, 0.5, Vector3::Zero());
  EXPECT_FALSE(fresh.squeezes() || used_up.squeezes());
  EXPECT_EQ(used_up.borne(), 0.5);
  EXPECT_EQ(used_up.slipped_at(), 0.0);
  watch(40, 0.5, {0.0, 0.05, 0.0});
  EXPECT_EQ(used_up.slipped_at(), 0.5);
  EXPECT_TRUE(fresh.squeezes() && !fresh.slips());
  EXPECT_TRUE(used_up.squeezes() && used_up.slips());
  EXPECT_NEAR(used_up.slid_m(), 0.004, 5e-4);
  EXPECT_LT(used_up.relief(), 1.0);
  EXPECT_FALSE(used_up.out_of_hand());
  watch(700, 0.5, Vector3::Zero());  // it stands
  EXPECT_FALSE(used_up.slips());
  EXPECT_EQ(used_up.relief(), 1.0);
  EXPECT_TRUE(used_up.squeezes());
  watch(100, 0.5, {0.0, 0.05, 0.0});
  EXPECT_TRUE(used_up.out_of_hand());
}

TEST_F(Stance, AGripperThatTurnsOnItsFacesSlipsByTheWayOfItsPadsRim) {
  SlipWatch turns(robot().stance), tips(robot().stance);
  const auto cycles_with = [&](int n, const Vector3& turn_rad_s) {
    for (int i = 0; i < n; ++i) {
      cycles(1, 1, Vector3::Zero(), turn_rad_s);
      turns.update(1, fit_, true, 0.5, kDt_s);
      tips.update(2, fit_, true, 0.5, kDt_s);
    }
  };
  cycles_with(600, Vector3::Zero());
  cycles_with(150, {0.2, 0.0, 0.0});
  EXPECT_TRUE(turns.slips());
  EXPECT_NEAR(turns.slid_m(), 0.06 * robot().gripper.pad_radius_m, 1e-4);
  EXPECT_EQ(turns.slipped_at(), 0.5);
  EXPECT_LT(turns.relief(), 1.0);
  EXPECT_FALSE(turns.out_of_hand() || tips.squeezes());
  EXPECT_NEAR(fit_.slid_m(1), 0.06 * robot().gripper.pad_radius_m, 1e-4);
  EXPECT_NEAR(fit_.misfit_m(1), 0.06 * 0.25, 5e-4);
  EXPECT_LT(fit_.misfit_off_faces_m(1), 1e-3);
  cycles_with(700, Vector3::Zero());
  EXPECT_FALSE(turns.slips());
  cycles_with(1400, {0.2, 0.0, 0.0});
  EXPECT_TRUE(turns.out_of_hand());
}

TEST_F(Stance, AGripperThatTipsOffItsFacesDoesNotSlip) {
  SlipWatch tips(robot().stance);
  for (int i = 0; i < 1200; ++i) {
    cycles(1, 1, Vector3::Zero(), i < 600 ? Vector3(0.0, 0.0, 0.0) : Vector3(0.0, 0.1, 0.1));
    tips.update(1, fit_, true, 0.5, kDt_s);
  }
  EXPECT_EQ(tips.slid_m(), 0.0);
  EXPECT_GT(fit_.misfit_off_faces_m(1), 0.02);
}

TEST_F(Stance, AGripThatBearsMoreThanItSlippedAtIsAsGoodAsThat) {
  SlipWatch watch(robot().stance);
  const auto cycles_with = [&](int n, double used, const Vector3& slide_m_s) {
    for (int i = 0; i < n; ++i) {
      cycles(1, 1, slide_m_s);
      watch.update(1, fit_, true, used, kDt_s);
    }
  };
  cycles_with(600, 0.2, Vector3::Zero());
  cycles_with(40, 0.2, {0.0, 0.05, 0.0});
  EXPECT_TRUE(watch.slips());
  cycles_with(100, 0.9, Vector3::Zero());  // while it still counts as slipping, nothing is borne
  EXPECT_TRUE(watch.slips());
  EXPECT_EQ(watch.slipped_at(), 0.2);
  cycles_with(700, 0.1, Vector3::Zero());
  EXPECT_FALSE(watch.slips());
  EXPECT_EQ(watch.slipped_at(), 0.2);
  cycles_with(150, 0.6, Vector3::Zero());
  EXPECT_EQ(watch.slipped_at(), 0.6);
}

TEST(Compliance, IsTheSlopeOfShiftOverForceOfTheseGripsWhereTheForceChanges) {
  ComplianceEstimator estimator;
  Random random(3);
  double time_s = 0.0;
  const auto bear = [&](unsigned grips, double swing_N, double compliance_m_N, const Vector3& from_m) {
    for (int i = 0; i < 1000; ++i) {
      time_s += kDt_s;
      const Vector3 force_N = Vector3(0.0, 2.0, -30.0) + swing_N * std::sin(3.0 * time_s) * Vector3(0.0, 0.6, -0.8);
      estimator.update(grips, force_N + random.vector(0.3), from_m - compliance_m_N * force_N + random.vector(1e-5),
                       kDt_s);
    }
    return estimator.compliance_m_N();
  };
  EXPECT_EQ(bear(0xF, 1.0, 1e-4, Vector3::Zero()), 0.0);  // nothing to tell it by
  EXPECT_NEAR(bear(0xF, 20.0, 1e-4, Vector3::Zero()), 1e-4, 2e-6);
  EXPECT_NEAR(bear(0x7, 1.0, 3e-4, {0.0, 0.004, 0.0}), 1e-4, 2e-6);  // counted from other grips: no shift of this one
  EXPECT_NEAR(bear(0x7, 20.0, 3e-4, {0.0, 0.004, 0.0}), 3e-4, 6e-6);
  EXPECT_EQ(bear(0x0, 20.0, 3e-4, Vector3::Zero()), 0.0);
}

/// Four limbs that share a weight at their middle, and what one of them feels besides.
class Balance : public testing::Test {
 protected:
  void cycles(double seconds, const Wrench& besides, int limb) {
    PerLimb<Wrench> felt_W;
    for (Wrench& wrench : felt_W) wrench.force_N = -0.25 * weight_N_;
    felt_W[limb] = felt_W[limb] + besides;
    for (int i = 0; i < static_cast<int>(seconds / kDt_s); ++i)
      balance_.update(felt_W, grippers_W_m_, Vector3::Zero(), weight_N_, kDt_s);
  }
  const Vector3 weight_N_{-70.0, 0.0, -70.0};
  PerLimb<Vector3> grippers_W_m_{Vector3(0.14, 0.36, -0.15), Vector3(0.14, -0.36, -0.15), Vector3(-0.14, 0.36, -0.15),
                                 Vector3(-0.14, -0.36, -0.15)};
  WeightBalance balance_{robot().stance, robot().force_torque};
};

TEST_F(Balance, WhatIsThereFromTheBeginningIsLearnt) {
  cycles(1.0, {{0.0, 5.0, 0.0}, {0.0, 0.0, 0.5}}, 2);
  EXPECT_NEAR(balance_.unbalanced_W().force_N.y(), 5.0, 1e-9);
  EXPECT_LT(balance_.change_N(), 1e-6);
}

TEST_F(Balance, ASensorThatDiesIsNamedByTheForceThatIsMissingAtItsLimb) {
  cycles(1.0, {}, 0);
  cycles(0.1, {0.25 * weight_N_, {0.0, 0.0, 0.0}}, 1);
  EXPECT_GT(balance_.change_N(), robot().stance.max_unbalanced_N);
  EXPECT_EQ(balance_.limb(), 1);
}

TEST_F(Balance, APushOnTheBodyIsNoLimbs) {
  cycles(1.0, {}, 0);
  cycles(0.1, {{0.0, 30.0, 0.0}, grippers_W_m_[0].cross(Vector3(0.0, -30.0, 0.0))}, 0);  // at the centre of mass
  EXPECT_NEAR(balance_.change_N(), 30.0, 0.5);
  EXPECT_EQ(balance_.limb(), -1);
}

}  // namespace
}  // namespace crux_test
