// The operator's side in this thread, with messages as they come, and what it answers. CRUX_FUZZ_PACKETS: how many
// damaged ones; the same in every run.
#include "lcm/operator_server.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <random>

#include "crux_msgs/answer_t.hpp"
#include "crux_msgs/cdr.hpp"
#include "signed_messages.hpp"

namespace crux {
namespace {

using crux_msgs::acknowledgement_t;
using crux_msgs::Channel;
using crux_msgs::command_t;
using namespace std::chrono_literals;

class OperatorServerTest : public testing::Test {
 protected:
  OperatorServerTest() {
    using Self = OperatorServerTest*;
    const auto keep = [](const lcm::ReceiveBuffer* buffer, const std::string&, Self self) {
      const auto* bytes = static_cast<const std::uint8_t*>(buffer->data);
      self->answers_.emplace_back(bytes, bytes + buffer->data_size);
    };
    server_.link().subscribeFunction<Self>(crux_msgs::channel_info(Channel::kAnswer).name, keep, this);
  }

  void send(Channel channel, const MessageBytes& bytes) {
    server_.link().publish(crux_msgs::channel_info(channel).name, bytes.data(), static_cast<unsigned>(bytes.size()));
    settle();
  }
  void settle() {  // a round in which nothing comes in may still have put an answer into LCM's queue
    for (int idle = 0; idle < 2;) idle = server_.serve(0ms) ? 0 : idle + 1;
  }

