// Gripper node, drive, motor and screw together.
#include <gtest/gtest.h>

#include "motor_models.hpp"
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

constexpr float kTick = 1e-3F;
constexpr int kPwmATick = 20;
constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr float kRoom = 25.0F;
constexpr crux_mounting kMounting{
    .electrical_offset_counts = 100, .rotor_zero_counts = 100, .coarse_zero_counts = 9000};

// Rotor behind a screw that locks itself; both fingers close on a springy hold, or on nothing but the ends of the
// travel.
struct Hand {
  crux_gripper_drive_parameters parameters{.motor = test_motor(),
                                           .screw = {.lead_m = 1e-3F,
                                                     .efficiency = 0.3F,
                                                     .release_torque = 0.4F,
                                                     .inertia_kg_m2 = 1e-7F,
                                                     .drag_Nms_rad = 2.5e-6F},
                                           .coarse_travel_m = 0.065F};
  crux_gripper_parameters limits = gripper_parameters();
  double hold = 0.02;          // opening at which the pads touch it
  double stiffness = 40000.0;  // of a finger on it
  double speed = 0.0;          // of the rotor, positive closes
  Pmsm motor;
  crux_gripper_drive gripper{};

  explicit Hand(double opening, int coarse_error = 0) {
    const crux_drive_timing timing{.period_s = kPwmPeriod, .encoder_age_s = 0.0F};
    crux_gripper_drive_init(&gripper, &parameters, &limits, &kMounting, &timing);
    const double closed = static_cast<double>(limits.opening_max_m) - opening;
    motor.angle = closed / static_cast<double>(parameters.screw.lead_m) * kTurn;
    crux_encoder_step(&gripper.drive.encoder, motor.encoder(kMounting.rotor_zero_counts), true);
    const double turns = closed / static_cast<double>(parameters.coarse_travel_m);
    const int coarse = static_cast<int>(turns * 16384) + static_cast<int>(kMounting.coarse_zero_counts) + coarse_error;
    crux_gripper_drive_home(&gripper, static_cast<std::uint32_t>(coarse + 16384) % 16384);
  }
  [[nodiscard]] double opening() const {
    return static_cast<double>(limits.opening_max_m) -
           motor.angle / kTurn * static_cast<double>(parameters.screw.lead_m);
  }
  [[nodiscard]] double squeeze() const { return std::max(0.0, stiffness * (hold - opening())); }
  [[nodiscard]] double current() const { return std::abs(motor.current); }
  void turn(double seconds) {
    const auto& screw = parameters.screw;
    const double up =
        2.0 * static_cast<double>(screw.lead_m) / (kTurn * static_cast<double>(screw.efficiency)) * squeeze();
    const double down = -static_cast<double>(screw.release_torque) * up;
    const double torque = motor.torque();
    const double resist = (speed > 0.0) ? up : (speed < 0.0) ? down : std::clamp(torque, down, up);
    const double next = speed + seconds / static_cast<double>(screw.inertia_kg_m2) *
                                    (torque - resist - static_cast<double>(screw.drag_Nms_rad) * speed);
    speed = (speed * next < 0.0) ? 0.0 : next;
  }
  void tick(float force_N, bool may_release) {
    crux_gripper_drive_tick(&gripper, kTick, force_N, may_release, kRoom);
    for (int k = 0; k < kPwmATick; ++k) {
      std::array<float, 3> acting{};
      std::copy(std::begin(gripper.drive.outputs.duty), std::end(gripper.drive.outputs.duty), acting.begin());
      const crux_drive_inputs inputs{.encoder_raw = motor.encoder(kMounting.rotor_zero_counts),
                                     .encoder_valid = true,
                                     .phase_a_A = static_cast<float>(motor.phase(0)),
                                     .phase_b_A = static_cast<float>(motor.phase(1)),
                                     .supply_V = static_cast<float>(kSupply),
                                     .bridge_stopped = false};
      crux_drive_step(&gripper.drive, &inputs);
      constexpr int kSteps = 10;
      for (int i = 0; i < kSteps; ++i) {
        motor.speed = speed;
        motor.run(acting.data(), static_cast<double>(kPwmPeriod) / kSteps, 1);
        turn(static_cast<double>(kPwmPeriod) / kSteps);
      }
    }
  }
  // The node on the bus with the drive under it.
  void run(Gripper& node, float opening, float force, double seconds) {
    for (int k = 0; k < static_cast<int>(seconds / static_cast<double>(kTick)); ++k) {
      crux_gripper_drive_measure(&gripper, &node.inputs);
      if (force > 0.0F) {
        node.command({.opening_m = opening, .force_limit_N = force});
        node.sync();
      }
      const float wanted = node.tick(kTick);
      tick(wanted, node.node.state == CRUX_STATE_TRACK);
    }
  }
};

