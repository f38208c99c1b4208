// Screw and stall against the physics of a screw with dry friction that squeezes a spring.
#include <gtest/gtest.h>

#include "motor_models.hpp"
#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

constexpr float kTick = 1e-3F;

// Rotor behind a screw that locks itself, both fingers on a springy hold. Friction torque is a share of the load's:
// building takes c F, giving way takes release * c F in the other direction.
struct ScrewPhysics {
  crux_screw_parameters parameters{
      .lead_m = 1e-3F, .efficiency = 0.3F, .release_torque = 0.4F, .inertia_kg_m2 = 1e-7F, .drag_Nms_rad = 2.5e-6F};
  double inertia = static_cast<double>(parameters.inertia_kg_m2);
  double drag = static_cast<double>(parameters.drag_Nms_rad);
  double hold_half_width = 0.02;
  double stiffness = 40000.0;  // of a finger on the hold
  double opening = 0.03;
  double speed = 0.0;  // of the rotor, positive closes

  [[nodiscard]] double squeeze() const { return std::max(0.0, stiffness * (hold_half_width - opening)); }
  [[nodiscard]] double build() const {
    return 2.0 * static_cast<double>(parameters.lead_m) /
           (2.0 * std::numbers::pi * static_cast<double>(parameters.efficiency));
  }
  void run(double torque, double seconds) {
    constexpr int kSteps = 50;
    const double h = seconds / kSteps;
    for (int i = 0; i < kSteps; ++i) {
      const double up = build() * squeeze();                                     // load and friction add up
      const double down = -static_cast<double>(parameters.release_torque) * up;  // friction outweighs the load
      const double resist = (speed > 0.0) ? up : (speed < 0.0) ? down : std::clamp(torque, down, up);
      const double next = speed + h / inertia * (torque - resist - drag * speed);
      speed = (speed * next < 0.0) ? 0.0 : next;  // dry friction stops, it does not push back
      opening -= h * speed * static_cast<double>(parameters.lead_m) / (2.0 * std::numbers::pi);
    }
  }
};

struct Grip {
  ScrewPhysics physics;
  crux_screw screw{};
  double torque = 0.0;
  double setpoint = physics.opening;

  Grip() { crux_screw_init(&screw, &physics.parameters); }
  // The gripper node's own law, made into torque by the screw: the setpoint moves at the speed limit and never leads
  // the fingers by more than the force limit is worth.
  void run(double wanted, double limit, bool may_release, double seconds) {
    for (int k = 0; k < static_cast<int>(seconds / static_cast<double>(kTick)); ++k) {
      const double reach = 0.02 * static_cast<double>(kTick);
      const double lead = limit / 20000.0;
      setpoint += std::clamp(wanted - setpoint, -reach, reach);
      setpoint = std::clamp(setpoint, physics.opening - lead, physics.opening + lead);
      const double finger_speed = -physics.speed * 1e-3 / (2.0 * std::numbers::pi);
      crux_screw_observe(&screw, kTick, static_cast<float>(torque), static_cast<float>(physics.speed));
      const double force =
          std::clamp(20000.0 * (physics.opening - setpoint) + 200.0 * finger_speed, may_release ? -limit : 0.0, limit);
      torque = static_cast<double>(crux_screw_rotor_torque_Nm(&screw, static_cast<float>(force), may_release));
      physics.run(torque, static_cast<double>(kTick));
    }
  }
};

TEST(Screw, SqueezesAsHardAsWantedAndThenRests) {
  for (const double wanted : {8.0, 25.0, 50.0}) {
    Grip grip;
    grip.run(0.01, wanted, true, 3.0);
    EXPECT_NEAR(grip.physics.squeeze(), wanted, 0.08 * wanted);
    EXPECT_NEAR(grip.screw.force_N, grip.physics.squeeze(), 0.10 * wanted) << "the estimate";
    EXPECT_TRUE(grip.screw.braked);
    EXPECT_EQ(grip.torque, 0.0);
  }
}

