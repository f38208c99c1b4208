// Joint node, drive, motor and gear together against the closed forms of the whole servo.
#include <gtest/gtest.h>

#include <functional>

#include "motor_models.hpp"
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

constexpr float kTick = 1e-3F;
constexpr int kPwmATick = 20;
constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr float kRoom = 25.0F;
constexpr crux_mounting kMounting{
    .electrical_offset_counts = 4321, .rotor_zero_counts = 4321, .coarse_zero_counts = 99};

// A joint with its motor: the rotor and the load turn as one body behind the gear. The encoder's samples come a period
// late, as from the board's SPI.
struct Servo {
  crux_gear_parameters gear{.ratio = 36.0F, .efficiency = 0.9F};
  double inertia = 0.3;  // of load and rotor, at the joint
  double load_Nm = 0.0;  // external torque on the joint
  double position = 0.0;
  double speed = 0.0;
  double current_gain = 1.0;                                  // of what the amplifiers measure
  std::array<double, 2> stuck_A{std::nan(""), std::nan("")};  // what they say instead
  bool encoder_works = true;
  bool code_hangs = false;
  Pmsm motor;
  std::uint32_t late_sample = 0;
  crux_joint_drive joint{};
  crux_drive& drive = joint.drive;

  explicit Servo(double start = 0.0, bool home = true) : position(start) {
    const crux_joint_drive_parameters parameters{.motor = motor.motor, .gear = gear};
    const crux_drive_timing timing{.period_s = kPwmPeriod, .encoder_age_s = kPwmPeriod};
    crux_joint_drive_init(&joint, &parameters, &kMounting, &timing);
    motor.angle = start * static_cast<double>(gear.ratio);
    late_sample = motor.encoder(kMounting.rotor_zero_counts);
    crux_encoder_step(&drive.encoder, late_sample, true);
    if (home) {
      EXPECT_TRUE(crux_joint_drive_home(&joint, coarse(), 0.0F));
    }
    crux_heat_tick(&drive.heat, &motor.motor, kTick, 0.0F, kRoom);  // cold: heat is looked at by its own tests
    drive.direction.verdict = CRUX_DIRECTION_RIGHT;                 // as is the direction
    pwm();
  }
  [[nodiscard]] std::uint32_t coarse() const {
    const double turns = position / kTurn;
    return (static_cast<std::uint32_t>((turns - std::floor(turns)) * 16384) + kMounting.coarse_zero_counts) % 16384;
  }
  [[nodiscard]] double torque() const {
    return motor.torque() * static_cast<double>(gear.ratio) * static_cast<double>(gear.efficiency);
  }
  [[nodiscard]] float amplified(std::size_t phase) const {
    const double measured_A = current_gain * motor.phase(static_cast<int>(phase));
    return static_cast<float>(std::isnan(stuck_A[phase]) ? measured_A : stuck_A[phase]);
  }
  void turn(const float* duty) {
    motor.speed = speed * static_cast<double>(gear.ratio);
    motor.run(duty, static_cast<double>(kPwmPeriod), 5);
    speed += static_cast<double>(kPwmPeriod) * (torque() + load_Nm) / inertia;
    position = motor.angle / static_cast<double>(gear.ratio);
  }
  void pwm() {
    std::array<float, 3> acting{};
    std::copy(std::begin(drive.outputs.duty), std::end(drive.outputs.duty), acting.begin());
    const crux_drive_inputs inputs{.encoder_raw = late_sample,
                                   .encoder_valid = encoder_works,
                                   .phase_a_A = amplified(0),
                                   .phase_b_A = amplified(1),
                                   .supply_V = static_cast<float>(kSupply),
                                   .bridge_stopped = false};
    late_sample = motor.encoder(kMounting.rotor_zero_counts);
    crux_drive_step(&drive, &inputs);
    turn(acting.data());
  }
  void tick(float joint_torque_Nm) {
    if (!code_hangs) {
      crux_joint_drive_tick(&joint, kTick, joint_torque_Nm, kRoom);
    }
    for (int k = 0; k < kPwmATick; ++k) {
      pwm();
    }
  }
  void measure(crux_joint_inputs& inputs) const { crux_joint_drive_measure(&joint, &inputs); }
};

crux_joint_parameters unfiltered() {
  crux_joint_parameters parameters = joint_parameters();
  parameters.setpoint_time_constant_s = 0.0F;
  parameters.velocity_limit_rad_s = 100.0F;
  return parameters;
}

TEST(Drive, HomesWithoutMotionWhereverTheJointStands) {
  for (double start = -2.8; start < 2.9; start += 0.0371) {
    const Servo servo(start);
    crux_joint_inputs inputs{};
    servo.measure(inputs);
    ASSERT_NEAR(inputs.position_rad, start, 2.0 * kTurn / 16384 / 36);
    ASSERT_EQ(inputs.velocity_rad_s, 0.0F);
  }
}