TEST(GripperDrive, HomesWithoutMotionOverTheWholeTravel) {
  for (double opening = 0.0081; opening < 0.0659; opening += 0.00037) {
    // A coarse sensor that is wrong by 0.8 degrees, the part's worst.
    for (const int error : {-36, 0, 36}) {
      const Hand hand(opening, error);
      crux_gripper_inputs inputs{};
      crux_gripper_drive_measure(&hand.gripper, &inputs);
      ASSERT_NEAR(inputs.opening_m, opening, 1.2e-7) << error;
    }
  }
}

TEST(GripperDrive, ClosesOnAHoldSqueezesAndRestsWithoutCurrent) {
  Hand hand(0.03);
  Gripper node;
  hand.run(node, 0.008F, 25.0F, 1.5);
  EXPECT_NEAR(hand.squeeze(), 25.0, 2.5);
  EXPECT_LT(hand.current(), 0.05);
  EXPECT_NEAR(hand.gripper.screw.force_N, hand.squeeze(), 2.5);
  EXPECT_EQ(hand.gripper.stall.kind, CRUX_STALL_OBJECT);
}

TEST(GripperDrive, NothingButATrackCommandLetsGo) {
  Hand hand(0.03);
  Gripper node;
  hand.run(node, 0.008F, 25.0F, 1.5);
  const double squeeze = hand.squeeze();
  hand.run(node, 0.0F, 0.0F, 1.0);  // the bus is cut: the watchdog holds
  EXPECT_EQ(node.node.state, CRUX_STATE_HOLD);
  EXPECT_NEAR(hand.squeeze(), squeeze, 0.5);
  for (int k = 0; k < 500; ++k) {
    hand.tick(-60.0F, false);  // a force that opens, in a state that must hold
  }
  EXPECT_NEAR(hand.squeeze(), squeeze, 0.5);
  for (int k = 0; k < 500; ++k) {
    hand.tick(-30.0F, true);
  }
  EXPECT_EQ(hand.squeeze(), 0.0);
}

TEST(GripperDrive, ShowsNoSqueezeWhileItClosesInTheAir) {
  Hand hand(0.06);
  Gripper node;
  for (int k = 0; k < 40; ++k) {
    hand.run(node, 0.03F, 60.0F, 0.05);
    EXPECT_LT(hand.gripper.screw.force_N, 5.0F) << k;
  }
  EXPECT_NEAR(hand.opening(), 0.03, 1e-3);  // fingers in the air quiver a little; the supervisor admits 3 mm
}

TEST(GripperDrive, RestsAtTheEndOfItsTravel) {
  Hand hand(0.012);
  hand.hold = 0.008;  // the closed end
  hand.stiffness = 1e6;
  for (int k = 0; k < 1000; ++k) {
    hand.tick(30.0F, false);
  }
  EXPECT_EQ(hand.gripper.stall.kind, CRUX_STALL_CLOSED_END);
  EXPECT_LT(hand.current(), 0.05);
}

TEST(GripperDrive, AContradictionOfItsEncodersIsNoOpening) {
  const Hand hand(0.03, 16384 / 65 / 3);
  crux_gripper_inputs inputs{};
  crux_gripper_drive_measure(&hand.gripper, &inputs);
  EXPECT_TRUE(std::isnan(inputs.opening_m));
  EXPECT_TRUE(std::isnan(inputs.speed_m_s));
}

}  // namespace
}  // namespace crux::firmware
