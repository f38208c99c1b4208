// Encoder: turns, speed, senseless samples, homing.
#include <gtest/gtest.h>

#include <random>

#include "motor_models.hpp"

namespace crux::firmware {
namespace {

struct Turning {
  Pmsm rotor;
  crux_encoder encoder{};

  Turning() {
    crux_encoder_init(&encoder, &rotor.motor, kPwmPeriod, 0.0F);
    sample();
  }
  void sample(bool valid = true) { crux_encoder_step(&encoder, rotor.encoder(), valid); }
  void turn(double speed, int periods) {
    for (int k = 0; k < periods; ++k) {
      rotor.angle += speed * static_cast<double>(kPwmPeriod);
      sample();
    }
  }
  [[nodiscard]] double error() const { return crux_encoder_position_rad(&encoder) - rotor.angle; }
  [[nodiscard]] double count() const { return encoder.rad_per_count; }
};

TEST(Encoder, CountsWholeTurnsBothWays) {
  Turning turning;
  turning.turn(300.0, 20000);
  EXPECT_NEAR(turning.error(), 0.0, turning.count() * 1.1);
  EXPECT_GT(turning.rotor.angle, 40 * 2 * std::numbers::pi);
  turning.turn(-350.0, 40000);
  EXPECT_NEAR(turning.error(), 0.0, turning.count() * 1.1);
  EXPECT_LT(turning.rotor.angle, -60 * 2 * std::numbers::pi);
}

TEST(Encoder, SpeedHasNoLagAtConstantSpeed) {
  for (const double speed : {0.5, 20.0, 300.0, -150.0}) {
    Turning turning;
    turning.turn(speed, 2000);
    double sum = 0.0;
    for (int k = 0; k < 2000; ++k) {
      turning.turn(speed, 1);
      sum += turning.encoder.speed_rad_s;
      EXPECT_NEAR(turning.encoder.speed_rad_s, speed, 0.5 + 1e-3 * std::abs(speed));
    }
    EXPECT_NEAR(sum / 2000, speed, 0.02 + 1e-4 * std::abs(speed));
  }
}

TEST(Encoder, SpeedFollowsAJumpLikeTwoEqualPoles) {
  // Tracking loop (s + w)^2: speed(t) = v (1 - (1 + w t) exp(-w t)) with the zero of the position correction left out.
  constexpr double kPoles = 1000.0;
  Turning turning;
  for (int k = 1; k <= 200; ++k) {
    turning.turn(200.0, 1);
    const double t = kPoles * k * static_cast<double>(kPwmPeriod);
    EXPECT_NEAR(turning.encoder.speed_rad_s, 200.0 * (1.0 - (1.0 + t) * std::exp(-t)), 200.0 * 0.04) << k;
  }
}

TEST(Encoder, RefusesSamplesThatCannotBe) {
  Turning turning;
  turning.turn(100.0, 4000);
  for (int k = 0; k < 500; ++k) {
    turning.rotor.angle += 100.0 * static_cast<double>(kPwmPeriod);
    if (k % 10 == 0) {
      const std::uint32_t wrong = (turning.rotor.encoder() + 5000) % 16384;
      crux_encoder_step(&turning.encoder, wrong, true);
    } else if (k % 10 == 5) {
      turning.sample(false);
    } else {
      turning.sample();
    }
    ASSERT_NEAR(turning.error(), 0.0, 3 * turning.count()) << k;
    ASSERT_NEAR(turning.encoder.speed_rad_s, 100.0, 2.0);
  }
  EXPECT_FALSE(turning.encoder.lost);
}

TEST(Encoder, IsLostAfterAMillisecondOfNonsenseAndStaysSo) {
  Turning turning;
  turning.turn(50.0, 1000);
  for (int k = 0; k < 20; ++k) {
    turning.sample(false);
  }
  EXPECT_FALSE(turning.encoder.lost);
  turning.sample(false);
  EXPECT_TRUE(turning.encoder.lost);
  turning.turn(50.0, 100);
  EXPECT_TRUE(turning.encoder.lost);
}

TEST(Encoder, HomingFindsTheTurnFromACoarseSensor) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> angle(-100.0, 100.0);
  std::uniform_real_distribution<double> coarse_error(-1.5, 1.5);  // within a quarter turn of the rotor
  for (int k = 0; k < 1000; ++k) {
    Turning turning;
    turning.rotor.angle = angle(random);
    crux_encoder_init(&turning.encoder, &turning.rotor.motor, kPwmPeriod, 0.0F);
    turning.sample();
    ASSERT_TRUE(crux_encoder_home(&turning.encoder, static_cast<float>(turning.rotor.angle + coarse_error(random)), 0));
    ASSERT_NEAR(turning.error(), 0.0, 1.1 * turning.count());
  }
}

TEST(Encoder, HomingRefusesACoarseSensorBetweenTwoTurns) {
  Turning turning;
  turning.rotor.angle = 10.0;
  crux_encoder_init(&turning.encoder, &turning.rotor.motor, kPwmPeriod, 0.0F);
  turning.sample();
  const float before = crux_encoder_position_rad(&turning.encoder);
  EXPECT_FALSE(crux_encoder_home(&turning.encoder, static_cast<float>(10.0 + 0.3 * 2 * std::numbers::pi), 0));
  EXPECT_EQ(crux_encoder_position_rad(&turning.encoder), before);
}

TEST(Encoder, HomingTakesTheBoardsZeroIntoAccount) {
  for (const std::uint32_t zero : {0U, 1U, 5000U, 16383U}) {
    for (double angle = -40.0; angle < 40.0; angle += 0.37) {
      Turning turning;
      turning.rotor.angle = angle;
      crux_encoder_init(&turning.encoder, &turning.rotor.motor, kPwmPeriod, 0.0F);
      crux_encoder_step(&turning.encoder, turning.rotor.encoder(zero), true);
      ASSERT_TRUE(crux_encoder_home(&turning.encoder, static_cast<float>(angle + 0.9), zero));
      ASSERT_NEAR(turning.error(), 0.0, 1.1 * turning.count()) << zero << " " << angle;
    }
  }
}

TEST(Encoder, CoarseAngleLiesWithinHalfATurnOfTheMiddle) {
  for (const double middle : {0.0, 1.5, -2.0, 3.0}) {
    for (double angle = middle - 3.1; angle < middle + 3.1; angle += 0.05) {
      const double turns = angle / (2.0 * std::numbers::pi);
      const auto raw = static_cast<std::uint32_t>((turns - std::floor(turns)) * 16384 + 777) % 16384;
      EXPECT_NEAR(crux_encoder_coarse_rad(raw, 777, 16384, static_cast<float>(middle)), angle, 4.1e-4);
    }
  }
}

TEST(Encoder, AnOldSampleIsRunOnToNow) {
  Turning turning;
  crux_encoder_init(&turning.encoder, &turning.rotor.motor, kPwmPeriod, kPwmPeriod);
  std::uint32_t late = turning.rotor.encoder();
  for (int k = 0; k < 4000; ++k) {
    crux_encoder_step(&turning.encoder, late, true);
    ASSERT_TRUE(k < 2000 || std::abs(turning.error()) < 1.5 * turning.count()) << k;
    late = turning.rotor.encoder();
    turning.rotor.angle += 300.0 * static_cast<double>(kPwmPeriod);  // 39 counts
  }
}

TEST(Encoder, ElectricalAngleIsThatOfTheMagnets) {
  constexpr std::uint32_t kOffset = 12345;
  Pmsm rotor;
  for (double angle = -7.0; angle < 7.0; angle += 0.013) {
    rotor.angle = angle;
    crux_encoder encoder;
    crux_encoder_init(&encoder, &rotor.motor, kPwmPeriod, 0.0F);
    crux_encoder_step(&encoder, rotor.encoder(kOffset), true);
    const double electrical = crux_encoder_electrical_rad(&encoder, rotor.motor.pole_pairs, kOffset);
    EXPECT_LE(std::abs(electrical), std::numbers::pi + 1e-5);
    EXPECT_NEAR(std::remainder(electrical - rotor.motor.pole_pairs * angle, 2 * std::numbers::pi), 0.0,
                1.1 * 7 * 2 * std::numbers::pi / 16384);
  }
}

}  // namespace
}  // namespace crux::firmware