TEST(Drive, EncodersThatContradictEachOtherAreNoPosition) {
  Servo servo(0.5, false);
  const auto third_of_a_rotor_turn = static_cast<std::uint32_t>(16384 / 36 / 3);
  EXPECT_FALSE(crux_joint_drive_home(&servo.joint, servo.coarse() + third_of_a_rotor_turn, 0.0F));
  crux_joint_inputs inputs{};
  servo.measure(inputs);
  EXPECT_TRUE(std::isnan(inputs.position_rad));
  EXPECT_TRUE(std::isnan(inputs.velocity_rad_s));
}

TEST(Drive, PositionStepIsThatOfASpringAndADamper) {
  Servo servo;
  Joint joint(unfiltered());
  const double natural = std::sqrt(100.0 / servo.inertia);
  const double damping = 4.0 / (2.0 * std::sqrt(100.0 * servo.inertia));
  const double damped = natural * std::sqrt(1.0 - damping * damping);
  constexpr double kStep = 0.02;
  for (int k = 0; k < 600; ++k) {
    servo.measure(joint.inputs);
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
    EXPECT_NEAR(servo.torque(), torque, 0.02 * std::abs(torque));
  }
}

// Holds a load by the node, then something breaks and the load may change: how far the joint goes from there [rad].
double furthest_after(Servo& servo, Joint& joint, double load, double then, const std::function<void()>& breaks) {
  const auto run = [&](int ticks) {
    for (int k = 0; k < ticks; ++k) {
      servo.measure(joint.inputs);
      joint.command({});
      joint.sync();
      servo.tick(joint.tick(kTick));
      servo.speed -= 0.002 * servo.speed;  // the joint's own friction
    }
  };
  servo.load_Nm = load;
  run(2000);
  const double before = servo.position;
  breaks();
  servo.load_Nm = then;
  double furthest = 0.0;
  for (int k = 0; k < 5000; ++k) {
    run(1);
    furthest = std::max(furthest, std::abs(servo.position - before));
  }
  return furthest;
}

// Half an electrical turn of the rotor, seen at the joint: what the magnets settle by when the field stands.
constexpr double kHalfTurn = std::numbers::pi / 7.0 / 36.0;
constexpr std::array<std::pair<double, double>, 3> kLoads{{{-4.0, -4.0}, {4.0, 4.5}, {0.5, 4.0}}};

TEST(Drive, AJointThatLosesItsEncoderUnderLoadStaysWhereItIs) {
  for (const auto& [load, then] : kLoads) {
    Servo servo;
    Joint joint(unfiltered());
    EXPECT_LT(furthest_after(servo, joint, load, then, [&] { servo.encoder_works = false; }), kHalfTurn) << load;
    EXPECT_TRUE(servo.drive.encoder.lost);
    EXPECT_EQ(joint.node.state, CRUX_STATE_FAULT);
  }
}

TEST(Drive, AJointWhoseCurrentsAreMeasuredWronglyStaysWhereItIs) {
  for (const auto& [load, then] : kLoads) {
    Servo servo;
    Joint joint(unfiltered());
    EXPECT_LT(furthest_after(servo, joint, load, then, [&] { servo.current_gain = 100.0; }), kHalfTurn) << load;
    EXPECT_TRUE(servo.drive.current_lost);
    EXPECT_EQ(joint.node.state, CRUX_STATE_FAULT);
  }
}

// Whatever an amplifier is stuck at, and wherever the rotor stands: the joint stays, and is never driven harder than a
// quarter beyond what its peak current makes.
TEST(Drive, AJointWithAStuckAmplifierStaysWhereItIs) {
  for (const std::size_t phase : {0U, 1U}) {
    for (const double stuck_A : {0.0, -2.0, 5.0}) {
      for (int eighth = 0; eighth < 8; ++eighth) {
        Servo servo(eighth / 4.0 * kHalfTurn);
        Joint joint(unfiltered());
        joint.inputs.position_rad = static_cast<float>(servo.position);
        servo.load_Nm = -4.0;
        double furthest = 0.0, most_Nm = 0.0, before = servo.position;
        for (int k = 0; k < 3000; ++k) {
          servo.measure(joint.inputs);
          joint.command({.position_rad = static_cast<float>(eighth / 4.0 * kHalfTurn)});
          joint.sync();
          servo.tick(joint.tick(kTick));
          servo.speed -= 0.002 * servo.speed;
          if (k == 1500) {
            before = servo.position;
            servo.stuck_A[phase] = stuck_A;
          }
          if (k > 1500) {
            furthest = std::max(furthest, std::abs(servo.position - before));
            most_Nm = std::max(most_Nm, std::abs(servo.torque()));
          }
        }
        EXPECT_LT(furthest, 2.0 * kHalfTurn) << phase << " " << stuck_A << " " << eighth;
        const double peak_Nm = 10.0 * static_cast<double>(crux_motor_torque_constant(&servo.motor.motor)) * 36.0 * 0.9;
        EXPECT_LT(most_Nm, 1.25 * peak_Nm) << phase << " " << stuck_A << " " << eighth;
      }
    }
  }
}

