// The current loop against closed forms: a PI controller that cancels the motor's pole leaves an integrator of
// bandwidth w behind 1.5 periods of delay, open loop w / s exp(-1.5 T s).
#include <gtest/gtest.h>

#include <random>
#include <utility>
#include <vector>

#include "motor_models.hpp"

namespace crux::firmware {
namespace {

TEST(CurrentControl, ModulationMakesTheVoltageAskedForUpToTheInscribedCircle) {
  const crux_motor_parameters motor = test_motor();
  for (const double share : {0.01, 0.5, 0.999}) {
    for (int degrees = 0; degrees < 360; degrees += 5) {
      const double angle = degrees * std::numbers::pi / 180.0;
      const double volts = share * kSupply / std::numbers::sqrt3;
      crux_current_control control;
      crux_current_control_init(&control, &motor, kPwmPeriod);
      // At rest and without current the voltage asked for is what the integrators hold.
      control.quadrature_integral_V = static_cast<float>(volts);
      control.limit_V = static_cast<float>(kSupply);
      const crux_current_inputs inputs{.phase_a_A = 0.0F,
                                       .phase_b_A = 0.0F,
                                       .supply_V = static_cast<float>(kSupply),
                                       .angle_rad = static_cast<float>(std::remainder(angle, 2 * std::numbers::pi)),
                                       .speed_rad_s = 0.0F,
                                       .quadrature_wanted_A = 0.0F,
                                       .direct_wanted_A = 0.0F,
                                       .follow = false};
      crux_current_outputs outputs;
      crux_current_control_step(&control, &inputs, &outputs);
      const std::complex<double> made = Pmsm::voltage(outputs.duty);
      EXPECT_LT(std::abs(made - std::polar(volts, angle + std::numbers::pi / 2)), 2e-4 * kSupply) << degrees;
      EXPECT_FALSE(outputs.cut);
    }
  }
}

TEST(CurrentControl, WithoutDelayIsAFirstOrderLag) {
  constexpr float kShort = 1e-6F;
  CurrentLoop loop(kShort);
  const double bandwidth = loop.motor.motor.bandwidth_rad_s;
  for (int k = 0; k < 1500; ++k) {
    const double expected = 4.0 * (1.0 - std::exp(-bandwidth * k * kShort));
    EXPECT_NEAR(loop.motor.rotor_current().imag(), expected, 4.0 * 1.5 * bandwidth * kShort + 0.01) << k;
    loop.step(4.0);
  }
}

class Frequency : public testing::TestWithParam<double> {};

TEST_P(Frequency, ResponseIsThatOfAnIntegratorBehindItsDelay) {
  const double omega = 2.0 * std::numbers::pi * GetParam();
  CurrentLoop loop;
  const int periods_a_wave = static_cast<int>(std::lround(1.0 / (GetParam() * kPwmPeriod)));
  std::complex<double> gain{};
  for (int k = 0; k < 40 * periods_a_wave; ++k) {
    const double phase = omega * k * kPwmPeriod;
    if (k >= 20 * periods_a_wave) {  // settled: correlate with the wave
      gain += loop.motor.rotor_current().imag() * std::polar(1.0, -phase) / (10.0 * periods_a_wave);
    }
    loop.step(1.0 * std::cos(phase));
  }
  const std::complex<double> s(0.0, omega);
  const std::complex<double> open =
      static_cast<double>(loop.motor.motor.bandwidth_rad_s) / s * std::exp(-1.5 * static_cast<double>(kPwmPeriod) * s);
  const std::complex<double> closed = open / (1.0 + open);
  EXPECT_NEAR(std::abs(gain) / std::abs(closed), 1.0, 0.05) << std::abs(gain) << " for " << std::abs(closed);
  EXPECT_NEAR(std::arg(gain / closed), 0.0, 0.1);
}

INSTANTIATE_TEST_SUITE_P(CurrentControl, Frequency, testing::Values(50.0, 200.0, 400.0, 800.0, 1000.0));

TEST(CurrentControl, StepOvershootsNoMoreThanItsDelayExplains) {
  // Integrator with bandwidth x delay = 0.375: the response of w/s exp(-1.5 T s) overshoots by under 3 %.
  CurrentLoop loop;
  double greatest = 0.0;
  for (int k = 0; k < 200; ++k) {
    loop.step(5.0);
    greatest = std::max(greatest, loop.motor.rotor_current().imag());
  }
  EXPECT_LT(greatest, 5.0 * 1.03);
  EXPECT_NEAR(loop.motor.rotor_current().imag(), 5.0, 0.01);
}

TEST(CurrentControl, AxesStayApartAtSpeed) {
  CurrentLoop loop;
  loop.motor.speed = 250.0;
  for (int k = 0; k < 400; ++k) {
    loop.step(0.0);
  }
  EXPECT_LT(std::abs(loop.motor.rotor_current()), 0.1);
  double direct = 0.0;
  for (int k = 0; k < 400; ++k) {
    loop.step(8.0);
    direct = std::max(direct, std::abs(loop.motor.rotor_current().real()));
  }
  // The coupling is fed forward, but a delay late: what is left is that share of it.
  const double electrical = 7 * loop.motor.speed;
  EXPECT_LT(direct, 0.5 * 1.5 * static_cast<double>(kPwmPeriod) * electrical * 8.0);
  EXPECT_NEAR(loop.motor.rotor_current().imag(), 8.0, 0.1);
}

TEST(CurrentControl, ComesBackFromTheSupplysLimitWithoutWindUp) {
  CurrentLoop loop;
  loop.motor.speed = 450.0;  // back voltage 15.75 V of 13.86 V reachable: the current wanted cannot be made
  for (int k = 0; k < 4000; ++k) {
    loop.step(5.0);
    for (const float duty : loop.outputs.duty) {
      ASSERT_GE(duty, 0.0F);
      ASSERT_LE(duty, 1.0F);
    }
  }
  EXPECT_TRUE(loop.outputs.cut);
  EXPECT_LT(loop.motor.rotor_current().imag(), 1.0);
  loop.motor.speed = 200.0;
  double greatest = 0.0;
  for (int k = 0; k < 400; ++k) {
    loop.step(5.0);
    greatest = std::max(greatest, loop.motor.rotor_current().imag());
  }
  EXPECT_NEAR(loop.motor.rotor_current().imag(), 5.0, 0.05);
  // The sudden drop of the back voltage itself drives current up; a wound-up integrator would add to that for long.
  EXPECT_LT(greatest, 5.0 + 450.0 / 10.0);
  EXPECT_FALSE(loop.outputs.cut);
}

TEST(CurrentControl, CurrentStaysNearWhatIsWantedInAnyProfile) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> wanted(-10.0, 10.0);
  CurrentLoop loop;
  double target = 0.0;
  for (int k = 0; k < 20000; ++k) {
    if (k % 40 == 0) {
      target = wanted(random);
    }
    loop.motor.speed = 200.0 * std::sin(0.002 * k);
    loop.step(target);
    ASSERT_LT(std::abs(loop.motor.current), 10.0 * 1.1) << k;
  }
}

TEST(Motor, ParametersThatMakeNoSenseAreNamed) {
  const crux_motor_parameters good = test_motor();
  EXPECT_EQ(crux_motor_parameters_fault(&good), nullptr);
  using Motor = crux_motor_parameters;
  const std::vector<std::pair<float Motor::*, const char*>> members{
      {&Motor::resistance_ohm, "resistance_ohm"},
      {&Motor::inductance_H, "inductance_H"},
      {&Motor::flux_Wb, "flux_Wb"},
      {&Motor::peak_current_A, "peak_current_A"},
      {&Motor::continuous_current_A, "continuous_current_A"},
      {&Motor::heating_time_s, "heating_time_s"},
      {&Motor::bandwidth_rad_s, "bandwidth_rad_s"},
      {&Motor::max_speed_rad_s, "max_speed_rad_s"},
      {&Motor::supply_V, "supply_V"},
      {&Motor::temperature_limit_degC, "temperature_limit_degC"}};
  for (const auto& [member, name] : members) {
    for (const float wrong : {NAN, 0.0F, -1.0F, INFINITY}) {
      Motor bad = good;
      bad.*member = wrong;
      EXPECT_STREQ(crux_motor_parameters_fault(&bad), name) << wrong;
    }
  }
  Motor bad = good;
  bad.continuous_current_A = 11.0F;  // above the peak
  EXPECT_STREQ(crux_motor_parameters_fault(&bad), "continuous_current_A");
  for (const std::uint32_t wrong : {0U, 51U}) {
    bad = good;
    bad.pole_pairs = wrong;
    EXPECT_STREQ(crux_motor_parameters_fault(&bad), "pole_pairs");
  }
  for (const std::uint32_t wrong : {63U, 65537U}) {
    bad = good;
    bad.encoder_counts = wrong;
    EXPECT_STREQ(crux_motor_parameters_fault(&bad), "encoder_counts");
  }
}

TEST(Motor, GearsAndScrewsThatMakeNoSenseAreNamed) {
  const crux_gear_parameters gear{.ratio = 36.0F, .efficiency = 0.9F};
  EXPECT_EQ(crux_gear_parameters_fault(&gear), nullptr);
  crux_gear_parameters bad_gear = gear;
  bad_gear.ratio = 0.0F;
  EXPECT_STREQ(crux_gear_parameters_fault(&bad_gear), "ratio");
  bad_gear = gear;
  bad_gear.efficiency = 1.2F;
  EXPECT_STREQ(crux_gear_parameters_fault(&bad_gear), "efficiency");
  using Screw = crux_screw_parameters;
  const Screw screw{
      .lead_m = 1e-3F, .efficiency = 0.3F, .release_torque = 0.4F, .inertia_kg_m2 = 1e-7F, .drag_Nms_rad = 0.0F};
  EXPECT_EQ(crux_screw_parameters_fault(&screw), nullptr);
  const std::vector<std::pair<float Screw::*, const char*>> members{{&Screw::lead_m, "lead_m"},
                                                                    {&Screw::efficiency, "efficiency"},
                                                                    {&Screw::release_torque, "release_torque"},
                                                                    {&Screw::inertia_kg_m2, "inertia_kg_m2"},
                                                                    {&Screw::drag_Nms_rad, "drag_Nms_rad"}};
  for (const auto& [member, name] : members) {
    for (const float wrong : {NAN, -1.0F, INFINITY}) {
      Screw bad = screw;
      bad.*member = wrong;
      EXPECT_STREQ(crux_screw_parameters_fault(&bad), name) << wrong;
    }
  }
}

}  // namespace
}  // namespace crux::firmware
