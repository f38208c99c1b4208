#include "bus/udp_codec.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace crux {
namespace {

std::vector<std::uint8_t> from_hex(std::string_view hex) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoul(std::string(hex.substr(i, 2)), nullptr, 16)));
  return bytes;
}

// Written by python-can 4.6.1, can.interfaces.udp_multicast.utils.pack_message.
const std::string kFdFrame =
    "8ba974696d657374616d70cb3ff8000000000000ae6172626974726174696f6e5f6964cd0181ae69735f657874656e6465645f6964c2af6973"
    "5f"
    "72656d6f74655f6672616d65c2ae69735f6572726f725f6672616d65c2a76368616e6e656cc0a3646c6310a464617461c41000010203040506"
    "07"
    "08090a0b0c0d0e0fa569735f6664c3ae626974726174655f737769746368c3b56572726f725f73746174655f696e64696361746f72c2";
const std::string kExtendedFrame =
    "8ba974696d657374616d7000ae6172626974726174696f6e5f6964ce001abcdeae69735f657874656e6465645f6964c3af69735f72656d6f74"
    "65"
    "5f6672616d65c2ae69735f6572726f725f6672616d65c2a76368616e6e656ca57663616e30a3646c6302a464617461c4020102a569735f6664"
    "c2"
    "ae626974726174655f737769746368c2b56572726f725f73746174655f696e64696361746f72c2";
const std::string kRemoteFrame =
    "8ba974696d657374616d7000ae6172626974726174696f6e5f696407ae69735f657874656e6465645f6964c2af69735f72656d6f74655f6672"
    "61"
    "6d65c3ae69735f6572726f725f6672616d65c2a76368616e6e656cc0a3646c6304a464617461c400a569735f6664c2ae626974726174655f73"
    "77"
    "69746368c2b56572726f725f73746174655f696e64696361746f72c2";

std::vector<std::uint8_t> encoded(const Frame& frame) {
  std::array<std::uint8_t, kMaxDatagram> out{};
  const std::size_t n = encode_datagram(frame, out);
  return {out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n)};
}

Frame fd_frame(std::uint8_t length) {
  Frame frame;
  frame.id = 0x181;
  frame.length = length;
  for (std::uint8_t i = 0; i < length; ++i) frame.data[i] = static_cast<std::uint8_t>(i * 7 + 1);
  return frame;
}

TEST(UdpCodec, ReadsWhatPythonCanWrites) {
  Frame frame;
  ASSERT_TRUE(decode_datagram(from_hex(kFdFrame), frame));
  EXPECT_EQ(frame.id, 0x181U);
  EXPECT_FALSE(frame.extended);
  EXPECT_TRUE(frame.fd);
  EXPECT_TRUE(frame.bit_rate_switch);
  ASSERT_EQ(frame.length, 16);
  for (std::uint8_t i = 0; i < 16; ++i) EXPECT_EQ(frame.data[i], i);

  ASSERT_TRUE(decode_datagram(from_hex(kExtendedFrame), frame));
  EXPECT_EQ(frame.id, 0x1abcdeU);
  EXPECT_TRUE(frame.extended);
  EXPECT_FALSE(frame.fd);
  EXPECT_EQ(frame.length, 2);

  ASSERT_TRUE(decode_datagram(from_hex(kRemoteFrame), frame));
  EXPECT_TRUE(frame.remote);
  EXPECT_EQ(frame.length, 0);
}

TEST(UdpCodec, ReadsWhatItWritesForEveryLength) {
  for (const std::uint8_t length : {0, 1, 8, 12, 16, 20, 24, 32, 48, 64}) {
    const Frame sent = fd_frame(length);
    Frame got;
    ASSERT_TRUE(decode_datagram(encoded(sent), got)) << int(length);
    EXPECT_EQ(got.id, sent.id);
    EXPECT_EQ(got.length, length);
    EXPECT_EQ(got.data, sent.data);
  }
}

TEST(UdpCodec, RefusesEveryTruncation) {
  for (const auto& whole : {from_hex(kFdFrame), from_hex(kExtendedFrame), encoded(fd_frame(64))}) {
    for (std::size_t n = 0; n < whole.size(); ++n) {
      // A copy of exactly n bytes, so that AddressSanitizer sees the first byte read too far.
      const std::vector<std::uint8_t> part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(n));
      Frame frame;
      EXPECT_FALSE(decode_datagram(part, frame)) << n;
    }
    std::vector<std::uint8_t> longer = whole;
    longer.push_back(0xc0);
    Frame frame;
    EXPECT_FALSE(decode_datagram(longer, frame));
  }
}

TEST(UdpCodec, StandsRandomBytesAndBitFlips) {
  std::mt19937 random(7);
  const std::vector<std::uint8_t> whole = from_hex(kFdFrame);
  int refused = 0;
  for (int i = 0; i < 20000; ++i) {
    std::vector<std::uint8_t> bytes = whole;
    for (unsigned flips = random() % 4 + 1; flips > 0; --flips)
      bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
    Frame frame;
    if (decode_datagram(bytes, frame)) {
      EXPECT_LE(frame.length, Frame::kMaxPayload);
      EXPECT_LE(frame.id, 0x1fffffffU);
    } else {
      ++refused;
    }
    bytes.resize(random() % 200);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    decode_datagram(bytes, frame);
  }
  EXPECT_GT(refused, 10000);  // most of the datagram is structure
}

// The eleven keys by hand, to change one thing at a time.
std::string map_of(const std::string& id, const std::string& dlc, const std::string& data, const std::string& extended,
                   const std::string& fd) {
  return "85ae6172626974726174696f6e5f6964" + id + "a3646c63" + dlc + "a464617461" + data +
         "ae69735f657874656e6465645f6964" + extended + "a569735f6664" + fd;
}

bool reads(const std::string& hex) {
  Frame frame;
  return decode_datagram(from_hex(hex), frame);
}

TEST(UdpCodec, RefusesFramesThatCanCannotCarry) {
  EXPECT_TRUE(reads(map_of("cd0181", "02", "c4020102", "c2", "c3")));
  EXPECT_FALSE(reads(map_of("cd0800", "02", "c4020102", "c2", "c3"))) << "12-bit standard identifier";
  EXPECT_TRUE(reads(map_of("cd0800", "02", "c4020102", "c3", "c3")));
  EXPECT_FALSE(reads(map_of("ce20000000", "02", "c4020102", "c3", "c3"))) << "30-bit extended identifier";
  EXPECT_FALSE(reads(map_of("cd0181", "03", "c4020102", "c2", "c3"))) << "dlc is not the number of bytes";
  EXPECT_FALSE(reads(map_of("cd0181", "09", "c409010203040506070809", "c2", "c2"))) << "nine bytes in classic CAN";
  EXPECT_FALSE(reads(map_of("cd0181", "41", "c441" + std::string(130, '0'), "c2", "c3"))) << "65 bytes";
  EXPECT_FALSE(reads(map_of("cd0181", "02", "a20102", "c2", "c3"))) << "data as a string";
  EXPECT_FALSE(reads(map_of("ff", "02", "c4020102", "c2", "c3"))) << "negative identifier";
  EXPECT_FALSE(reads("81a173c3")) << "unknown key";
  EXPECT_FALSE(reads("80")) << "nothing at all";
}

}  // namespace
}  // namespace crux