TEST(Drive, AMotorThatTurnsTheWrongWayIsFoundAsItIsStartedAndThenHeld) {
  Servo servo;
  Joint joint(unfiltered());
  servo.drive.electrical_offset_counts += 16384 / 7 / 2;
  crux_direction_init(&servo.drive.direction, 1.0F);
  EXPECT_LT(furthest_after(servo, joint, 0.0, 2.5, [] {}), 3.0 * kHalfTurn);
  EXPECT_TRUE(servo.drive.direction.verdict == CRUX_DIRECTION_WRONG || servo.drive.current_lost);
  EXPECT_EQ(joint.node.state, CRUX_STATE_FAULT);
  EXPECT_NEAR(servo.position, 0.0, 3.0 * kHalfTurn);
}

TEST(Drive, SoundCurrentsAreBelievedThroughStepsAndShocks) {
  Servo servo;
  servo.motor.motor.resistance_ohm = 0.5F;  // hot, a quarter above what the drive knows
  for (int k = 0; k < 3000; ++k) {
    servo.speed = (k % 50 < 25) ? 0.0 : ((k % 100 < 50) ? 2.0 : -2.0);  // from one period to the next
    servo.tick((k % 70 < 35) ? 15.0F : -15.0F);
    ASSERT_FALSE(servo.drive.current_lost) << k;
  }
}

TEST(Drive, AJointWhoseControlHangsStaysAndThenGoesOn) {
  for (const auto& [load, then] : kLoads) {
    Servo servo;
    Joint joint(unfiltered());
    EXPECT_LT(furthest_after(servo, joint, load, then, [&] { servo.code_hangs = true; }), kHalfTurn) << load;
    servo.code_hangs = false;
    servo.tick(1.0F);
    EXPECT_TRUE(crux_drive_measures(&servo.drive));
  }
}

TEST(Drive, TheDutiesForAProcessorFaultHoldTheJoint) {
  for (const auto& [load, then] : kLoads) {
    Servo servo;
    Joint joint(unfiltered());
    servo.load_Nm = load;
    for (int k = 0; k < 2000; ++k) {
      servo.measure(joint.inputs);
      joint.command({});
      joint.sync();
      servo.tick(joint.tick(kTick));
    }
    const double before = servo.position;
    servo.load_Nm = then;
    for (int k = 0; k < 100000; ++k) {  // five seconds without the processor
      servo.turn(servo.drive.standing_duty);
      servo.speed -= 1e-4 * servo.speed;
      ASSERT_LT(std::abs(servo.position - before), kHalfTurn) << load << " then " << then;
    }
  }
}

TEST(Drive, AJointThatCannotFindItsPositionHoldsStill) {
  Servo servo(0.5, false);
  Joint joint(unfiltered());
  EXPECT_LT(furthest_after(servo, joint, 1.0, -1.5, [] {}), kHalfTurn);
  EXPECT_NEAR(servo.position, 0.5, kHalfTurn);
  EXPECT_EQ(joint.node.state, CRUX_STATE_FAULT);
}

TEST(Drive, ASupplyThatIsMeasuredWronglyDoesNotStopTheMotor) {
  Servo servo;
  servo.inertia = 1e6;
  crux_drive_inputs inputs{.encoder_raw = servo.late_sample,
                           .encoder_valid = true,
                           .phase_a_A = 0.0F,
                           .phase_b_A = 0.0F,
                           .supply_V = 0.0F,
                           .bridge_stopped = false};
  for (const float supply : {0.0F, -5.0F, kNaN, 1e9F}) {
    inputs.supply_V = supply;
    crux_joint_drive_tick(&servo.joint, kTick, 4.0F, kRoom);
    crux_drive_step(&servo.drive, &inputs);
    float span = 0.0F;
    for (const float duty : servo.drive.outputs.duty) {
      EXPECT_TRUE(duty >= 0.0F && duty <= 1.0F);
      span = std::max(span, std::abs(duty - servo.drive.outputs.duty[0]));
    }
    EXPECT_GT(span, 0.001F) << supply;
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
  EXPECT_NEAR(servo.torque(), continuous, 0.1 * continuous);
  EXPECT_GE(servo.torque(), 0.99 * continuous);
}

}  // namespace
}  // namespace crux::firmware
