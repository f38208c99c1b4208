// Joint node, drive, motor and gear together against the closed forms of the whole servo.
#include <gtest/gtest.h>

#include "motor_models.hpp"
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

constexpr float kTick = 1e-3F;
constexpr int kPwmATick = 20;
constexpr std::uint32_t kOffset = 4321;

// A joint with its motor: the rotor and the load turn as one body behind the gear.
struct Servo {
  crux_gear_parameters gear{.ratio = 36.0F, .efficiency = 0.9F};
  double inertia = 0.3;  // of load and rotor, at the joint
  double load_Nm = 0.0;  // external torque on the joint
  double position = 0.0;
  double speed = 0.0;
  bool encoder_works = true;
  Pmsm motor;
  crux_drive drive{};

  Servo() {
    crux_drive_init(&drive, &motor.motor, kOffset, kPwmPeriod);
    drive.heat.load = 0.0F;  // cold: heat is looked at by its own tests
    drive.heat.allowed_A = motor.motor.peak_current_A;
    pwm();
  }
  void pwm() {
    std::array<float, 3> acting{};
    std::copy(std::begin(drive.outputs.duty), std::end(drive.outputs.duty), acting.begin());
    const crux_drive_inputs inputs{.encoder_raw = motor.encoder(kOffset),
                                   .encoder_valid = encoder_works,
                                   .phase_a_A = static_cast<float>(motor.phase(0)),
                                   .phase_b_A = static_cast<float>(motor.phase(1)),
                                   .supply_V = static_cast<float>(kSupply)};
    crux_drive_step(&drive, &inputs);
    motor.speed = speed * static_cast<double>(gear.ratio);
    motor.run(acting.data(), static_cast<double>(kPwmPeriod), 5);
    const double ratio = static_cast<double>(gear.ratio);
    const double efficiency = static_cast<double>(gear.efficiency);
    speed += static_cast<double>(kPwmPeriod) * (motor.torque() * ratio * efficiency + load_Nm) / inertia;
    position = motor.angle / ratio;
  }
  void tick(float joint_torque_Nm) {
    crux_drive_tick(&drive, kTick, crux_gear_rotor_torque_Nm(&gear, joint_torque_Nm));
    for (int k = 0; k < kPwmATick; ++k) {
      pwm();
    }
  }
  void measure(crux_joint_inputs& inputs) const {
    inputs.position_rad = crux_encoder_position_rad(&drive.encoder) / gear.ratio;
    inputs.velocity_rad_s = drive.encoder.speed_rad_s / gear.ratio;
    inputs.torque_Nm = crux_gear_joint_torque_Nm(&gear, crux_drive_rotor_torque_Nm(&drive));
    if (drive.encoder.lost) {
      inputs.position_rad = kNaN;
    }
  }
};

crux_joint_parameters unfiltered() {
  crux_joint_parameters parameters = joint_parameters();
  parameters.setpoint_time_constant_s = 0.0F;
  parameters.velocity_limit_rad_s = 100.0F;
  return parameters;
}

TEST(Drive, PositionStepIsThatOfASpringAndADamper) {
  // Electrical offset of home: encoder reads kOffset counts when the rotor stands at zero.
  Servo servo;
  Joint joint(unfiltered());
  const double home = static_cast<double>(crux_encoder_position_rad(&servo.drive.encoder)) / 36.0;
  const double natural = std::sqrt(100.0 / servo.inertia);
  const double damping = 4.0 / (2.0 * std::sqrt(100.0 * servo.inertia));
  const double damped = natural * std::sqrt(1.0 - damping * damping);
  constexpr double kStep = 0.02;
  for (int k = 0; k < 600; ++k) {
    servo.measure(joint.inputs);
    joint.inputs.position_rad -= static_cast<float>(home);
    joint.command({.position_rad = static_cast<float>(kStep)});
    joint.sync();
    servo.tick(joint.tick(kTick));
    const double t = (k + 1) * static_cast<double>(kTick);
    const double decay = std::exp(-damping * natural * t);
    const double expected =
        kStep * (1.0 - decay * (std::cos(damped * t) + damping * natural / damped * std::sin(damped * t)));
    ASSERT_NEAR(servo.position, expected, 0.03 * kStep) << "after " << t << " s";
  }
}

TEST(Drive, TorqueOfTheStatusIsThatOfTheMotor) {
  Servo servo;
  servo.inertia = 1e6;  // stands
  for (const float torque : {0.5F, -3.0F, 10.0F}) {
    for (int k = 0; k < 20; ++k) {
      servo.tick(torque);
    }
    crux_joint_inputs inputs{};
    servo.measure(inputs);
    EXPECT_NEAR(inputs.torque_Nm, torque, 0.02F * std::abs(torque));
    EXPECT_NEAR(servo.motor.torque() * 36.0 * 0.9, torque, 0.02 * std::abs(torque));
  }
}

TEST(Drive, AJointThatLosesItsEncoderUnderLoadStaysWhereItIs) {
  for (const auto& [load, then] : {std::pair{-4.0, -4.0}, std::pair{4.0, 4.5}, std::pair{0.5, 4.0}}) {
    Servo servo;
    servo.load_Nm = load;
    Joint joint(unfiltered());
    const double home = static_cast<double>(crux_encoder_position_rad(&servo.drive.encoder)) / 36.0;
    const auto run = [&](int ticks) {
      for (int k = 0; k < ticks; ++k) {
        servo.measure(joint.inputs);
        joint.inputs.position_rad -= static_cast<float>(home);
        joint.command({});
        joint.sync();
        servo.tick(joint.tick(kTick));
        servo.speed -= 0.002 * servo.speed;  // the joint's own friction
      }
    };
    run(2000);
    const double before = servo.position;
    servo.encoder_works = false;
    servo.load_Nm = then;
    double furthest = 0.0;
    for (int k = 0; k < 5000; ++k) {
      run(1);
      furthest = std::max(furthest, std::abs(servo.position - before));
    }
    EXPECT_TRUE(servo.drive.encoder.lost);
    EXPECT_EQ(joint.node.state, CRUX_STATE_FAULT);
    // Half an electrical turn of the rotor, seen at the joint.
    EXPECT_LT(furthest, std::numbers::pi / 7.0 / 36.0) << load << " then " << then;
  }
}

TEST(Drive, HeatLimitsTheCurrentButNeverBelowTheContinuousOne) {
  Servo servo;
  servo.inertia = 1e6;
  const double continuous = 3.0 * static_cast<double>(crux_motor_torque_constant(&servo.motor.motor)) * 36.0 * 0.9;
  servo.drive.heat.load = 0.999F;
  for (int k = 0; k < 300; ++k) {
    servo.tick(15.0F);
  }
  EXPECT_NEAR(servo.motor.torque() * 36.0 * 0.9, continuous, 0.1 * continuous);
  EXPECT_GE(servo.motor.torque() * 36.0 * 0.9, 0.99 * continuous);
}

}  // namespace
}  // namespace crux::firmware
