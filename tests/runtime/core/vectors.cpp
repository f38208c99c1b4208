// Prints what the core computes, for comparison with independent programs. Reads joint angles, six a line, of limb
// ARGV[1] under gravity -9.81 along the body's z; prints gripper position, rotation (row by row), Jacobian (row by row)
// and gravity torques, one line each.
#include <cstdio>
#include <cstdlib>
#include <iostream>

#include "core/gravity.hpp"
#include "fixture.hpp"

int main(int argc, char** argv) {
  using namespace crux_test;
  if (argc != 2) return EXIT_FAILURE;
  LimbKinematics kinematics(robot().limbs[std::atoi(argv[1])]);
  JointVector q;
  while (std::cin >> q[0] >> q[1] >> q[2] >> q[3] >> q[4] >> q[5]) {
    LimbState state;
    kinematics.evaluate(q, state);
    const auto print = [](double value) { std::printf("%.17g ", value); };
    for (int i = 0; i < 3; ++i) print(state.gripper_B.position_m[i]);
    for (int i = 0; i < 9; ++i) print(state.gripper_B.rotation(i / 3, i % 3));
    for (int i = 0; i < 36; ++i) print(state.jacobian_B(i / 6, i % 6));
    const JointVector torque = gravity_torque(state, {0.0, 0.0, -9.81});
    for (int i = 0; i < kJoints; ++i) print(torque[i]);
    std::printf("\n");
  }
  return EXIT_SUCCESS;
}
