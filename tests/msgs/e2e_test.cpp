#include "e2e.h"

#include <gtest/gtest.h>

#include <array>

namespace {

constexpr std::uint32_t kIdentifier = 0x183;

std::array<std::uint8_t, 16> frame(std::uint8_t counter) {
  std::array<std::uint8_t, 16> payload{};
  for (std::size_t i = 3; i < payload.size(); ++i) payload[i] = static_cast<std::uint8_t>(37 * i);
  crux_e2e_protect(kIdentifier, counter, payload.data(), payload.size());
  return payload;
}

TEST(E2e, CrcIsTheCatalogueCrc16OfItsParameters) {
  // CRC-16/IBM-3740 (0x1021, 0xFFFF) of "123456789" is 0x29B1 in the public catalogue; the last two digits come in
  // through the identifier.
  const std::array<std::uint8_t, 9> payload = {0, 0, '1', '2', '3', '4', '5', '6', '7'};
  const std::uint32_t identifier = '8' | ('9' << 8);
  EXPECT_EQ(crux_e2e_crc(identifier, payload.data(), payload.size()), 0x29B1);
}

TEST(E2e, EveryFlippedBitIsFound) {
  for (std::size_t bit = 0; bit < 16 * 8; ++bit) {
    auto damaged = frame(7);
    damaged[bit / 8] = static_cast<std::uint8_t>(damaged[bit / 8] ^ (1U << (bit % 8)));
    crux_e2e_receiver receiver{};
    EXPECT_EQ(crux_e2e_check(kIdentifier, damaged.data(), damaged.size(), &receiver), CRUX_E2E_CORRUPT) << bit;
    EXPECT_FALSE(receiver.seen);
  }
}

TEST(E2e, AFrameOfAnotherIdentifierIsCorrupt) {
  const auto payload = frame(7);
  crux_e2e_receiver receiver{};
  EXPECT_EQ(crux_e2e_check(kIdentifier + 1, payload.data(), payload.size(), &receiver), CRUX_E2E_CORRUPT);
}

TEST(E2e, CounterTellsNextLostAndRepeated) {
  crux_e2e_receiver receiver{};
  const auto check = [&receiver](std::uint8_t counter) {
    const auto payload = frame(counter);
    return crux_e2e_check(kIdentifier, payload.data(), payload.size(), &receiver);
  };
  EXPECT_EQ(check(254), CRUX_E2E_OK) << "the first frame may have any counter";
  EXPECT_EQ(check(255), CRUX_E2E_OK);
  EXPECT_EQ(check(0), CRUX_E2E_OK) << "the counter runs over";
  EXPECT_EQ(check(0), CRUX_E2E_REPEATED);
  EXPECT_EQ(check(3), CRUX_E2E_LOST);
  EXPECT_EQ(check(4), CRUX_E2E_OK) << "a loss is told once";
  EXPECT_EQ(check(3), CRUX_E2E_LOST) << "an old frame looks like 254 lost ones";
}

TEST(E2e, ShortFramesAreCorrupt) {
  const auto payload = frame(1);
  for (std::size_t length = 0; length < CRUX_E2E_HEADER_LENGTH; ++length) {
    crux_e2e_receiver receiver{};
    EXPECT_EQ(crux_e2e_check(kIdentifier, payload.data(), length, &receiver), CRUX_E2E_CORRUPT);
  }
}

}  // namespace