TEST(Screw, HoldsTheSqueezeWithoutCurrent) {
  Grip grip;
  grip.run(0.01, 30.0, true, 3.0);
  const double before = grip.physics.squeeze();
  grip.physics.run(0.0, 10.0);
  EXPECT_NEAR(grip.physics.squeeze(), before, 1e-9 + 1e-3 * before);
}

TEST(Screw, NeverOpensWhereItMustHold) {
  Grip grip;
  grip.run(0.01, 40.0, true, 3.0);
  const double before = grip.physics.squeeze();
  // Not even when a law above it asks for a force that opens.
  EXPECT_EQ(crux_screw_rotor_torque_Nm(&grip.screw, -40.0F, false), 0.0F);
  for (const double opening : {0.06, 0.03, 0.0199}) {  // would open
    grip.run(opening, 40.0, false, 2.0);
    EXPECT_GE(grip.torque, 0.0);
    EXPECT_NEAR(grip.physics.squeeze(), before, 0.05 * before);
  }
}

TEST(Screw, LetsGoWhenAsked) {
  Grip grip;
  grip.run(0.01, 40.0, true, 3.0);
  grip.run(0.03, 40.0, true, 3.0);
  EXPECT_EQ(grip.physics.squeeze(), 0.0);
  EXPECT_NEAR(grip.physics.opening, 0.03, 5e-4);
  EXPECT_LT(grip.screw.force_N, 1.5F);
}

TEST(Screw, ASqueezeGreaterThanWantedStays) {
  Grip grip;
  grip.run(0.01, 50.0, true, 3.0);
  const double before = grip.physics.squeeze();
  grip.run(0.01, 20.0, true, 3.0);
  EXPECT_NEAR(grip.physics.squeeze(), before, 1e-3 * before);
  EXPECT_TRUE(grip.screw.braked);
}

TEST(Screw, FreeFingersAreNotTakenForASqueeze) {
  Grip grip;
  grip.physics.hold_half_width = 0.0;
  for (int part = 0; part < 20; ++part) {
    grip.run(0.015, 30.0, true, 0.05);
    EXPECT_LT(grip.screw.force_N, 3.0F) << grip.physics.opening;
  }
}

TEST(Stall, TellsAnObjectFromTheEndsOfTravel) {
  const crux_stall_parameters parameters{
      .opening_min_m = 0.008F, .opening_max_m = 0.066F, .speed_limit_m_s = 0.02F, .force_limit_N = 60.0F};
  struct Case {
    float force, opening, speed;
    enum crux_stall_kind kind;
  };
  for (const Case& c : {Case{20.0F, 0.03F, 0.0F, CRUX_STALL_OBJECT}, Case{20.0F, 0.0085F, 0.0F, CRUX_STALL_CLOSED_END},
                        Case{-20.0F, 0.0655F, 0.0F, CRUX_STALL_OPEN_END}, Case{20.0F, 0.03F, -0.01F, CRUX_STALL_NONE},
                        Case{2.0F, 0.03F, 0.0F, CRUX_STALL_NONE}, Case{-20.0F, 0.0085F, 0.0F, CRUX_STALL_OBJECT}}) {
    crux_stall stall{};
    for (int k = 0; k < 99; ++k) {
      crux_stall_tick(&stall, &parameters, kTick, c.force, c.opening, c.speed);
      ASSERT_EQ(stall.kind, CRUX_STALL_NONE);
    }
    for (int k = 0; k < 3; ++k) {
      crux_stall_tick(&stall, &parameters, kTick, c.force, c.opening, c.speed);
    }
    EXPECT_EQ(stall.kind, c.kind) << c.force << " " << c.opening;
    crux_stall_tick(&stall, &parameters, kTick, c.force, c.opening, 0.01F);
    EXPECT_EQ(stall.kind, CRUX_STALL_NONE);
  }
}

}  // namespace
}  // namespace crux::firmware
