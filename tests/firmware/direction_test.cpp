// The test of a motor's direction against a rotor of one inertia: dv = Kt i t / J, whatever pushes besides.
#include <gtest/gtest.h>

#include <cmath>

extern "C" {
#include "drive/direction.h"
}

namespace crux::firmware {
namespace {

constexpr float kPulse = 0.7F;
constexpr float kKt_J = 216.0F;  // rad/s2 by an ampere: 0.05 Nm/A, 0.3 kg m2 behind a gear of 36
constexpr float kTick = 1e-3F;

struct Rotor {
  crux_direction direction{};
  float sign = 1.0F;    // of the torque by the quadrature current
  float across = 0.0F;  // torque by the direct current, which makes none in a motor that is wired rightly
  float load_rad_s2 = 0.0F;
  bool locked = false;
  float loop_A = 0.0F;
  float speed = 0.0F;
  float flowed_A = 0.0F;

  Rotor() { crux_direction_init(&direction, kPulse); }
  void run(int ticks) {
    for (int k = 0; k < ticks; ++k) {
      const bool direct = direction.direct;
      const float added_A = crux_direction_tick(&direction, speed, flowed_A, loop_A);
      EXPECT_LE(std::abs(added_A), kPulse);
      flowed_A = loop_A + (direct ? 0.0F : added_A);
      const float turning_A = sign * flowed_A + (direct ? across * added_A : 0.0F);
      speed += locked ? 0.0F : kTick * (kKt_J * turning_A + load_rad_s2);
    }
  }
};

constexpr int kTry = 33;  // ticks

TEST(Direction, AMotorThatIsWiredRightlyPassesInTwoTries) {
  Rotor rotor;
  rotor.run(2 * kTry - 1);
  EXPECT_EQ(rotor.direction.verdict, CRUX_DIRECTION_ASKED);
  rotor.run(1);
  EXPECT_EQ(rotor.direction.verdict, CRUX_DIRECTION_RIGHT);
}

TEST(Direction, TwoAnswersOfTheWrongSignDoNot) {
  Rotor rotor;
  rotor.sign = -1.0F;
  rotor.run(3 * kTry - 1);
  EXPECT_EQ(rotor.direction.verdict, CRUX_DIRECTION_ASKED);
  rotor.run(1);
  EXPECT_EQ(rotor.direction.verdict, CRUX_DIRECTION_WRONG);
}

// Swapped phases: torque by -cos 2 theta of the quadrature current, and by -sin 2 theta of the direct one.
TEST(Direction, SwappedPhasesAreFoundAtNearlyEveryAngle) {
  for (int degrees = 0; degrees < 360; degrees += 5) {
    const auto twice = static_cast<float>(2.0 * degrees * 3.14159265358979 / 180.0);
    Rotor rotor;
    rotor.sign = -std::cos(twice);
    rotor.across = -std::sin(twice);
    rotor.run(6 * kTry);
    const bool alike = rotor.sign > 0.0F && std::abs(std::tan(twice)) < 0.6F;
    if (!alike) {
      EXPECT_EQ(rotor.direction.verdict, CRUX_DIRECTION_WRONG) << degrees;
    }
  }
}

TEST(Direction, ALoadThatStaysCancels) {
  for (const float load : {-2000.0F, 2000.0F}) {
    for (const float sign : {-1.0F, 1.0F}) {
      Rotor rotor;
      rotor.load_rad_s2 = load;
      rotor.sign = sign;
      rotor.run(6 * kTry);
      EXPECT_EQ(rotor.direction.verdict, sign > 0.0F ? CRUX_DIRECTION_RIGHT : CRUX_DIRECTION_WRONG) << load;
    }
  }
}

TEST(Direction, WhatTheLoopAddsIsCounted) {
  Rotor rotor;
  for (int k = 0; k < 2 * kTry; ++k) {
    rotor.loop_A = (k % kTry < 16) ? 0.0F : 0.2F;
    rotor.run(1);
  }
  EXPECT_EQ(rotor.direction.verdict, CRUX_DIRECTION_RIGHT);
}

TEST(Direction, NothingIsDecidedOfALockedShaftOrALoadedLoop) {
  Rotor locked;
  locked.locked = true;
  locked.run(6 * kTry);
  EXPECT_EQ(locked.direction.verdict, CRUX_DIRECTION_UNCHECKED);
  Rotor loaded;
  loaded.loop_A = 2.0F * kPulse;
  loaded.sign = -1.0F;
  loaded.run(6 * kTry);
  EXPECT_EQ(loaded.direction.verdict, CRUX_DIRECTION_UNCHECKED);
  EXPECT_EQ(crux_direction_tick(&loaded.direction, 0.0F, 0.0F, 0.0F), 0.0F);
}

// Answers of either sign are noise.
TEST(Direction, OneWrongAnswerAloneDecidesNothing) {
  Rotor rotor;
  rotor.sign = -1.0F;
  rotor.run(kTry);
  rotor.sign = 1.0F;
  rotor.run(2 * kTry);
  EXPECT_EQ(rotor.direction.verdict, CRUX_DIRECTION_RIGHT);
}

}  // namespace
}  // namespace crux::firmware
