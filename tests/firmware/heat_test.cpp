// Heat against the closed form of a first-order lag.
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "motor_models.hpp"

namespace crux::firmware {
namespace {

constexpr float kTick = 1e-3F;
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

// Until the winding is cold.
crux_heat cold(const crux_motor_parameters& motor) {
  crux_heat heat;
  crux_heat_init(&heat, &motor);
  for (int k = 0; k < 200; ++k) {
    crux_heat_tick(&heat, &motor, 1.0F, 0.0F, 25.0F);
  }
  return heat;
}

TEST(Heat, StartsAtTheWorst) {
  const crux_motor_parameters motor = test_motor();
  crux_heat heat;
  crux_heat_init(&heat, &motor);
  EXPECT_FLOAT_EQ(heat.allowed_A, motor.continuous_current_A);
  crux_heat_tick(&heat, &motor, kTick, 0.0F, kUnknown);
  EXPECT_NEAR(heat.allowed_A, motor.continuous_current_A, 0.01F);
}

TEST(Heat, TheFirstTemperatureMeasuredSaysHowHotTheWindingIs) {
  const crux_motor_parameters motor = test_motor();
  for (const auto& [temperature, load] : {std::pair{20.0F, 0.0F}, {50.0F, 0.5F}, {80.0F, 1.0F}, {-10.0F, 0.0F}}) {
    crux_heat heat;
    crux_heat_init(&heat, &motor);
    crux_heat_tick(&heat, &motor, kTick, 0.0F, kUnknown);
    crux_heat_tick(&heat, &motor, kTick, 0.0F, temperature);
    EXPECT_NEAR(heat.load, load, 1e-3F);
    crux_heat_tick(&heat, &motor, kTick, 0.0F, 20.0F);  // later ones do not: the count is quicker than the thermistor
    EXPECT_NEAR(heat.load, load, 1e-3F);
  }
}

TEST(Heat, PeakLastsAsLongAsTheClosedFormSays) {
  const crux_motor_parameters motor = test_motor();
  crux_heat heat = cold(motor);
  EXPECT_FLOAT_EQ(heat.allowed_A, motor.peak_current_A);
  double seconds = 0.0;
  while (heat.allowed_A >= motor.peak_current_A) {
    crux_heat_tick(&heat, &motor, kTick, motor.peak_current_A, 25.0F);
    seconds += kTick;
  }
  // (peak/continuous)^2 (1 - exp(-t/tau)) = 0.8
  const double ratio = static_cast<double>(motor.peak_current_A) / motor.continuous_current_A;
  EXPECT_NEAR(seconds, -motor.heating_time_s * std::log(1.0 - 0.8 / (ratio * ratio)), 2 * kTick);
}

TEST(Heat, NoProfileHeatsTheWindingBeyondWhatItBearsNorDisarmsTheJoint) {
  const crux_motor_parameters motor = test_motor();
  crux_heat heat = cold(motor);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> wanted(-15.0F, 15.0F);
  double temperature = 0.0;  // the winding's own, in double precision
  for (int k = 0; k < 200000; ++k) {
    const float asked = (k % 5000 < 2500) ? 15.0F : wanted(random);
    const float current = std::min(std::abs(asked), heat.allowed_A);
    crux_heat_tick(&heat, &motor, kTick, current, 25.0F);
    const double relative = static_cast<double>(current) / motor.continuous_current_A;
    temperature += kTick / static_cast<double>(motor.heating_time_s) * (relative * relative - temperature);
    ASSERT_LE(temperature, 1.001);
    ASSERT_GE(heat.allowed_A, motor.continuous_current_A);
  }
  EXPECT_GT(temperature, 0.7);  // the profile was hard enough to tell
}

TEST(Heat, AWindingMeasuredHotFoldsBackToTheContinuousCurrent) {
  const crux_motor_parameters motor = test_motor();
  crux_heat heat = cold(motor);
  const auto allowed_at = [&](float temperature) {
    crux_heat_tick(&heat, &motor, kTick, 0.0F, temperature);
    return heat.allowed_A;
  };
  EXPECT_FLOAT_EQ(allowed_at(80.0F), motor.peak_current_A);
  // Halfway through the ten kelvin: halfway between the squares.
  EXPECT_NEAR(allowed_at(85.0F), std::sqrt((10.0F * 10.0F + 3.0F * 3.0F) / 2.0F), 0.01F);
  EXPECT_FLOAT_EQ(allowed_at(90.0F), motor.continuous_current_A);
  EXPECT_FLOAT_EQ(allowed_at(500.0F), motor.continuous_current_A);
  EXPECT_FLOAT_EQ(allowed_at(kUnknown), motor.peak_current_A);
}

}  // namespace
}  // namespace crux::firmware
