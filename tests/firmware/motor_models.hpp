// Physics of a three-phase motor and of a screw, in continuous time and in other coordinates than the firmware's: the
// phase currents in the stator's frame, the screw with rotor inertia and dry friction.
#ifndef CRUX_TESTS_FIRMWARE_MOTOR_MODELS_HPP
#define CRUX_TESTS_FIRMWARE_MOTOR_MODELS_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numbers>

extern "C" {
#include "drive/as5047p.h"
#include "drive/drive.h"
#include "drive/gripper_drive.h"
#include "drive/joint_drive.h"
#include "drive/screw.h"
#include "drive/stall.h"
}

namespace crux::firmware {

constexpr float kPwmPeriod = 5e-5F;
constexpr double kSupply = 24.0;

inline crux_motor_parameters test_motor() {
  return {.pole_pairs = 7,
          .resistance_ohm = 0.4F,
          .inductance_H = 2e-4F,
          .flux_Wb = 0.005F,
          .peak_current_A = 10.0F,
          .continuous_current_A = 3.0F,
          .heating_time_s = 20.0F,
          .bandwidth_rad_s = 5000.0F,
          .max_speed_rad_s = 400.0F,
          .encoder_counts = 16384,
          .supply_V = 24.0F,
          .temperature_limit_degC = 80.0F};
}

// Surface-magnet motor: L di/dt = v - R i - d(flux)/dt, all complex numbers in the stator's frame.
struct Pmsm {
  crux_motor_parameters motor = test_motor();
  double angle = 0.0;  // of the rotor, mechanical
  double speed = 0.0;
  std::complex<double> current{};

  [[nodiscard]] std::complex<double> magnets() const {
    return std::polar(static_cast<double>(motor.flux_Wb), motor.pole_pairs * angle);
  }
  [[nodiscard]] double torque() const { return 1.5 * motor.pole_pairs * std::imag(std::conj(magnets()) * current); }
  // Amplitude-preserving: phase a is the real part, b is a third of a turn further.
  [[nodiscard]] double phase(int index) const {
    return std::real(current * std::polar(1.0, -2.0 * std::numbers::pi * index / 3.0));
  }
  // Current in the rotor's frame: real part along the magnets.
  [[nodiscard]] std::complex<double> rotor_current() const {
    return current * std::polar(1.0, -static_cast<double>(motor.pole_pairs) * angle);
  }
  [[nodiscard]] std::uint32_t encoder(std::uint32_t offset_counts = 0) const {
    const double turns = angle / (2.0 * std::numbers::pi);
    const double counts = (turns - std::floor(turns)) * motor.encoder_counts;
    return (static_cast<std::uint32_t>(counts) + offset_counts) % motor.encoder_counts;
  }
  static std::complex<double> voltage(const float* duty) {
    const std::complex<double> third = std::polar(1.0, 2.0 * std::numbers::pi / 3.0);
    return kSupply * (2.0 / 3.0) *
           (static_cast<double>(duty[0]) + static_cast<double>(duty[1]) * third +
            static_cast<double>(duty[2]) * third * third);
  }
  // `seconds` under the mean voltage of the duties; the rotor turns at its speed.
  void run(const float* duty, double seconds, int steps = 50) {
    const std::complex<double> v = voltage(duty);
    const double h = seconds / steps;
    for (int i = 0; i < steps; ++i) {
      angle += 0.5 * h * speed;
      const std::complex<double> back = std::complex<double>(0.0, motor.pole_pairs * speed) * magnets();
      // Exact for the RL circuit with the back voltage of mid-step.
      const double decay = std::exp(-h * static_cast<double>(motor.resistance_ohm) / motor.inductance_H);
      current = decay * current + (1.0 - decay) / static_cast<double>(motor.resistance_ohm) * (v - back);
      angle += 0.5 * h * speed;
    }
  }
};

// Current control and motor in lockstep: the duties of a period act in the next one.
struct CurrentLoop {
  Pmsm motor;
  crux_current_control control{};
  crux_current_outputs outputs{.duty = {0.5F, 0.5F, 0.5F},
                               .direct_A = 0.0F,
                               .quadrature_A = 0.0F,
                               .misfit_A2 = 0.0F,
                               .modelled_A2 = 0.0F,
                               .cut = false};
  float period_s;

  explicit CurrentLoop(float period = kPwmPeriod) : period_s(period) {
    crux_current_control_init(&control, &motor.motor, period);
  }
  void step(double quadrature_A) {
    std::array<float, 3> acting{};
    std::copy(std::begin(outputs.duty), std::end(outputs.duty), acting.begin());
    const double electrical = motor.motor.pole_pairs * motor.angle;
    const crux_current_inputs inputs{
        .phase_a_A = static_cast<float>(motor.phase(0)),
        .phase_b_A = static_cast<float>(motor.phase(1)),
        .supply_V = static_cast<float>(kSupply),
        .angle_rad = static_cast<float>(std::remainder(electrical, 2.0 * std::numbers::pi)),
        .speed_rad_s = static_cast<float>(motor.motor.pole_pairs * motor.speed),
        .quadrature_wanted_A = static_cast<float>(quadrature_A),
        .direct_wanted_A = 0.0F,
        .follow = false};
    crux_current_control_step(&control, &inputs, &outputs);
    motor.run(acting.data(), period_s);
  }
};

}  // namespace crux::firmware

#endif
