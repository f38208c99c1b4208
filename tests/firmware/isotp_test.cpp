// ISO 15765-2 frame by frame: what the standard says of lengths, numbers, flow control and time-outs.
#include <gtest/gtest.h>

#include <numeric>
#include <vector>

extern "C" {
#include "isotp.h"
}

namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes counting(std::size_t length) {
  Bytes bytes(length);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{1});
  return bytes;
}

struct Node {
  crux_isotp isotp{};
  Node() { crux_isotp_init(&isotp, 0x601, 0x581); }
  void hear(const Bytes& bytes, std::uint16_t id = 0x601) {
    crux_frame frame{};
    frame.id = id;
    frame.length = static_cast<std::uint8_t>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), frame.data);
    crux_isotp_on_frame(&isotp, &frame);
  }
  // The next frame that is due, empty when none is.
  Bytes say() {
    crux_frame frame{};
    if (!crux_isotp_take_frame(&isotp, &frame)) return {};
    EXPECT_EQ(frame.id, 0x581);
    return {frame.data, frame.data + frame.length};
  }
  Bytes message() {
    std::uint16_t length = 0;
    const std::uint8_t* bytes = crux_isotp_message(&isotp, &length);
    return bytes == nullptr ? Bytes{} : Bytes(bytes, bytes + length);
  }
  bool send(const Bytes& bytes) {
    return crux_isotp_send(&isotp, bytes.data(), static_cast<std::uint16_t>(bytes.size()));
  }
  void wait(std::uint32_t us) { crux_isotp_tick(&isotp, us); }
};

Bytes first(unsigned length, std::size_t frame = 64) {
  Bytes bytes = {static_cast<std::uint8_t>(0x10 | length >> 8), static_cast<std::uint8_t>(length)};
  const Bytes content = counting(frame - 2);
  bytes.insert(bytes.end(), content.begin(), content.end());
  return bytes;
}

Bytes consecutive(unsigned number, std::size_t size, std::uint8_t from) {
  Bytes bytes(size + 1);
  bytes[0] = static_cast<std::uint8_t>(0x20 | number);
  std::iota(bytes.begin() + 1, bytes.end(), from);
  return bytes;
}

TEST(IsoTp, ShortMessagesGoInOneFrame) {
  for (const std::size_t length : {1U, 7U}) {
    Node node;
    ASSERT_TRUE(node.send(counting(length)));
    const Bytes frame = node.say();
    EXPECT_EQ(frame.size(), length + 1);
    EXPECT_EQ(frame[0], length);
    EXPECT_FALSE(crux_isotp_is_sending(&node.isotp));
  }
}

TEST(IsoTp, LongerOnesUseTheEscapeAndArePaddedToALengthOfCanFd) {
  for (const auto& [length, size] : {std::pair{8U, 12U}, {10U, 12U}, {11U, 16U}, {46U, 48U}, {47U, 64U}, {62U, 64U}}) {
    Node node;
    ASSERT_TRUE(node.send(counting(length)));
    const Bytes frame = node.say();
    ASSERT_EQ(frame.size(), size);
    EXPECT_EQ(frame[0], 0);
    EXPECT_EQ(frame[1], length);
    EXPECT_EQ(Bytes(frame.begin() + 2, frame.begin() + 2 + length), counting(length));
    for (std::size_t i = length + 2; i < size; ++i) EXPECT_EQ(frame[i], 0xCC);
  }
}

TEST(IsoTp, SegmentsWaitForFlowControlAndKeepBlockAndSeparation) {
  Node node;
  ASSERT_TRUE(node.send(counting(256)));
  EXPECT_EQ(node.say()[0], 0x11);
  EXPECT_TRUE(node.say().empty());
  node.hear({0x30, 2, 3});
  EXPECT_EQ(node.say()[0], 0x21);
  EXPECT_TRUE(node.say().empty());
  node.wait(2999);
  EXPECT_TRUE(node.say().empty());
  node.wait(1);
  EXPECT_EQ(node.say()[0], 0x22);
  node.wait(1000000 - 1);
  EXPECT_TRUE(node.say().empty());  // the block is over
  node.hear({0x30, 0, 0xF1});
  EXPECT_EQ(node.say()[0], 0x23);
  node.wait(99);
  EXPECT_TRUE(node.say().empty());
  node.wait(1);
  const Bytes last = node.say();
  EXPECT_EQ(last[0], 0x24);
  EXPECT_EQ(last.size(), 1U + (256 - 62 - 3 * 63));
  EXPECT_FALSE(crux_isotp_is_sending(&node.isotp));
}

