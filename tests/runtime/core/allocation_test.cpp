// The real-time path allocates nothing; how long it takes. `core_bench` prints both, and fails on an allocation.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "core/plan/plan_preparation.hpp"
#include "fixture.hpp"
#include "geared.hpp"

extern "C" void* __libc_malloc(std::size_t size);  // NOLINT: glibc's own, under our counter

namespace {
std::atomic<bool> counting{false};
std::atomic<long> allocations{0};
}  // namespace

// Every allocator of C and C++ ends here: operator new, Eigen's and the libraries' alike.
extern "C" void* malloc(std::size_t size) noexcept {
  if (counting) ++allocations;
  return __libc_malloc(size);
}

int main() {
  using namespace crux_test;
  RobotDescription calibrating = robot();
  calibrating.calibrates = true;
  Climber run(sample_plan(), calibrating);
  const std::array geared{geared_robot(), five_barred_robot()};
  std::array<ControlCore, 2> geared_cores{ControlCore(geared[0]), ControlCore(geared[1])};
  for (ControlCore& core : geared_cores)
    if (!core.load_plan(sample_plan()).empty()) return EXIT_FAILURE;
  CycleResult geared_result;
  std::vector<double> microseconds;
  bool seen_climbing = false, taken_over = false;
  for (int i = 0; i < 12000; ++i) {
    crux_msgs::control_input_t& in = run.plant.input();
    using crux_msgs::command_t;
    in.operator_command = i == 1100   ? command_t::START
                          : i == 9000 ? command_t::HOLD
                          : i == 9001 ? command_t::REVERSE
                                      : command_t::NONE;
    if (i == 1000) {  // so is taking another plan over
      crux_msgs::plan_t other = sample_plan();
      other.cost = 1.0;
      sign(other);
      auto prepared = prepare_plan(robot(), other);
      counting = true;
      const bool refused = static_cast<bool>(run.core.exchange_plan(prepared.value()));
      counting = false;
      taken_over = !refused && run.core.state() == SupervisorState::kReady;
    }
    if (i == 11000) in.joint_fresh[3] = 0;  // the way into a fault is real-time too
    counting = true;
    const auto begin = std::chrono::steady_clock::now();
    run.core.step(in, run.result);
    const auto end = std::chrono::steady_clock::now();
    counting = false;
    for (std::size_t g = 0; g < geared.size(); ++g) {
      const crux_msgs::control_input_t of_geared = of_actuators(geared[g], in);
      counting = true;
      geared_cores[g].step(of_geared, geared_result);
      counting = false;
    }
    run.plant.obey(run.result);
    seen_climbing = seen_climbing || run.core.state() == SupervisorState::kClimbing;
    microseconds.push_back(std::chrono::duration<double, std::micro>(end - begin).count());
  }
  // Not a sleeping counter: an allocation under it must show.
  counting = true;
  std::free(std::malloc(1));
  counting = false;
  const long control = allocations.exchange(0) - 1;
  std::sort(microseconds.begin(), microseconds.end());
  const auto at = [&](double share) {
    return microseconds[static_cast<std::size_t>(share * (microseconds.size() - 1))];
  };
  std::printf("step: median %.1f us, p99 %.1f us, max %.1f us; allocations %ld\n", at(0.5), at(0.99), at(1.0), control);
  return seen_climbing && taken_over && control == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
