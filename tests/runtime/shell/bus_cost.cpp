// What the buses cost the control cycle: nodes in a thread of their own answer every Sync at once; the runtime's side
// is timed without its waiting. usage: bus_cost [CYCLES [FIRST_BUS]]
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "bus/limb_bus.hpp"
#include "core/robot/robot_description.hpp"
#include "crux_can.h"

namespace {

using namespace crux;
using Clock = std::chrono::steady_clock;
using Buses = std::array<std::unique_ptr<Bus>, 4>;

Buses open_all(const std::string& first) {
  Buses buses;
  const auto names = consecutive_udp_buses(first);
  for (std::size_t l = 0; l < buses.size(); ++l) buses[l] = open_bus(names[l]);
  return buses;
}

/// Statuses of one limb that are right in identifier, size, counter, CRC and echo.
class Answers {
 public:
  std::span<const Frame> to(std::uint16_t cycle) {
    for (std::uint32_t node = 1; node < CRUX_CAN_NODE_GRIPPER; ++node) {
      crux_can_joint_status_t status{};
      status.cycle_echo = cycle;
      Frame& frame = set(node - 1, CRUX_CAN_ID_JOINT_STATUS(node), CRUX_CAN_LENGTH_JOINT_STATUS);
      crux_can_joint_status_pack(frame.data.data(), &status, frame.length);
    }
    crux_can_gripper_status_t status{};
    status.cycle_echo = cycle;
    Frame& gripper = set(6, CRUX_CAN_ID_GRIPPER_STATUS, CRUX_CAN_LENGTH_GRIPPER_STATUS);
    crux_can_gripper_status_pack(gripper.data.data(), &status, gripper.length);
    crux_can_force_torque_t sample{};
    sample.cycle_echo = cycle;
    Frame& ft = set(7, CRUX_CAN_ID_FORCE_TORQUE, CRUX_CAN_LENGTH_FORCE_TORQUE);
    crux_can_force_torque_pack(ft.data.data(), &sample, ft.length);
    ++counter_;
    for (Frame& frame : frames_) crux_e2e_protect(frame.id, counter_, frame.data.data(), frame.length);
    return frames_;
  }

 private:
  Frame& set(std::size_t i, std::uint32_t id, std::uint32_t length) {
    frames_[i].id = id;
    frames_[i].length = static_cast<std::uint8_t>(length);
    return frames_[i];
  }
  std::array<Frame, 8> frames_{};
  std::uint8_t counter_ = 0;
};

void serve(Buses& buses, const std::atomic<bool>& ended) {
  std::array<Answers, 4> answers;
  std::array<Frame, 64> frames;
  while (!ended) {
    wait_readable(buses, std::chrono::milliseconds(10));
    for (std::size_t l = 0; l < buses.size(); ++l) {
      for (std::size_t i = 0, n = buses[l]->receive(frames); i < n; ++i) {
        if (frames[i].id != CRUX_CAN_ID_SYNC) continue;
        crux_can_sync_t sync{};
        crux_can_sync_unpack(&sync, frames[i].data.data(), frames[i].length);
        buses[l]->send(answers[l].to(static_cast<std::uint16_t>(sync.cycle)));
      }
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int cycles = argc > 1 ? std::atoi(argv[1]) : 2000;
  const std::string first = argc > 2 ? argv[2] : "udp:239.74.163.9:46113";
  RobotDescription robot;
  robot.sha256 = std::string(64, '0');
  for (int joint = 0; joint < kJoints; ++joint) robot.can.nodes.joints[static_cast<std::size_t>(joint)] = joint + 1;
  robot.can.nodes.gripper = CRUX_CAN_NODE_GRIPPER;
  Buses buses = open_all(first), node_buses = open_all(first);
  std::atomic<bool> ended{false};
  std::thread nodes([&] { serve(node_buses, ended); });

  std::array<LimbBus, 4> limbs = {LimbBus(0, robot), LimbBus(1, robot), LimbBus(2, robot), LimbBus(3, robot)};
  std::vector<double> send_us, receive_us, total_us;
  std::array<Frame, 64> frames;
  crux_msgs::control_output_t output{};
  for (int n = 1; n <= cycles; ++n) {
    const auto begin = Clock::now();
    for (std::size_t l = 0; l < 4; ++l)
      buses[l]->send(limbs[l].pack_cycle(output, static_cast<std::uint32_t>(n), nullptr));
    const double sending = std::chrono::duration<double, std::micro>(Clock::now() - begin).count();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));  // all answers are there: only reading them is timed
    const auto reading_begin = Clock::now();
    for (std::size_t l = 0; l < 4; ++l) {
      for (std::size_t i = 0, k = buses[l]->receive(frames); i < k; ++i) {
        NodeNotice notice;
        limbs[l].take(frames[i], notice);
      }
    }
    const double reading = std::chrono::duration<double, std::micro>(Clock::now() - reading_begin).count();
    if (!std::ranges::all_of(limbs, [](const LimbBus& limb) { return limb.complete(); })) continue;
    send_us.push_back(sending);
    receive_us.push_back(reading);
    total_us.push_back(sending + reading);
  }
  ended = true;
  nodes.join();
  const auto line = [](const char* what, std::vector<double>& us) {
    if (us.empty()) return;
    std::ranges::sort(us);
    std::printf("%-8s median %6.1f us   p99 %6.1f us\n", what, us[us.size() / 2], us[us.size() * 99 / 100]);
  };
  std::printf("%zu of %d cycles complete\n", total_us.size(), cycles);
  line("send", send_us);
  line("receive", receive_us);
  line("total", total_us);
  return 0;
}
