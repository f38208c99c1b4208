#include "app/operator_desk.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "crux_msgs/robot_state_t.hpp"

namespace crux {
namespace {

using crux_msgs::acknowledgement_t;
using crux_msgs::command_t;
using crux_msgs::robot_state_t;

class FakeTaker : public PlanTaker {
 public:
  Reason take_plan(std::unique_ptr<const PreparedPlan>& plan) noexcept override {
    if (refusal != nullptr) return {refusal};
    in_use.swap(plan);
    return {};
  }
  std::unique_ptr<const PreparedPlan> in_use;
  const char* refusal = nullptr;
};

class OperatorDeskTest : public ::testing::Test {
 protected:
  void request(std::int8_t command, std::int64_t at_cycle = 0) {
    Request* slot = requests_.back();
    ASSERT_NE(slot, nullptr);
    slot->kind = Request::Kind::kCommand;
    slot->ticket = ++ticket_;
    slot->command = command;
    slot->at_cycle = at_cycle;
    slot->entry = std::make_unique<LogEntry>();
    slot->entry->acknowledgement.request_id = ticket_;
    requests_.push();
  }
  void request_plan(const std::string& id) {
    Request* slot = requests_.back();
    ASSERT_NE(slot, nullptr);
    auto plan = std::make_unique<PreparedPlan>();
    plan->plan_id = id;
    slot->kind = Request::Kind::kPlan;
    slot->ticket = ++ticket_;
    slot->command = command_t::NONE;
    slot->plan = std::move(plan);
    slot->entry = std::make_unique<LogEntry>();
    requests_.push();
  }
  /// One cycle in which the core obeys, or refuses for the reason given.
  std::int8_t cycle(std::int64_t n, const char* refused_because = "") {
    const std::int8_t command = desk_.begin_cycle(n, robot_state_t::READY, taker_, events_);
    desk_.end_cycle(robot_state_t::CLIMBING, {refused_because}, events_);
    return command;
  }
  std::vector<Answer> answers() {
    std::vector<Answer> all;
    for (Answer* answer; (answer = answers_.front()) != nullptr; answers_.pop()) all.push_back(std::move(*answer));
    return all;
  }
  std::size_t take_events() {
    const auto n = static_cast<std::size_t>(events_.end() - events_.begin());
    events_.clear();
    return n;
  }

  SpscRing<Request> requests_{16};
  SpscRing<Answer> answers_{64};
  OperatorDesk desk_{requests_, answers_};
  FakeTaker taker_;
  EventList events_;
  std::uint32_t ticket_ = 0;
};

TEST_F(OperatorDeskTest, AScheduledStartComesInItsCycleAndInNoOther) {
  request(command_t::START, 5);
  desk_.serve_before_first_cycle(taker_, events_);
  auto first = answers();
  ASSERT_EQ(first.size(), 1U);
  EXPECT_TRUE(first[0].scheduled);
  EXPECT_EQ(first[0].outcome.verdict, acknowledgement_t::ACCEPTED);
  EXPECT_EQ(take_events(), 0U);  // not in the log before it is carried out
  for (std::int64_t n = 1; n <= 10; ++n) {
    EXPECT_EQ(cycle(n), n == 5 ? command_t::START : command_t::NONE) << n;
    EXPECT_EQ(take_events(), n == 5 ? 1U : 0U) << n;
  }
  const auto second = answers();
  ASSERT_EQ(second.size(), 1U);
  EXPECT_FALSE(second[0].scheduled);
  EXPECT_EQ(second[0].ticket, first[0].ticket);
  EXPECT_EQ(second[0].outcome.supervisor_state, robot_state_t::CLIMBING);
}

TEST_F(OperatorDeskTest, ACommandsValueIsThereInItsCycleAndInNoOther) {
  request(command_t::SPEED);
  requests_.front()->value = 0.25;
  EXPECT_EQ(desk_.begin_cycle(1, robot_state_t::CLIMBING, taker_, events_), command_t::SPEED);
  EXPECT_EQ(desk_.value(), 0.25);
  desk_.end_cycle(robot_state_t::CLIMBING, {}, events_);
  EXPECT_EQ(desk_.begin_cycle(2, robot_state_t::CLIMBING, taker_, events_), command_t::NONE);
  EXPECT_EQ(desk_.value(), 0.0);
}

TEST_F(OperatorDeskTest, AScheduledStartThatTheCoreRefusesSaysSo) {
  request(command_t::START, 2);
  cycle(1);
  cycle(2, "the robot does not stand at the plan's start");
  const auto all = answers();
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[1].outcome.verdict, acknowledgement_t::REFUSED);
  EXPECT_STREQ(all[1].outcome.reason.text, "the robot does not stand at the plan's start");
  ASSERT_EQ(events_.end() - events_.begin(), 1);
  EXPECT_EQ(events_.begin()->outcome.verdict, acknowledgement_t::REFUSED);
}

TEST_F(OperatorDeskTest, ACycleThatHasPassedIsRefused) {
  request(command_t::START, 3);
  EXPECT_EQ(cycle(4), command_t::NONE);
  const auto all = answers();
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all[0].outcome.verdict, acknowledgement_t::REFUSED);
}