TEST(IsoTp, ASenderGivesUpWithoutFlowControlOnOverflowAndAfterManyWaits) {
  const auto begun = [] {
    Node node;
    node.send(counting(100));
    node.say();
    return node;
  };
  Node silent = begun();
  silent.wait(999999);
  EXPECT_TRUE(crux_isotp_is_sending(&silent.isotp));
  silent.wait(1);
  EXPECT_FALSE(crux_isotp_is_sending(&silent.isotp));
  Node refused = begun();
  refused.hear({0x32, 0, 0});
  EXPECT_FALSE(crux_isotp_is_sending(&refused.isotp));
  Node patient = begun();
  for (int i = 0; i < 10; ++i) {
    patient.wait(900000);
    patient.hear({0x31, 0, 0});
  }
  EXPECT_TRUE(crux_isotp_is_sending(&patient.isotp));
  patient.hear({0x31, 0, 0});
  EXPECT_FALSE(crux_isotp_is_sending(&patient.isotp));
}

TEST(IsoTp, TheLongestMessageComesInWholeAndOneByteMoreIsRefused) {
  Node node;
  node.hear(first(1024));
  EXPECT_EQ(node.say(), (Bytes{0x30, 0, CRUX_ISOTP_SEPARATION_MS}));
  unsigned number = 1;
  std::size_t done = 62;
  while (done < 1024) {
    const std::size_t size = std::min<std::size_t>(63, 1024 - done);
    node.hear(consecutive(number, size, static_cast<std::uint8_t>(done + 1)));
    number = (number + 1) % 16;
    done += size;
  }
  EXPECT_EQ(node.message(), counting(1024));
  crux_isotp_done(&node.isotp);
  node.hear(first(1025));
  EXPECT_EQ(node.say()[0], 0x32);
  node.hear({0x10, 0, 0xFF, 0xFF, 0xFF, 0xFF, 1, 2});  // 4 GiB, by the escape
  EXPECT_EQ(node.say()[0], 0x32);
  EXPECT_TRUE(node.message().empty());
}

TEST(IsoTp, AMessageIsGivenUpAfterAWrongNumberOrSilence) {
  Node wrong;
  wrong.hear(first(100));
  wrong.hear(consecutive(2, 38, 0));
  wrong.hear(consecutive(1, 38, 0));
  EXPECT_TRUE(wrong.message().empty());
  Node silent;
  silent.hear(first(100));
  silent.wait(1000000);
  silent.hear(consecutive(1, 38, 0));
  EXPECT_TRUE(silent.message().empty());
  Node cut;  // a frame shorter than the first one, not the last
  cut.hear(first(200));
  cut.hear(consecutive(1, 20, 0));
  cut.hear(consecutive(2, 63, 0));
  EXPECT_TRUE(cut.message().empty());
}

TEST(IsoTp, ANewMessageTakesThePlaceOfAnUnfinishedOne) {
  Node node;
  node.hear(first(100));
  node.hear({3, 7, 8, 9});
  EXPECT_EQ(node.message(), (Bytes{7, 8, 9}));
}

TEST(IsoTp, WhatBreaksTheStandardIsIgnored) {
  const std::vector<Bytes> wrong = {{},
                                    {0x01},
                                    {0x00, 0x00},                               // no bytes
                                    {0x05, 1, 2},                               // more than there are
                                    {0x03, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11},  // no escape in a long frame
                                    {0x00, 12, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11},
                                    {0x10, 5, 1, 2, 3, 4, 5, 6},  // would fit into a single frame
                                    {0x10, 9, 1, 2},              // first frame too short
                                    {0x40, 1, 2, 3, 4, 5, 6, 7},  // unknown kind
                                    {0x30, 0}};
  for (const Bytes& bytes : wrong) {
    Node node;
    node.hear(bytes);
    EXPECT_TRUE(node.message().empty());
    EXPECT_TRUE(node.say().empty());
  }
  Node node;
  node.hear({2, 1, 2}, 0x602);
  EXPECT_TRUE(node.message().empty());
}

TEST(IsoTp, NothingIsHeardOverAMessageThatWaits) {
  Node node;
  node.hear({1, 5});
  node.hear({1, 6});
  EXPECT_EQ(node.message(), Bytes{5});
  EXPECT_FALSE(node.send(counting(257)));
  EXPECT_FALSE(node.send({}));
  EXPECT_TRUE(node.send({1}));
  EXPECT_FALSE(node.send({2}));
}

}  // namespace
