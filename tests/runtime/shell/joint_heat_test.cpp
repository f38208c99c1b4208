// The heat that the runtime counts, against that which the nodes count.
#include "core/limb/joint_heat.hpp"

#include "fixture.hpp"
#include "motor_models.hpp"

namespace crux_test {
namespace {

TEST(JointHeat, IsCountedAsTheNodesCountIt) {
  constexpr double kDt_s = 0.002;
  constexpr int kJoint = 1;
  const crux_msgs::robot::Motor& described = robot().motor;
  const double effort_Nm = robot().limbs[0].joints[kJoint].effort_Nm;
  crux_motor_parameters motor = crux::firmware::test_motor();
  const double torque_Nm_A = described.torque_constant_Nm_A * described.gear_ratio * described.gear_efficiency;
  motor.continuous_current_A = static_cast<float>(described.continuous_current_A);
  motor.heating_time_s = static_cast<float>(described.heating_time_s);
  motor.peak_current_A = static_cast<float>(effort_Nm / torque_Nm_A);
  crux_heat node;
  crux_heat_init(&node, &motor);
  node.load = 0.0F;
  JointHeat heat(described, robot().limbs[0].joints);
  bool folded = false, recovers = false;
  for (int cycle = 0; cycle < 60'000; ++cycle) {
    const double torque_Nm = cycle == 0 ? 0.0 : (cycle < 30'000 ? 0.9 : 0.1) * effort_Nm;  // hard, then at rest
    heat.take(JointVector::Constant(torque_Nm), kDt_s);
    crux_heat_tick(&node, &motor, kDt_s, static_cast<float>(torque_Nm / torque_Nm_A), 25.0F);
    if (cycle == 0) node.load = 0.0F;  // its thermometer says so
    ASSERT_NEAR(heat.allowed_Nm(kJoint), node.allowed_A * torque_Nm_A, 0.005 * effort_Nm) << cycle;
    folded = folded || node.allowed_A < 0.9F * motor.peak_current_A;
    recovers = folded && node.allowed_A == motor.peak_current_A;
  }
  EXPECT_TRUE(recovers);
}

}  // namespace
}  // namespace crux_test