  TestOperator ann_{1}, eve_{2};
  RobotDescription robot_;
  RuntimeExchange exchange_;
  std::int64_t drawn_ = 77;
  OperatorServer server_{"memq://",
                         robot_,
                         exchange_,
                         CommandGate({ann_.authorized(Role::kOperate, "ann"), eve_.authorized(Role::kWatch, "eve")},
                                     [this] { return drawn_++; }),
                         Identity(),
                         false};
  std::vector<MessageBytes> answers_;
};

TEST_F(OperatorServerTest, AnAnswerNamesTheMessageThatItAnswers) {
  const MessageBytes asks = command_bytes(command_t::STATUS, 5);
  send(Channel::kCommand, asks);
  ASSERT_EQ(answers_.size(), 1U);
  crux_msgs::answer_t answer{};
  ASSERT_TRUE(crux_msgs::decode_lcm(answers_[0], answer));
  EXPECT_TRUE(std::ranges::equal(answer.request, digest_of(asks)));
  EXPECT_EQ(answer.acknowledgement.request_id, 5);
  ASSERT_EQ(answer.n_status, 1);
  EXPECT_EQ(answer.status[0].session, 77);
}

TEST_F(OperatorServerTest, StatusLeadsWithTheFaultThatStandsWhateverIsToldAfterIt) {
  const FaultEvent leading{FaultCode::kAllNodesSilent, -1, 0, 11.0, 10.0},
      later{FaultCode::kNodeSilent, 2, 5, 12.0, 10.0};
  const auto tell = [this](const FaultEvent& event) {
    crux_msgs::fault_t fault{};
    fault.code = static_cast<std::int16_t>(event.code);
    fault.limb = static_cast<std::int8_t>(event.limb);
    fault.node = static_cast<std::int8_t>(event.node);
    *exchange_.faults.back() = fault;
    exchange_.faults.push();
  };
  const auto status = [this] {
    answers_.clear();
    send(Channel::kCommand, command_bytes(command_t::STATUS, 5));
    crux_msgs::answer_t answer{};
    EXPECT_TRUE(answers_.size() == 1 && crux_msgs::decode_lcm(answers_[0], answer) && answer.n_status == 1);
    return answer.status.empty() ? crux_msgs::status_t{} : answer.status[0];
  };
  exchange_.fault_code = static_cast<std::int16_t>(leading.code);
  tell(leading);
  tell(later);
  Standing& standing = exchange_.standing.slot();
  standing.faults = FaultList(leading);
  standing.faults.add(later);
  exchange_.standing.publish();
  crux_msgs::status_t told = status();
  EXPECT_EQ(told.fault.code, static_cast<int>(leading.code));
  ASSERT_EQ(told.n_beside, 1);
  EXPECT_EQ(told.beside[0].code, static_cast<int>(later.code));

  exchange_.fault_code = 0;
  exchange_.standing.slot() = {};
  exchange_.standing.publish();
  told = status();
  EXPECT_EQ(told.fault.code, 0);
  EXPECT_EQ(told.n_beside, 0);

  exchange_.log_broken = true;
  tell({FaultCode::kLogEnded, -1, 0, 7.0, 0.0});
  EXPECT_EQ(status().fault.code, static_cast<int>(FaultCode::kLogEnded));
  exchange_.log_broken = false;
  EXPECT_EQ(status().fault.code, 0);
}

TEST_F(OperatorServerTest, OneHoldIsOnItsWayHoweverManyAreSentAndAllAreAnswered) {
  std::vector<MessageBytes> sent;
  for (std::int64_t i = 0; i < 20; ++i) {
    sent.push_back((i % 2 == 0 ? ann_ : eve_).sign(0, 0, 0, command_bytes(command_t::HOLD, i)));
    for (int again = 0; again < 10; ++again) send(Channel::kSigned, sent.back());
  }
  Request* request = exchange_.requests.front();
  ASSERT_NE(request, nullptr);
  EXPECT_EQ(request->command, command_t::HOLD);
  const std::uint32_t ticket = request->ticket;
  exchange_.requests.pop();
  EXPECT_EQ(exchange_.requests.front(), nullptr);
  Answer* slot = exchange_.answers.back();
  *slot = Answer{};
  slot->ticket = ticket;
  exchange_.answers.push();
  settle();
  ASSERT_EQ(answers_.size(), sent.size());
  for (std::size_t i = 0; i < sent.size(); ++i) {
    crux_msgs::answer_t answer{};
    ASSERT_TRUE(crux_msgs::decode_lcm(answers_[i], answer));
    EXPECT_TRUE(std::ranges::equal(answer.request, digest_of(sent[i])));
    EXPECT_EQ(answer.acknowledgement.request_id, static_cast<std::int64_t>(i));
    EXPECT_EQ(answer.acknowledgement.verdict, acknowledgement_t::ACCEPTED);
  }
}

MessageBytes damaged(MessageBytes bytes, std::mt19937& random) {
  for (auto n = random() % 4; n > 0 && !bytes.empty(); --n)
    bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
  if (random() % 4 == 0) bytes.resize(random() % (bytes.size() + 1));
  if (random() % 8 == 0) bytes.insert(bytes.end(), random() % 100, static_cast<std::uint8_t>(random()));
  return bytes;
}

TEST_F(OperatorServerTest, LivesOnWhateverComesAndHoldComesThrough) {
  const char* wanted = std::getenv("CRUX_FUZZ_PACKETS");
  const long long packets = wanted != nullptr ? std::atoll(wanted) : 3000;
  std::mt19937 random(20260102);
  const std::vector<std::pair<Channel, MessageBytes>> sound = {
      {Channel::kCommand, command_bytes(command_t::START)},
      {Channel::kPlanPiece, piece_bytes()},
      {Channel::kSigned, ann_.sign(77, 1, 0, {})},
      {Channel::kSigned, ann_.sign(77, 2, 78, piece_bytes())},
      {Channel::kSigned, ann_.sign(77, 3, 78, command_bytes(command_t::SPEED))}};
  for (long long i = 0; i < packets; ++i) {
    const auto& [channel, bytes] = sound[random() % sound.size()];
    send(channel, damaged(bytes, random));
    while (exchange_.requests.front() != nullptr) exchange_.requests.pop();
    answers_.clear();
  }
  send(Channel::kSigned, eve_.sign(0, 0, 0, command_bytes(command_t::HOLD)));
  ASSERT_NE(exchange_.requests.front(), nullptr);
  EXPECT_EQ(exchange_.requests.front()->command, command_t::HOLD);
}

}  // namespace
}  // namespace crux
