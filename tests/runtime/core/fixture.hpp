// What the core's tests share: the robot, repeatable random numbers, a small plan and a plant that obeys at once.
#pragma once

#include <gtest/gtest.h>

#include <crux_msgs/control_input_t.hpp>
#include <crux_msgs/plan_t.hpp>
#include <random>

#include "core/control_core.hpp"
#include "core/robot/robot_description.hpp"

namespace crux_test {

using namespace crux;

/// The robot scaler, read once.
const RobotDescription& robot();

/// Repeatable random numbers.
class Random {
 public:
  explicit Random(unsigned seed = 1) : engine_(seed) {}
  double uniform(double low, double high) { return low + (high - low) * (engine_() / 4294967296.0); }
  Vector3 vector(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
  Matrix3 rotation(double angle) { return rotation_exp(vector(angle)); }
  Wrench wrench(double force, double moment) { return {vector(force), vector(moment)}; }

 private:
  std::mt19937 engine_;
};

/// Joint angles of a limb standing on a wall, and random ones about them inside the limits.
JointVector standing_angles();
JointVector random_angles(Random& random, double spread = 0.4);

/// LF climbs one hold up a wall of 45°; the body moves away from it first. Fits robot() and is accepted by it.
crux_msgs::plan_t sample_plan();
/// Hashes a plan that was changed, so that only the change can be the reason of a refusal.
void sign(crux_msgs::plan_t& plan);

/// What nodes make of a command in a period: x += share·(u − x).
double setpoint_share(double dt_s);

/// The limb's fingers have nothing between them but half a newton: they stand where they are told to.
void loosen(crux_msgs::control_input_t& in, int limb);

/// A plant without dynamics: joints are where the nodes' filter of commands says, holds are rigid, and force/torque
/// sensors read the reference of the cycle before.
class ObedientPlant {
 public:
  explicit ObedientPlant(const crux_msgs::plan_t& plan);

  /// What the core reads in the next cycle.
  crux_msgs::control_input_t& input() { return input_; }
  void obey(const CycleResult& result);
  /// What a limb's sensor and joints feel in the next cycle of a force on its gripper, at a place seen from its middle.
  void press(int limb, const CycleResult& result, const Vector3& at_W_m, const Vector3& force_W_N);

 private:
  bool on_hold(int limb, const Vector3& gripper_W_m) const;

  crux_msgs::plan_t plan_;
  crux_msgs::control_input_t input_{};
};

/// A core, its plant and the last result, stepped together.
class Climber {
 public:
  explicit Climber(const crux_msgs::plan_t& plan, const RobotDescription& climbs = robot());
  const CycleResult& step(int command = crux_msgs::command_t::NONE);
  const CycleResult& steps(int n);
  /// Steps until the state is reached, at most n times; true when it was.
  bool until(SupervisorState state, int n);

  ControlCore core;
  ObedientPlant plant;
  CycleResult result;
};

/// A climb that has begun.
class Climbing : public testing::Test {
 protected:
  void SetUp() override;

  Climber run_{sample_plan()};
};

}  // namespace crux_test
