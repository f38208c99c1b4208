// The wire format of the mock bus: what comes back, and that no datagram can hurt.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

extern "C" {
#include "datagram.h"
}

namespace crux::firmware {
namespace {

TEST(Datagram, ComesBackAsItWas) {
  for (int length = 0; length <= 64; ++length) {
    crux_frame sent{};
    sent.id = static_cast<std::uint16_t>(0x7FF - length);
    sent.length = static_cast<std::uint8_t>(length);
    for (int i = 0; i < length; ++i) {
      sent.data[i] = static_cast<std::uint8_t>(7 * i + length);
    }
    std::uint8_t datagram[CRUX_DATAGRAM_CAPACITY];
    const std::size_t size = crux_datagram_encode(&sent, datagram);
    ASSERT_LE(size, CRUX_DATAGRAM_CAPACITY);
    crux_frame heard{};
    ASSERT_TRUE(crux_datagram_decode(datagram, size, &heard));
    EXPECT_EQ(heard.id, sent.id);
    ASSERT_EQ(heard.length, sent.length);
    EXPECT_TRUE(std::equal(sent.data, sent.data + length, heard.data));
  }
}

TEST(Datagram, CutShortItIsNoFrame) {
  crux_frame sent{};
  sent.length = 16;
  std::uint8_t datagram[CRUX_DATAGRAM_CAPACITY];
  const std::size_t size = crux_datagram_encode(&sent, datagram);
  for (std::size_t cut = 0; cut < size; ++cut) {
    // A copy of exactly that size, so that the address sanitizer sees any read beyond it.
    const std::vector<std::uint8_t> exact(datagram, datagram + cut);
    crux_frame heard{};
    EXPECT_FALSE(crux_datagram_decode(exact.data(), cut, &heard)) << cut;
  }
}

TEST(Datagram, NoBytesCanHurt) {
  std::mt19937 random(4711);
  std::uniform_int_distribution<int> byte(0, 255);
  crux_frame sent{};
  sent.length = 64;
  std::uint8_t datagram[CRUX_DATAGRAM_CAPACITY];
  const std::size_t size = crux_datagram_encode(&sent, datagram);
  for (int round = 0; round < 20000; ++round) {
    std::vector<std::uint8_t> bytes(datagram, datagram + size);
    for (int change = byte(random) % 8; change >= 0; --change) {
      bytes[static_cast<std::size_t>(random() % bytes.size())] = static_cast<std::uint8_t>(byte(random));
    }
    bytes.resize(random() % (size + 1));
    bytes.shrink_to_fit();
    crux_frame heard{};
    if (crux_datagram_decode(bytes.data(), bytes.size(), &heard)) {
      EXPECT_LE(heard.length, 64);
      EXPECT_LT(heard.id, 0x800);
    }
  }
}

}  // namespace
}  // namespace crux::firmware
