// Actuators and joints against the golden vectors; a robot whose actuators are its joints, and one whose are not.
#include "core/robot/transmission.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "../../msgs/golden_vectors.hpp"
#include "fixture.hpp"
#include "geared.hpp"

namespace crux_test {
namespace {

constexpr int kSix = 6;
constexpr double kNear = 1e-9;

JointVector vector(const nlohmann::json& numbers) {
  JointVector found = JointVector::Zero();
  for (int j = 0; j < kSix; ++j) found[j] = numbers[j].get<double>();
  return found;
}

crux_msgs::robot::Transmissions section(const nlohmann::json& keys) {
  crux_msgs::robot::Transmissions found;
  const auto read = [&](const char* key, crux_msgs::robot::PerJoint& values) {
    std::copy_n(vector(keys[key]).data(), kJoints, values.begin());
  };
  read("ratio", found.ratio), read("offset_rad", found.offset_rad), read("coupled_to", found.coupled_to);
  read("coupling", found.coupling), read("low_rad", found.low_rad), read("high_rad", found.high_rad);
  read("speed_rad_s", found.speed_rad_s), read("torque_Nm", found.torque_Nm);
  return found;
}

void expect_limits(const nlohmann::json& golden, const LimbLimits& limits) {
  for (int j = 0; j < kSix; ++j) {
    EXPECT_NEAR(limits[j].lower_rad, golden["low_rad"][j].get<double>(), kNear);
    EXPECT_NEAR(limits[j].upper_rad, golden["high_rad"][j].get<double>(), kNear);
    EXPECT_NEAR(limits[j].velocity_rad_s, golden["speed_rad_s"][j].get<double>(), kNear);
    EXPECT_NEAR(limits[j].effort_Nm, golden["torque_Nm"][j].get<double>(), kNear);
  }
}

TEST(Transmission, EqualsTheGoldenVectors) {
  const nlohmann::json all = golden("transmissions.json");
  ASSERT_GT(all.size(), 10U);
  for (const nlohmann::json& one : all) {
    const crux_msgs::robot::Transmissions keys = section(one["section"]);
    const Transmission transmission(keys, kSix, "robot.yaml");
    EXPECT_FALSE(transmission.direct());
    LimbLimits wide{};
    for (int j = 0; j < kSix; ++j) wide[j] = {-2.0, 2.0, 5.0, 10.0};
    const LimbLimits left = transmission.within(wide, own_limits(keys));
    expect_limits(one["left"], left);
    expect_limits(one["reached"], transmission.reached(left));
    const nlohmann::json& does = one["does"];
    const JointVector q = vector(does["joints_rad"]), ways = vector(does["ways"]), torque = vector(does["torque_Nm"]);
    const JointVector actuators = vector(does["actuators_rad"]), actuators_Nm = vector(does["actuators_Nm"]);
    EXPECT_TRUE(transmission.actuators_rad(q).isApprox(actuators, kNear));
    EXPECT_TRUE(transmission.joints_rad(actuators).isApprox(q, kNear));
    EXPECT_TRUE(transmission.actuator_ways(ways).isApprox(vector(does["actuator_ways"]), kNear));
    EXPECT_TRUE(transmission.joint_ways(vector(does["actuator_ways"])).isApprox(ways, kNear));
    EXPECT_TRUE(transmission.actuator_torque_Nm(torque).isApprox(actuators_Nm, kNear));
    EXPECT_TRUE(transmission.joint_torque_Nm(actuators_Nm).isApprox(torque, kNear));
  }
}

TEST(Transmission, OfARobotWithoutAnyChangesNoBit) {
  for (const LimbDescription& limb : robot().limbs) {
    const JointVector odd = JointVector::LinSpaced(-0.0, 1.0 / 3.0) * -1.0;
    EXPECT_TRUE(limb.transmission.direct());
    EXPECT_EQ(std::memcmp(limb.transmission.actuators_rad(odd).data(), odd.data(), sizeof odd), 0);
    EXPECT_EQ(std::memcmp(limb.transmission.joint_torque_Nm(odd).data(), odd.data(), sizeof odd), 0);
    EXPECT_EQ(std::memcmp(limb.actuators.data(), limb.joints.data(), sizeof limb.joints), 0);
  }
}

TEST(Transmission, TheJointsOfAGearedRobotAreToldWhatOthersAreTold) {
  RobotDescription plain = robot(), geared = geared_robot();
  plain.servo.damping_Nms_rad.fill(0.0);  // friction is at the actuators
  geared.servo.damping_Nms_rad.fill(0.0);
  const crux_msgs::plan_t plan = sample_plan();
  Climber run(plan, plain);
  ControlCore core(geared);
  ASSERT_EQ(core.load_plan(plan), "");
  CycleResult told;
  int climbed = 0;
  for (int i = 0; i < 4000; ++i) {
    using crux_msgs::command_t;
    const int command = i == 1100 ? command_t::START : command_t::NONE;
    crux_msgs::control_input_t in = of_actuators(geared, run.plant.input());
    in.operator_command = static_cast<std::int8_t>(command);
    core.step(in, told);
    const CycleResult& right = run.step(command);
    ASSERT_EQ(told.state.supervisor_state, right.state.supervisor_state) << i;
    climbed += right.state.plan_time_s > 0.0 ? 1 : 0;
    for (int l = 0; l < kLimbs; ++l) {
      const Transmission& by = geared.limbs[l].transmission;
      const auto of = [l](const double* all) { return JointVector(all + kJoints * l); };
      const JointVector q = by.joints_rad(of(told.output.joint_position_rad));
      ASSERT_TRUE(q.isApprox(of(right.output.joint_position_rad), 1e-7)) << i;
      const JointVector dq = by.joint_ways(of(told.output.joint_velocity_rad_s));
      ASSERT_LT((dq - of(right.output.joint_velocity_rad_s)).norm(), 1e-5) << i;
      if (climbed == 0) continue;  // before that the delays of actuators are measured, each by torques of its own
      const JointVector torque_Nm = by.joint_torque_Nm(of(told.output.joint_torque_nm));
      ASSERT_LT((torque_Nm - of(right.output.joint_torque_nm)).norm(), 1e-5) << i;
    }
  }
  EXPECT_GT(climbed, 1000);
}

}  // namespace
}  // namespace crux_test