TEST_F(OperatorDeskTest, CommandsAtOnceComeOneACycleInOrder) {
  request(command_t::START);
  request(command_t::HOLD);
  request(command_t::RESUME);
  for (const std::int8_t expected : {command_t::START, command_t::HOLD, command_t::RESUME, command_t::NONE}) {
    EXPECT_EQ(cycle(expected), expected);
    take_events();
  }
  EXPECT_EQ(answers().size(), 3U);
}

TEST_F(OperatorDeskTest, HoldCancelsWhatIsScheduled) {
  request(command_t::START, 3);
  request(command_t::RESUME, 9);
  cycle(1);
  answers();
  request(command_t::HOLD);
  EXPECT_EQ(cycle(2), command_t::HOLD);
  const auto all = answers();
  ASSERT_EQ(all.size(), 3U);
  EXPECT_EQ(all[0].outcome.verdict, acknowledgement_t::REFUSED);
  EXPECT_EQ(all[1].outcome.verdict, acknowledgement_t::REFUSED);
  EXPECT_EQ(all[2].outcome.verdict, acknowledgement_t::ACCEPTED);
  EXPECT_EQ(cycle(3), command_t::NONE);
  EXPECT_EQ(cycle(9), command_t::NONE);
}

TEST_F(OperatorDeskTest, HoldInTheVeryCycleOfAStartWins) {
  request(command_t::START, 2);
  cycle(1);
  request(command_t::HOLD);
  EXPECT_EQ(cycle(2), command_t::HOLD);
}

TEST_F(OperatorDeskTest, AScheduledCommandKeepsItsCycleAgainstOneAtOnce) {
  request(command_t::START, 2);
  cycle(1);
  answers();
  request(command_t::RESUME);
  EXPECT_EQ(cycle(2), command_t::START);
  const auto all = answers();
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].outcome.verdict, acknowledgement_t::REFUSED);
  EXPECT_EQ(all[1].outcome.verdict, acknowledgement_t::ACCEPTED);
}

TEST_F(OperatorDeskTest, BeforeTheNodesAnswerOnlyHoldIsGrantedAtOnce) {
  request(command_t::START);
  request(command_t::HOLD);
  request(command_t::CLEAR_FAULT);
  desk_.serve_before_first_cycle(taker_, events_);
  const auto all = answers();
  ASSERT_EQ(all.size(), 3U);
  EXPECT_EQ(all[0].outcome.verdict, acknowledgement_t::REFUSED);
  EXPECT_EQ(all[1].outcome.verdict, acknowledgement_t::ACCEPTED);
  EXPECT_EQ(all[2].outcome.verdict, acknowledgement_t::REFUSED);
  EXPECT_EQ(cycle(1), command_t::NONE);
}

TEST_F(OperatorDeskTest, ManySchedulesAreBounded) {
  for (int i = 0; i < 16; ++i) request(command_t::START, 100);
  std::size_t granted = 0, refused = 0;
  for (std::int64_t n = 1; n <= 20; ++n) {
    cycle(n);
    take_events();
    for (const Answer& answer : answers()) ++(answer.scheduled ? granted : refused);
  }
  EXPECT_EQ(granted, 4U);
  EXPECT_EQ(refused, 12U);
}

TEST_F(OperatorDeskTest, PlansAreSwappedAndTheOldOneComesBack) {
  request_plan("first");
  request_plan("second");
  cycle(1);
  ASSERT_TRUE(taker_.in_use);
  EXPECT_EQ(taker_.in_use->plan_id, "second");
  auto all = answers();
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].retired, nullptr);
  ASSERT_NE(all[1].retired, nullptr);
  EXPECT_EQ(all[1].retired->plan_id, "first");
  taker_.refusal = "climbing";
  request_plan("third");
  cycle(2);
  all = answers();
  EXPECT_EQ(all[0].outcome.verdict, acknowledgement_t::REFUSED);
  EXPECT_EQ(all[0].retired->plan_id, "third");
  EXPECT_EQ(taker_.in_use->plan_id, "second");
}

TEST_F(OperatorDeskTest, NothingIsLostWhileTheLogTakesNoEvents) {
  for (int i = 0; i < 16; ++i) request(command_t::HOLD);
  std::size_t carried_out = 0;
  for (std::int64_t n = 1; n <= 100; ++n) carried_out += cycle(n) == command_t::HOLD ? 1 : 0;
  EXPECT_LT(carried_out, 16U);  // it waits for room
  for (std::int64_t n = 101; n <= 200; ++n) {
    take_events();
    carried_out += cycle(n) == command_t::HOLD ? 1 : 0;
  }
  EXPECT_EQ(carried_out, 16U);
}

TEST_F(OperatorDeskTest, ShutdownAndClose) {
  request(command_t::SHUTDOWN, 2);
  request(command_t::START, 9);
  cycle(1);
  EXPECT_FALSE(desk_.shutdown());
  cycle(2);
  EXPECT_TRUE(desk_.shutdown());
  answers();
  request(command_t::RESUME);
  desk_.close(robot_state_t::HOLDING, events_);
  const auto all = answers();
  ASSERT_EQ(all.size(), 2U);
  for (const Answer& answer : all) EXPECT_EQ(answer.outcome.verdict, acknowledgement_t::REFUSED);
}

}  // namespace
}  // namespace crux
