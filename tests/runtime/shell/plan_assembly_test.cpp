#include "lcm/plan_assembly.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>

#include "core/robot/hash.hpp"
#include "crux_msgs/cdr.hpp"
#include "crux_msgs/plan_t.hpp"

namespace crux {
namespace {

using crux_msgs::plan_piece_t;
using crux_msgs::plan_t;

std::vector<std::uint8_t> random_bytes(std::size_t n, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::uint8_t> bytes(n);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

std::string sha256(const std::vector<std::uint8_t>& bytes) {
  return sha256_hex({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

std::vector<plan_piece_t> cut(const std::vector<std::uint8_t>& bytes, std::size_t size, std::int64_t transfer_id = 1) {
  std::vector<plan_piece_t> pieces;
  for (std::size_t at = 0; at < bytes.size(); at += size) {
    plan_piece_t piece{};
    piece.transfer_id = transfer_id;
    piece.plan_id = "plan";
    piece.bytes_sha256 = sha256(bytes);
    piece.total_bytes = static_cast<std::int32_t>(bytes.size());
    piece.n_pieces = static_cast<std::int32_t>((bytes.size() + size - 1) / size);
    piece.piece = static_cast<std::int32_t>(at / size);
    piece.data.assign(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                      bytes.begin() + static_cast<std::ptrdiff_t>(std::min(at + size, bytes.size())));
    piece.n_bytes = static_cast<std::int32_t>(piece.data.size());
    pieces.push_back(piece);
  }
  return pieces;
}

TEST(PlanAssembly, AnyOrderAnyNumberOfTimes) {
  const auto bytes = random_bytes(12345, 1);
  std::mt19937 random(2);
  for (int round = 0; round < 50; ++round) {
    auto pieces = cut(bytes, 1000);
    const auto once = pieces;
    for (int i = 0; i < 5; ++i) pieces.push_back(once[random() % once.size()]);
    std::shuffle(pieces.begin(), pieces.end(), random);
    PlanAssembly assembly;
    for (const auto& piece : pieces) EXPECT_EQ(assembly.take(piece), "");
    ASSERT_TRUE(assembly.complete());
    EXPECT_EQ(assembly.bytes(), bytes);
  }
}

TEST(PlanAssembly, AnotherTransferEndsTheOneBefore) {
  const auto one = random_bytes(5000, 1), two = random_bytes(3000, 2);
  PlanAssembly assembly;
  assembly.take(cut(one, 1000, 1)[0]);
  for (const auto& piece : cut(two, 1000, 2)) assembly.take(piece);
  ASSERT_TRUE(assembly.complete());
  EXPECT_EQ(assembly.bytes(), two);
  assembly.take(cut(one, 1000, 1)[1]);
  EXPECT_FALSE(assembly.complete());
}

TEST(PlanAssembly, ADamagedPieceIsMendedBySendingItAgain) {
  const auto bytes = random_bytes(3000, 3);
  const auto pieces = cut(bytes, 1000);
  PlanAssembly assembly;
  for (auto piece : pieces) {
    piece.data[17] ^= 1;
    EXPECT_EQ(assembly.take(piece), "");
  }
  EXPECT_NE(sha256(assembly.bytes()), assembly.bytes_sha256());
  for (const auto& piece : pieces) EXPECT_EQ(assembly.take(piece), "");
  EXPECT_EQ(sha256(assembly.bytes()), assembly.bytes_sha256());
}

TEST(PlanAssembly, HostileSizesAreRefused) {
  const auto good = cut(random_bytes(3000, 4), 1000)[0];
  const auto refused = [&good](auto change) {
    plan_piece_t piece = good;
    change(piece);
    PlanAssembly assembly;
    return !assembly.take(piece).empty() && !assembly.complete();
  };
  constexpr std::int32_t kHuge = std::numeric_limits<std::int32_t>::max();
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.total_bytes = kHuge; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.total_bytes = -1; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.total_bytes = 0; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.n_pieces = kHuge; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.n_pieces = 0; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.n_pieces = -3; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.piece = 3; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.piece = -1; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) {
    p.data.clear();
    p.n_bytes = 0;
  }));
  EXPECT_TRUE(refused([](plan_piece_t& p) { p.bytes_sha256 = "abc"; }));
  EXPECT_TRUE(refused([](plan_piece_t& p) {  // more than the whole
    p.data.resize(3001);
    p.n_bytes = 3001;
  }));
  EXPECT_TRUE(refused([](plan_piece_t& p) {  // leaves nothing for the other two
    p.data.resize(2999);
    p.n_bytes = 2999;
  }));
  EXPECT_TRUE(refused([](plan_piece_t& p) {
    p.total_bytes = PlanAssembly::kMaxPlanBytes;
    p.data.resize(plan_piece_t::MAX_BYTES + 1);
    p.n_bytes = plan_piece_t::MAX_BYTES + 1;
  }));
}

TEST(PlanAssembly, FuzzedPiecesNeverMakeItGrowOrLie) {
  std::mt19937 random(5);
  const auto bytes = random_bytes(4000, 6);
  PlanAssembly assembly;
  for (int i = 0; i < 20000; ++i) {
    plan_piece_t piece = cut(bytes, 500)[random() % 8];
    switch (random() % 8) {
      case 0:
        piece.total_bytes = static_cast<std::int32_t>(random());
        break;
      case 1:
        piece.n_pieces = static_cast<std::int32_t>(random() % 12);
        break;
      case 2:
        piece.piece = static_cast<std::int32_t>(random() % 12) - 2;
        break;
      case 3:
        piece.data.resize(random() % 900);
        piece.n_bytes = static_cast<std::int32_t>(piece.data.size());
        break;
      case 4:
        piece.transfer_id = random() % 3;
        break;
      default:
        break;
    }
    assembly.take(piece);
    if (!assembly.complete()) continue;
    EXPECT_LE(assembly.bytes().size(), static_cast<std::size_t>(PlanAssembly::kMaxPlanBytes));
  }
  assembly.clear();
  for (const auto& piece : cut(bytes, 500)) assembly.take(piece);
  EXPECT_EQ(assembly.bytes(), bytes);
}

plan_t small_plan() {
  plan_t plan{};
  plan.format = plan_t::FORMAT;
  plan.plan_id = std::string(64, 'a');
  plan.scenario_name = "fuzz";
  plan.n_holds = 2;
  plan.holds.resize(2);
  plan.holds[1].name = "b";
  plan.n_knots = 3;
  plan.knots.resize(3);
  plan.knots[2].time_s = 4.0;
  return plan;
}

std::vector<std::uint8_t> lcm_bytes(const plan_t& plan) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(plan.getEncodedSize()));
  EXPECT_EQ(plan.encode(bytes.data(), 0, static_cast<int>(bytes.size())), static_cast<int>(bytes.size()));
  return bytes;
}

TEST(LcmDecoding, ReadsWhatLcmWrites) {
  const auto bytes = lcm_bytes(small_plan());
  plan_t plan{};
  ASSERT_TRUE(crux_msgs::decode_lcm(bytes, plan));
  EXPECT_EQ(lcm_bytes(plan), bytes);
}

TEST(LcmDecoding, StandsTruncationsAndBitFlips) {
  const auto whole = lcm_bytes(small_plan());
  for (std::size_t n = 0; n < whole.size(); ++n) {
    plan_t plan{};
    EXPECT_FALSE(crux_msgs::decode_lcm(
        std::vector<std::uint8_t>(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(n)), plan));
  }
  std::mt19937 random(8);
  for (int i = 0; i < 20000; ++i) {
    auto bytes = whole;
    for (unsigned flips = random() % 3 + 1; flips > 0; --flips)
      bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
    plan_t plan{};
    if (!crux_msgs::decode_lcm(bytes, plan)) continue;
    EXPECT_EQ(plan.knots.size(), static_cast<std::size_t>(plan.n_knots));
    EXPECT_LE(plan.knots.size() + plan.holds.size(), whole.size());
  }
}

TEST(LcmDecoding, RefusesLengthsThatTheBytesCannotHold) {
  for (const std::int32_t n :
       {-1, 3, 1000000, std::numeric_limits<std::int32_t>::max(), std::numeric_limits<std::int32_t>::min()}) {
    auto bytes = lcm_bytes(small_plan());
    const std::size_t knot_bytes = 3 * (13 * 8 + 4 * (4 + 20 * 8));
    const std::size_t at = bytes.size() - knot_bytes - 4;  // n_knots
    ASSERT_EQ(bytes[at + 3], 3);
    if (n == 3) bytes.push_back(0);
    for (std::size_t i = 0; i < 4; ++i)
      bytes[at + i] = static_cast<std::uint8_t>(static_cast<std::uint32_t>(n) >> (24 - 8 * i));
    plan_t plan{};
    EXPECT_FALSE(crux_msgs::decode_lcm(bytes, plan)) << n;
  }
}

}  // namespace
}  // namespace crux
