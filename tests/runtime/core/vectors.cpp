// Prints what the core computes, for comparison with independent programs: one line of numbers for each that it reads.
//   core_vectors limb L    joint angles (6) of limb L under gravity -9.81 along the body's z -> gripper position,
//                          rotation (row by row), Jacobian (row by row), gravity torques
//   core_vectors grasp     force, moment, finger axis (3 each), friction, k, half opening -> needed grasp force
//   core_vectors yield     wrench errors (6) of one gripper, a period of 2 ms apart -> offset and rotation
#include <array>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string_view>

#include "core/limb/admittance.hpp"
#include "core/loads/grasp_force.hpp"
#include "core/robot/gravity.hpp"
#include "fixture.hpp"

namespace {

using namespace crux_test;

void print(double value) { std::printf("%.17g ", value); }

void print(const Vector3& vector) {
  for (int i = 0; i < 3; ++i) print(vector[i]);
}

template <std::size_t kSize>
bool read(std::array<double, kSize>& values) {
  for (double& value : values) {
    if (!(std::cin >> value)) return false;
  }
  return true;
}

Vector3 part(const double* values) { return {values[0], values[1], values[2]}; }

void print_limb(int limb) {
  LimbKinematics kinematics(robot().limbs[limb]);
  JointVector q = JointVector::Zero();
  while (std::cin >> q[0] >> q[1] >> q[2] >> q[3] >> q[4] >> q[5]) {
    LimbState state;
    kinematics.evaluate(q, state);
    print(state.gripper_B.position_m);
    for (int i = 0; i < 9; ++i) print(state.gripper_B.rotation(i / 3, i % 3));
    for (int i = 0; i < 36; ++i) print(state.jacobian_B(i / 6, i % 6));
    const JointVector torque = gravity_torque(state, {0.0, 0.0, -9.81});
    for (int i = 0; i < kPlacing; ++i) print(torque[i]);
    std::printf("\n");
  }
}

void print_grasp_forces() {
  std::array<double, 12> v{};
  while (read(v)) {
    const Contact contact{v[9], v[10], 60.0, v[11]};
    print(needed_grasp_force_N({part(&v[0]), part(&v[3])}, part(&v[6]), contact, robot().control));
    std::printf("\n");
  }
}

void print_yielding() {
  constexpr double kPeriod_s = 0.002;
  Admittance admittance(robot().admittance);
  std::array<double, 6> v{};
  while (read(v)) {
    admittance.step({part(&v[0]), part(&v[3])}, kPeriod_s);
    print(admittance.offset_m());
    print(admittance.rotation_rad());
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view what = argc > 1 ? argv[1] : "";
  if (what == "limb" && argc == 3) {
    print_limb(std::atoi(argv[2]));
  } else if (what == "grasp" && argc == 2) {
    print_grasp_forces();
  } else if (what == "yield" && argc == 2) {
    print_yielding();
  } else {
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}
