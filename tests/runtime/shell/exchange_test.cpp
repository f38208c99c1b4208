#include <gtest/gtest.h>

#include <memory>
#include <thread>

#include "exchange/latest_value.hpp"
#include "exchange/spsc_ring.hpp"

namespace crux {
namespace {

TEST(SpscRing, IsFullAndEmptyWhereItShould) {
  SpscRing<int> ring(3);
  ASSERT_EQ(ring.capacity(), 4U);
  EXPECT_EQ(ring.front(), nullptr);
  for (int i = 0; i < 4; ++i) {
    ASSERT_NE(ring.back(), nullptr);
    *ring.back() = i;
    ring.push();
  }
  EXPECT_EQ(ring.back(), nullptr);
  EXPECT_EQ(*ring.front(), 0);
  ring.pop();
  EXPECT_NE(ring.back(), nullptr);
  EXPECT_EQ(*ring.front(), 1);
}

TEST(SpscRing, HandsEverythingOverInOrder) {
  constexpr int kCount = 200000;
  SpscRing<std::unique_ptr<int>> ring(64);
  std::thread producer([&ring] {
    for (int i = 0; i < kCount;) {
      auto* slot = ring.back();
      if (slot == nullptr) {
        std::this_thread::yield();
        continue;
      }
      *slot = std::make_unique<int>(i++);
      ring.push();
    }
  });
  int wrong = 0;
  for (int expected = 0; expected < kCount;) {
    auto* slot = ring.front();
    if (slot == nullptr) {
      std::this_thread::yield();
      continue;
    }
    const std::unique_ptr<int> value = std::move(*slot);
    ring.pop();
    wrong += *value != expected++ ? 1 : 0;
  }
  producer.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(ring.front(), nullptr);
}

struct Pair {
  long first = 0, second = 0;
};

TEST(LatestValue, IsWholeAndNeverOlderThanTheLastOne) {
  LatestValue<Pair> latest;
  EXPECT_EQ(latest.take(), nullptr);
  constexpr long kCount = 300000;
  std::thread writer([&latest] {
    for (long i = 1; i <= kCount; ++i) {
      latest.slot() = {i, -i};
      latest.publish();
    }
  });
  long last = 0, torn = 0, backwards = 0;
  while (last < kCount) {
    const Pair* value = latest.take();
    if (value == nullptr) continue;
    torn += value->first + value->second != 0 ? 1 : 0;
    backwards += value->first <= last ? 1 : 0;
    last = value->first;
  }
  writer.join();
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(backwards, 0);
  EXPECT_EQ(latest.take(), nullptr);
}

}  // namespace
}  // namespace crux
