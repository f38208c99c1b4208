// The real-time thread's way through buses, limbs, desk and queues allocates nothing.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <new>

#include "app/operator_desk.hpp"
#include "bus/bus.hpp"
#include "bus/limb_bus.hpp"
#include "crux_msgs/robot_state_t.hpp"
#include "exchange/cycle_record.hpp"

namespace {
std::atomic<bool> g_counting{false};
std::atomic<int> g_allocations{0};
}  // namespace

void* operator new(std::size_t size) {
  if (g_counting) ++g_allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept {
  if (g_counting) ++g_allocations;
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept { operator delete(memory); }

namespace crux {
namespace {

class Taker : public PlanTaker {
 public:
  Reason take_plan(std::unique_ptr<const PreparedPlan>& plan) noexcept override {
    in_use.swap(plan);
    return {};
  }
  std::unique_ptr<const PreparedPlan> in_use;
};

RobotDescription some_robot() {
  RobotDescription robot;
  robot.sha256 = std::string(64, '0');
  for (std::size_t joint = 0; joint < kJoints; ++joint) robot.can.nodes.joints[joint] = static_cast<int>(joint) + 1;
  robot.can.nodes.gripper = 7;
  return robot;
}

TEST(RealTimePath, AllocatesNothing) {
  const auto bus = open_bus("udp:239.74.163.9:" + std::to_string(20000 + ::getpid() % 20000 + 10));
  LimbBus limb(0, some_robot());
  SpscRing<Request> requests(16);
  SpscRing<Answer> answers(64);
  SpscRing<CycleRecord> records(64);
  OperatorDesk desk(requests, answers);
  Taker taker;
  std::array<Frame, 64> frames{};
  for (std::uint32_t i = 0; i < 8; ++i) {
    Request* slot = requests.back();
    slot->kind = i % 2 == 0 ? Request::Kind::kCommand : Request::Kind::kPlan;
    slot->command = crux_msgs::command_t::HOLD;
    slot->at_cycle = i == 4 ? 40 : 0;
    slot->plan = std::make_unique<PreparedPlan>();
    slot->entry = std::make_unique<LogEntry>();
    requests.push();
  }
  EventList events;

  g_counting = true;
  for (std::uint32_t n = 1; n <= 50; ++n) {
    CycleRecord* record = records.back();
    bus->send(limb.pack_cycle(record->result.output, n, nullptr));
    for (std::size_t i = 0, k = bus->receive(frames); i < k; ++i) {
      NodeNotice notice;
      limb.take(frames[i], notice);
    }
    limb.fill(record->input);
    desk.begin_cycle(n, crux_msgs::robot_state_t::READY, taker, events);
    desk.end_cycle(crux_msgs::robot_state_t::HOLDING, {}, events);
    events.move_to(record->events);
    records.push();
  }
  g_counting = false;

  EXPECT_EQ(g_allocations, 0);
  EXPECT_EQ(requests.front(), nullptr);
  EXPECT_NE(taker.in_use, nullptr);
  EXPECT_GT(bus->statistics().received, 0U);
}

}  // namespace
}  // namespace crux
