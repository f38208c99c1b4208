// Actuators and joints against the golden vectors; a robot whose actuators are its joints, and one whose are not.
#include "core/robot/transmission.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <optional>

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

FiveBar five_bar(const nlohmann::json& bar) {
  crux_msgs::robot::FiveBar found;
  const nlohmann::json& keys = bar["keys"];
  const auto read = [&](const char* key, double& value) { value = keys[key].get<double>(); };
  read("first_joint", found.first_joint), read("bends", found.bends), read("least_sine", found.least_sine);
  read("crank_x_m", found.crank_x_m), read("crank_y_m", found.crank_y_m), read("crank_m", found.crank_m);
  read("rod_m", found.rod_m), read("pin_x_m", found.pin_x_m), read("pin_y_m", found.pin_y_m);
  const nlohmann::json& middle = bar["middle_rad"];
  return {found,
          bar["link_m"].get<double>(),
          bar["sense"].get<double>(),
          {middle[0].get<double>(), middle[1].get<double>()}};
}

void expect_golden(const nlohmann::json& one, const LimbLimits& wide, const std::optional<FiveBar>& bar) {
  const crux_msgs::robot::Transmissions keys = section(one["section"]);
  const Transmission transmission(keys, kSix, "robot.yaml", bar);
  EXPECT_FALSE(transmission.direct());
  const LimbLimits left = transmission.within(wide, own_limits(keys));
  expect_limits(one["left"], left);
  expect_limits(one["reached"], transmission.reached(left, wide, own_limits(keys)));
  const nlohmann::json& does = one["does"];
  const JointVector q = vector(does["joints_rad"]), ways = vector(does["ways"]), torque = vector(does["torque_Nm"]);
  const JointVector actuators = vector(does["actuators_rad"]), actuators_Nm = vector(does["actuators_Nm"]);
  EXPECT_TRUE(transmission.actuators_rad(q).isApprox(actuators, kNear));
  EXPECT_TRUE(transmission.joints_rad(actuators).isApprox(q, kNear));
  EXPECT_TRUE(transmission.actuator_ways(ways, q).isApprox(vector(does["actuator_ways"]), kNear));
  EXPECT_TRUE(transmission.joint_ways(vector(does["actuator_ways"]), q).isApprox(ways, kNear));
  EXPECT_TRUE(transmission.actuator_torque_Nm(torque, q).isApprox(actuators_Nm, kNear));
  EXPECT_TRUE(transmission.joint_torque_Nm(actuators_Nm, q).isApprox(torque, kNear));
}

TEST(Transmission, EqualsTheGoldenVectors) {
  const nlohmann::json all = golden("transmissions.json");
  ASSERT_GT(all.size(), 10U);
  LimbLimits wide{};
  for (int j = 0; j < kSix; ++j) wide[j] = {-2.0, 2.0, 5.0, 10.0};
  for (const nlohmann::json& one : all) expect_golden(one, wide, std::nullopt);
}

TEST(Transmission, WithAFiveBarEqualsTheGoldenVectors) {
  const nlohmann::json all = golden("five_bars.json");
  ASSERT_GT(all.size(), 5U);
  for (const nlohmann::json& one : all) {
    const FiveBar bar = five_bar(one["bar"]);
    LimbLimits wide{};
    for (int j = 0; j < kSix; ++j) wide[j] = {-2.0, 2.0, 5.0, 10.0};
    for (const int j : {0, 1}) {
      const double middle_rad = one["bar"]["middle_rad"][j].get<double>();
      wide[bar.first() + j].lower_rad = middle_rad - 1.0;
      wide[bar.first() + j].upper_rad = middle_rad + 1.0;
    }
    expect_golden(one, wide, bar);
  }
}

TEST(Transmission, OfARobotWithoutAnyChangesNoBit) {
  for (const LimbDescription& limb : robot().limbs) {
    const JointVector odd = JointVector::LinSpaced(-0.0, 1.0 / 3.0) * -1.0;
    EXPECT_TRUE(limb.transmission.direct());
    EXPECT_EQ(std::memcmp(limb.transmission.actuators_rad(odd).data(), odd.data(), sizeof odd), 0);
    EXPECT_EQ(std::memcmp(limb.transmission.joint_torque_Nm(odd, odd).data(), odd.data(), sizeof odd), 0);
    EXPECT_EQ(std::memcmp(limb.actuators.data(), limb.joints.data(), sizeof limb.joints), 0);
  }
}

/// The joints of a robot with transmissions are told what those of the other are told.
void expect_the_same_joints(RobotDescription geared) {
  RobotDescription plain = robot();
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
    const crux_msgs::control_input_t of_joints = run.plant.input();
    crux_msgs::control_input_t in = of_actuators(geared, of_joints);
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
      const JointVector dq = by.joint_ways(of(told.output.joint_velocity_rad_s), q);
      ASSERT_LT((dq - of(right.output.joint_velocity_rad_s)).norm(), 1e-5) << i;
      if (climbed == 0) continue;  // before that the delays of actuators are measured, each by torques of its own
      const JointVector torque_Nm =
          by.joint_torque_Nm(of(told.output.joint_torque_nm), of(of_joints.joint_position_rad));
      ASSERT_LT((torque_Nm - of(right.output.joint_torque_nm)).norm(), 1e-5) << i;
    }
  }
  EXPECT_GT(climbed, 1000);
}

TEST(Transmission, TheJointsOfAGearedRobotAreToldWhatOthersAreTold) { expect_the_same_joints(geared_robot()); }

TEST(Transmission, TheJointsOfAFiveBarAreToldWhatOthersAreTold) { expect_the_same_joints(five_barred_robot()); }

}  // namespace
}  // namespace crux_test
