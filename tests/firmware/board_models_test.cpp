// The emulated board's motor against energy, its own circuit solved in small steps, and Kirchhoff; its sensors against
// their data sheets' arithmetic.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

extern "C" {
#include "board_sensors.h"
#include "motor_model.h"
}

namespace {

using Complex = std::complex<double>;
constexpr motor_parameters kMotor{7.0, 0.3, 2e-4, 0.05 / 10.5, 24.0};
constexpr double kPeriod = 5e-5;

Complex cpp(motor_vector value) { return {value.alpha, value.beta}; }

motor_vector c(Complex value) { return {value.real(), value.imag()}; }

// The same circuit by Runge and Kutta in very small steps, torque by Simpson.
struct Slow {
  Complex current;
  double mean_torque = 0.0;

  Slow(Complex start, Complex voltage, double seconds, double from, double speed) : current(start) {
    const int steps = 2000;
    const double h = seconds / steps;
    const auto slope = [&](Complex i, double t) {
      const Complex back = Complex(0.0, speed * kMotor.flux_Wb) * std::polar(1.0, from + speed * t);
      return (voltage - back - kMotor.resistance_ohm * i) / kMotor.inductance_H;
    };
    const auto torque = [&](Complex i, double t) {
      return 1.5 * kMotor.pole_pairs * kMotor.flux_Wb * std::imag(i * std::polar(1.0, -(from + speed * t)));
    };
    for (int k = 0; k < steps; ++k) {
      const double t = k * h;
      const Complex k1 = slope(current, t);
      const Complex k2 = slope(current + 0.5 * h * k1, t + 0.5 * h);
      const Complex k3 = slope(current + 0.5 * h * k2, t + 0.5 * h);
      const Complex k4 = slope(current + h * k3, t + h);
      const Complex next = current + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
      mean_torque += (torque(current, t) + 4.0 * torque(0.5 * (current + next), t + 0.5 * h) + torque(next, t + h)) /
                     (6.0 * steps);
      current = next;
    }
  }
};

TEST(MotorModel, StepIsTheExactSolutionAtAnySpeedAndLength) {
  for (const double speed : {0.0, 1e-3, 40.0, -900.0, 4900.0}) {
    for (const double seconds : {kPeriod, 2e-3}) {
      motor_model motor{kMotor, c({1.2, -3.4})};
      const Complex voltage{3.0, -2.0};
      const double torque = motor_step(&motor, c(voltage), seconds, 0.7, 0.7 + speed * seconds);
      const Slow slow({1.2, -3.4}, voltage, seconds, 0.7, speed);
      EXPECT_NEAR(std::abs(cpp(motor.current_A) - slow.current), 0.0, 1e-8) << speed << " " << seconds;
      EXPECT_NEAR(torque, slow.mean_torque, 2e-6) << speed << " " << seconds;
    }
  }
}

TEST(MotorModel, ManyStepsAreOneLongOne) {
  motor_model once{kMotor, c({0.0, 0.0})};
  motor_model often{kMotor, c({0.0, 0.0})};
  const double torque = motor_step(&once, c({2.0, 1.0}), 40 * kPeriod, 0.1, 0.5);
  double mean = 0.0;
  for (int i = 0; i < 40; ++i) {
    mean += motor_step(&often, c({2.0, 1.0}), kPeriod, 0.1 + 0.01 * i, 0.1 + 0.01 * (i + 1)) / 40.0;
  }
  EXPECT_NEAR(std::abs(cpp(once.current_A) - cpp(often.current_A)), 0.0, 1e-9);
  EXPECT_NEAR(torque, mean, 1e-9);
}

TEST(MotorModel, StandingMotorDrawsVoltageByResistance) {
  motor_model motor{kMotor, c({0.0, 0.0})};
  (void)motor_step(&motor, c({0.9, 0.0}), 1.0, 0.0, 0.0);
  EXPECT_NEAR(std::abs(cpp(motor.current_A) - Complex(3.0, 0.0)), 0.0, 1e-9);
}

TEST(MotorModel, ElectricalPowerIsHeatAndMechanicalPower) {
  // In the steady state of a constant speed under a voltage that turns along.
  motor_model motor{kMotor, c({0.0, 0.0})};
  const double speed = 2000.0;
  double torque = 0.0;
  double power = 0.0;
  double heat = 0.0;
  const int steps = 200000;
  for (int k = 0; k < steps; ++k) {
    const double h = 1e-7;
    const double from = speed * h * k;
    const Complex voltage = std::polar(12.0, from + 0.5 * speed * h + std::numbers::pi / 2.0);
    const Complex before = cpp(motor.current_A);
    const double step_torque = motor_step(&motor, c(voltage), h, from, from + speed * h);
    if (k >= steps / 2) {
      const Complex mean = 0.5 * (before + cpp(motor.current_A));
      torque += step_torque;
      power += 1.5 * std::real(voltage * std::conj(mean));
      heat += 1.5 * kMotor.resistance_ohm * std::norm(mean);
    }
  }
  EXPECT_NEAR(power, heat + torque * speed / kMotor.pole_pairs, 1e-4 * power);
}

TEST(MotorModel, PhasesAddUpToZeroAndDutiesInCommonDoNothing) {
  motor_model motor{kMotor, c({2.0, -1.0})};
  EXPECT_NEAR(motor_phase_A(&motor, 0), 2.0, 1e-12);
  EXPECT_NEAR(motor_phase_A(&motor, 0) + motor_phase_A(&motor, 1) + motor_phase_A(&motor, 2), 0.0, 1e-12);
  const std::array<double, 3> low{0.1, 0.5, 0.3};
  const std::array<double, 3> high{0.4, 0.8, 0.6};
  EXPECT_NEAR(std::abs(cpp(motor_voltage_V(&kMotor, low.data())) - cpp(motor_voltage_V(&kMotor, high.data()))), 0.0,
              1e-12);
  const std::array<double, 3> phase_a{1.0, 0.0, 0.0};
  EXPECT_NEAR(std::abs(cpp(motor_voltage_V(&kMotor, phase_a.data())) - Complex(16.0, 0.0)), 0.0, 1e-12);
}

TEST(BoardSensors, EncoderAnswersInTheNextFrameWithEvenParity) {
  magnetic_encoder encoder{};
  magnetic_encoder_latch(&encoder, 0x1235);
  EXPECT_EQ(magnetic_encoder_exchange(&encoder, 0xFFFF), 0x0000);  // nothing was asked before
  EXPECT_EQ(magnetic_encoder_exchange(&encoder, 0x4001), 0x1235);  // six bits set
  EXPECT_EQ(magnetic_encoder_exchange(&encoder, 0xFFFF), 0x0000);  // no errors
  magnetic_encoder_latch(&encoder, 0x1234);
  EXPECT_EQ(magnetic_encoder_exchange(&encoder, 0xFFFF), 0x1234 | 0x8000);
}

TEST(BoardSensors, CountsGoRound) {
  EXPECT_EQ(encoder_counts(0.0, 5), 5U);
  EXPECT_EQ(encoder_counts(0.25, 0), 4096U);
  EXPECT_EQ(encoder_counts(-0.25, 0), 12288U);
  EXPECT_EQ(encoder_counts(7.75, 8192), 4096U);
}

TEST(BoardSensors, ReadingsAreThoseOfTheConverter) {
  EXPECT_EQ(reading_of_current(0.0, 2048.0), 2048U);
  EXPECT_EQ(reading_of_current(3.3, 2048.0), 2048U + 410U);  // 0.33 V of 3.3 V
  EXPECT_EQ(reading_of_current(99.0, 2048.0), 4095U);
  EXPECT_EQ(reading_of_current(-99.0, 2048.0), 0U);
  EXPECT_EQ(reading_of_supply(24.0), 2708U);
  EXPECT_EQ(reading_of_temperature(25.0), 2048U);
  EXPECT_LT(reading_of_temperature(80.0), reading_of_temperature(79.0));
}

}  // namespace
