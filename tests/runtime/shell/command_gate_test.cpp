#include "lcm/command_gate.hpp"

#include <gtest/gtest.h>

#include <set>

#include "signed_messages.hpp"

namespace crux {
namespace {

using crux_msgs::command_t;
using Kind = Opened::Kind;
using namespace std::chrono_literals;

constexpr std::int64_t kSession = 77, kFirstLease = 78;  // of the numbers drawn

class CommandGateTest : public testing::Test {
 protected:
  Opened say(const TestOperator& from, const MessageBytes& data, std::int64_t lease = kFirstLease) {
    return gate_.open(from.sign(gate_.session(), ++counter_, lease, data), now_);
  }
  Opened take_lease(const TestOperator& from) { return say(from, {}, 0); }
  static void expect_refused(const Opened& opened, const std::string& words, bool stale = false) {
    EXPECT_NE(opened.denial.reason.find(words), std::string::npos) << opened.denial.reason;
    EXPECT_EQ(opened.denial.stale, stale) << opened.denial.reason;
  }

  TestOperator ann_{1}, bob_{2}, eve_{3}, unknown_{4};
  std::int64_t drawn_ = kSession, counter_ = 0;
  CommandGate gate_{{ann_.authorized(Role::kOperate, "ann"), bob_.authorized(Role::kOperate, "bob"),
                     eve_.authorized(Role::kWatch, "eve")},
                    [this] { return drawn_++; }};
  CommandGate::Time now_{1000s};
  const MessageBytes start_ = command_bytes(command_t::START, 5);
};

TEST_F(CommandGateTest, WhoHasTheLeaseCommands) {
  const Opened lease = take_lease(ann_);
  EXPECT_EQ(lease.kind, Kind::kLease);
  EXPECT_EQ(lease.denial.reason, "");
  EXPECT_EQ(lease.new_holder, "ann");
  EXPECT_EQ(gate_.lease(now_), kFirstLease);
  EXPECT_EQ(gate_.holder(now_), "ann");
  const Opened start = say(ann_, start_);
  EXPECT_EQ(start.denial.reason, "");
  EXPECT_EQ(start.kind, Kind::kCommand);
  EXPECT_EQ(start.command.command, command_t::START);
  EXPECT_EQ(start.command.request_id, 5);
  EXPECT_EQ(start.bytes, start_);
  const Opened piece = say(ann_, piece_bytes());
  EXPECT_EQ(piece.denial.reason, "");
  EXPECT_EQ(piece.kind, Kind::kPiece);
  EXPECT_EQ(piece.piece.plan_id, "plan");
}

TEST_F(CommandGateTest, OneOperatorAtATimeButHoldIsTakenFromEach) {
  take_lease(ann_);
  now_ += 4s;
  expect_refused(take_lease(bob_), "'ann' has the lease, for 6.0 s more");
  expect_refused(say(bob_, start_), "'ann' has the lease");
  EXPECT_EQ(say(bob_, command_bytes(command_t::HOLD), 0).denial.reason, "");
  EXPECT_EQ(gate_.holder(now_), "ann");
  now_ += 6s;
  EXPECT_EQ(gate_.holder(now_), "");
  EXPECT_EQ(gate_.lease(now_), 0);
  EXPECT_EQ(take_lease(bob_).new_holder, "bob");
  EXPECT_EQ(gate_.lease(now_), kFirstLease + 1);
}

TEST_F(CommandGateTest, ALeaseLastsAsLongAsItIsRenewed) {
  take_lease(ann_);
  for (int i = 0; i < 5; ++i) {
    now_ += 9s;
    EXPECT_EQ(i % 2 == 0 ? take_lease(ann_).denial.reason : say(ann_, start_).denial.reason, "");
    EXPECT_EQ(gate_.lease(now_), kFirstLease);
  }
  now_ += 10s;
  expect_refused(say(ann_, start_), "lease it was signed under has ended", true);
  EXPECT_EQ(take_lease(ann_).new_holder, "ann");
  // What was signed under the old lease and held back on the way is of no use any more.
  expect_refused(say(ann_, start_, kFirstLease), "lease it was signed under has ended", true);
  EXPECT_EQ(say(ann_, start_, kFirstLease + 1).denial.reason, "");
}

TEST_F(CommandGateTest, ReplayedOvertakenAndFromAnotherSession) {
  take_lease(ann_);
  const MessageBytes early = ann_.sign(kSession, 5, kFirstLease, start_);
  const MessageBytes late = ann_.sign(kSession, 6, kFirstLease, start_);
  EXPECT_EQ(gate_.open(late, now_).denial.reason, "");
  expect_refused(gate_.open(late, now_), "replayed", true);
  expect_refused(gate_.open(early, now_), "replayed", true);
  expect_refused(gate_.open(ann_.sign(kSession + 1, 8, kFirstLease, start_), now_), "another session", true);
  // Each key counts for itself.
  now_ += 10s;
  EXPECT_EQ(gate_.open(bob_.sign(kSession, 1, 0, {}), now_).denial.reason, "");
}

TEST_F(CommandGateTest, HoldIsTakenFromEveryKeyInOnePacketThatKnowsNothing) {
  take_lease(ann_);
  say(ann_, start_);
  for (const TestOperator* each : {&ann_, &bob_, &eve_}) {
    const MessageBytes hold = each->sign(0, 0, 0, command_bytes(command_t::HOLD));
    for (int sent = 0; sent < 3; ++sent) {  // replayed, it holds the robot again
      const Opened opened = gate_.open(hold, now_);
      EXPECT_EQ(opened.denial.reason, "");
      EXPECT_EQ(opened.command.command, command_t::HOLD);
    }
  }
  // It uses up nobody's counter, nor does it take or renew the lease.
  EXPECT_EQ(say(ann_, start_).denial.reason, "");
  now_ += 9s;
  gate_.open(ann_.sign(0, 0, 0, command_bytes(command_t::HOLD)), now_);
  now_ += 1s;
  EXPECT_EQ(gate_.holder(now_), "");
  expect_refused(gate_.open(unknown_.sign(0, 0, 0, command_bytes(command_t::HOLD)), now_), "not among the keys");
}

TEST_F(CommandGateTest, AHoldThatIsScheduledIsACommandAsOthers) {
  take_lease(ann_);
  command_t later{};
  later.command = command_t::HOLD;
  later.at_cycle = 1000;
  const MessageBytes hold = ann_.sign(kSession, 50, kFirstLease, lcm_bytes(later));
  EXPECT_EQ(gate_.open(hold, now_).denial.reason, "");
  expect_refused(gate_.open(hold, now_), "replayed", true);
  expect_refused(gate_.open(bob_.sign(kSession, 51, kFirstLease, lcm_bytes(later)), now_), "'ann' has the lease");
}

TEST_F(CommandGateTest, AlteredOrSignedByOthers) {
  take_lease(ann_);
  const MessageBytes good = ann_.sign(kSession, 9, kFirstLease, start_);
  for (std::size_t bit = 0; bit < 8 * good.size(); ++bit) {
    MessageBytes altered = good;
    altered[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    const Opened opened = gate_.open(altered, now_);
    EXPECT_TRUE(opened.kind == Kind::kNothing || opened.denial) << "bit " << bit;
  }
  expect_refused(gate_.open(unknown_.sign(kSession, 9, kFirstLease, start_), now_), "not among the keys");
  // An unknown key signs, and ann's is named.
  MessageBytes forged = unknown_.sign(kSession, 9, kFirstLease, start_);
  std::ranges::copy(ann_.signer.key, forged.begin() + 8 + 3 * 8);
  expect_refused(gate_.open(forged, now_), "signature is wrong");
  // None of all these has used ann's counter up.
  EXPECT_EQ(gate_.open(good, now_).denial.reason, "");
}

TEST_F(CommandGateTest, WatchingIsNotOperating) {
  expect_refused(take_lease(eve_), "'eve' may watch");
  expect_refused(say(eve_, start_), "'eve' may watch");
}

TEST_F(CommandGateTest, BytesThatAreNoMessage) {
  EXPECT_EQ(gate_.open({}, now_).kind, Kind::kNothing);
  EXPECT_EQ(say(ann_, {1, 2, 3}).kind, Kind::kNothing);
  EXPECT_EQ(gate_.open(start_, now_).kind, Kind::kNothing);  // not in an envelope
}

TEST_F(CommandGateTest, WithoutKeysEverythingIsLetThrough) {
  CommandGate open({}, [] { return kSession; });
  EXPECT_TRUE(open.insecure());
  EXPECT_FALSE(gate_.insecure());
  EXPECT_EQ(open.open(unknown_.sign(1, 1, 1, start_), now_).denial.reason, "");
}

TEST(Unpredictable, IsAnotherNumberEachTime) {
  std::set<std::int64_t> drawn;
  for (int i = 0; i < 100; ++i) drawn.insert(unpredictable());
  EXPECT_EQ(drawn.size(), 100U);
}

}  // namespace
}  // namespace crux
