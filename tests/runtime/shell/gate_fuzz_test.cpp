// Packets of an attacker who hears everything and alters, repeats, delays and makes up what he likes, between those of
// two operators and a watcher. CRUX_FUZZ_PACKETS: how many; the same ones in every run.
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <random>
#include <string>

#include "lcm/command_gate.hpp"
#include "signed_messages.hpp"

namespace crux {
namespace {

using crux_msgs::command_t;
using Kind = Opened::Kind;
using namespace std::chrono_literals;

constexpr std::int64_t kSession = 0x1122334455667788;
constexpr int kMessages = 200, kRound = 2000;

struct Signed {
  MessageBytes bytes;
  int from;  // ann, bob, eve
  std::int64_t session, counter, lease;
  bool holds;
};

/// What the three have signed for one run of the runtime, and some for another one; in the order of their counters.
std::vector<Signed> all_signed(const std::vector<TestOperator>& people, std::mt19937& random) {
  std::vector<Signed> all;
  for (int i = 0; i < kMessages; ++i) {
    const int from = static_cast<int>(random() % 8 < 5 ? 0 : random() % 3), what = static_cast<int>(random() % 8);
    const std::int64_t lease = kSession + 1 + i / 50, session = random() % 16 == 0 ? kSession - 1 : kSession;
    MessageBytes data;
    if (what >= 2) data = command_bytes(what == 2 ? command_t::HOLD : command_t::START, i);
    if (what == 7) data = piece_bytes();
    all.push_back({people[static_cast<std::size_t>(from)].sign(session, i + 1, lease, data), from, session, i + 1,
                   lease, what == 2});
  }
  return all;
}

MessageBytes altered(MessageBytes bytes, const MessageBytes& other, std::mt19937& random) {
  const auto at = [&random](std::size_t size) { return static_cast<std::ptrdiff_t>(random() % (size + 1)); };
  switch (random() % 6) {
    case 0:
      for (auto n = random() % 4 + 1; n > 0 && !bytes.empty(); --n)
        bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1U << (random() % 8));
      return bytes;
    case 1:
      for (auto n = random() % 8 + 1; n > 0 && !bytes.empty(); --n)
        bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
      return bytes;
    case 2:
      bytes.resize(random() % (bytes.size() + 1));
      return bytes;
    case 3:
      bytes.insert(bytes.begin() + at(bytes.size()), random() % 100, static_cast<std::uint8_t>(random()));
      return bytes;
    case 4: {  // the head of one, the tail of the other
      const std::ptrdiff_t cut = at(std::min(bytes.size(), other.size()));
      std::copy(other.begin(), other.begin() + cut, bytes.begin());
      return bytes;
    }
    default:
      bytes.assign(random() % 300, 0);
      for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
      return bytes;
  }
}

TEST(GateFuzz, NothingIsLetThroughButWhatAnOperatorHasSignedAnewUnderHisLease) {
  const char* wanted = std::getenv("CRUX_FUZZ_PACKETS");
  const long long packets = wanted != nullptr ? std::atoll(wanted) : 100'000;
  std::mt19937 random(20260101);
  const std::vector<TestOperator> people = {TestOperator(1), TestOperator(2), TestOperator(3)};
  const std::vector<AuthorizedKey> keys = {people[0].authorized(Role::kOperate, "ann"),
                                           people[1].authorized(Role::kOperate, "bob"),
                                           people[2].authorized(Role::kWatch, "eve")};
  const std::vector<Signed> all = all_signed(people, random);
  std::map<MessageBytes, const Signed*> known;
  for (const Signed& each : all) known.emplace(each.bytes, &each);

  long long let_through = 0, leases = 0, understood = 0;
  for (long long done = 0; done < packets;) {
    std::int64_t drawn = kSession;
    CommandGate gate(keys, [&drawn] { return drawn++; });
    CommandGate::Time now{1000s}, renewed{};
    std::int64_t last[3] = {0, 0, 0}, lease = 0;
    int holder = -1;
    std::size_t next = 0;  // of what they send themselves
    for (int i = 0; i < kRound && done < packets; ++i, ++done) {
      now += std::chrono::milliseconds(random() % 64 == 0 ? random() % 12'000 : random() % 50);
      const bool sent = random() % 10 == 0 && next < all.size();
      const Signed& one = sent ? all[next++] : all[random() % std::min(all.size(), next + 20)];
      const bool whole = sent || random() % 4 == 0;
      const MessageBytes bytes = whole ? one.bytes : altered(one.bytes, all[random() % all.size()].bytes, random);
      const Opened opened = gate.open(bytes, now);
      understood += opened.kind == Kind::kNothing ? 0 : 1;
      if (opened.kind == Kind::kNothing || opened.denial) continue;
      ++let_through;
      const auto found = known.find(bytes);
      ASSERT_NE(found, known.end()) << "packet " << done << " was signed by nobody";
      const Signed& origin = *found->second;
      if (origin.holds) continue;  // everybody's, at any time
      ASSERT_NE(origin.from, 2) << "packet " << done << " is a watcher's";
      ASSERT_EQ(origin.session, kSession) << "packet " << done << " is of another session";
      ASSERT_GT(origin.counter, last[origin.from]) << "packet " << done << " is a replay";
      last[origin.from] = origin.counter;
      const bool runs = holder >= 0 && now - renewed < CommandGate::kLease;
      if (opened.kind == Kind::kLease) {
        ASSERT_TRUE(!runs || holder == origin.from) << "packet " << done << " takes another one's lease";
        lease = gate.lease(now);
        holder = origin.from;
        ++leases;
      } else {
        ASSERT_TRUE(runs && holder == origin.from && origin.lease == lease) << "packet " << done << " has no lease";
      }
      renewed = now;
    }
  }
  std::printf("fuzzed %lld packets, %lld understood, %lld let through, %lld leases\n", packets, understood, let_through,
              leases);
  EXPECT_GT(understood, packets / 4);
  EXPECT_GT(let_through, packets / 200);
  EXPECT_GT(leases, packets / 2000);
  EXPECT_GT(let_through - leases, packets / 1000);
}

}  // namespace
}  // namespace crux
