#include "lcm/fair_queue.hpp"

#include <gtest/gtest.h>

namespace crux {
namespace {

using crux_msgs::Channel;
using Bytes = std::vector<std::uint8_t>;

TEST(FairQueue, ASenderWhoFloodsDelaysAnotherByOneMessage) {
  FairQueue queue;
  for (int i = 0; i < 100'000; ++i) queue.put(1, Channel::kSigned, Bytes(200, 1));
  queue.put(2, Channel::kSigned, Bytes(200, 2));
  EXPECT_EQ(queue.take()->bytes[0], 1);
  EXPECT_EQ(queue.take()->bytes[0], 2);
  EXPECT_EQ(queue.dropped(), 100'000 - FairQueue::kEach);
}

TEST(FairQueue, EachSendersMessagesStayInOrderAndNoneIsLost) {
  FairQueue queue;
  for (std::uint8_t i = 0; i < 30; ++i)
    for (std::uint64_t sender = 0; sender < 5; ++sender) queue.put(sender, Channel::kCommand, Bytes{i});
  for (std::uint8_t i = 0; i < 30; ++i)
    for (int sender = 0; sender < 5; ++sender) EXPECT_EQ(queue.take()->bytes, Bytes{i});
  EXPECT_FALSE(queue.take());
  EXPECT_EQ(queue.bytes(), 0U);
}

TEST(FairQueue, MemoryIsBoundedAndASmallMessageStillFindsItsPlace) {
  FairQueue queue;
  for (std::uint64_t sender = 0; sender < 100; ++sender)
    for (int i = 0; i < 40; ++i) queue.put(sender, Channel::kPlanPiece, Bytes(65'000));
  EXPECT_LE(queue.bytes(), FairQueue::kBytes);
  queue.put(9999, Channel::kSigned, Bytes(200));
  EXPECT_LE(queue.bytes(), FairQueue::kBytes + FairQueue::kSenders * FairQueue::kSmall);
  bool found = false;
  while (const auto next = queue.take()) found = found || next->bytes.size() == 200;
  EXPECT_TRUE(found);
}

}  // namespace
}  // namespace crux
