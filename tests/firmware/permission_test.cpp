// What services may do to a node: the table's ranges to the last bit, and the states in which it stands still.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

extern "C" {
#include "codec.h"
#include "crux_services.h"
#include "permission.h"
}

namespace {

constexpr crux_parameter kFloat{"gain", "Nm/rad", 5, false, true, false, 0.5F, 2.0F};
constexpr crux_parameter kInteger{"cycles", "", 11, true, true, false, 0.5F, 2.0F};
constexpr crux_parameter kReadOnly{"limit", "Nm", 4, false, false, false, 1.0F, 1.0F};

std::uint32_t bits(float value) {
  std::uint32_t result = 0;
  std::memcpy(&result, &value, sizeof result);
  return result;
}

TEST(Permission, OnlyBootHoldAndFaultAreRest) {
  for (unsigned state = 0; state < 256; ++state) {
    const bool rest = state == CRUX_STATE_BOOT || state == CRUX_STATE_HOLD || state == CRUX_STATE_FAULT;
    EXPECT_EQ(crux_is_at_rest(static_cast<std::uint8_t>(state)), rest) << state;
  }
}

TEST(Permission, AFloatIsAcceptedFromItsLeastToItsGreatestShare) {
  const float infinity = std::numeric_limits<float>::infinity();
  const auto accepts = [](float value) { return crux_parameter_accepts(&kFloat, bits(100.0F), bits(value)); };
  EXPECT_TRUE(accepts(50.0F));
  EXPECT_TRUE(accepts(200.0F));
  EXPECT_FALSE(accepts(std::nextafterf(50.0F, 0.0F)));
  EXPECT_FALSE(accepts(std::nextafterf(200.0F, infinity)));
  EXPECT_FALSE(accepts(std::numeric_limits<float>::quiet_NaN()));
  EXPECT_FALSE(accepts(infinity));
  EXPECT_FALSE(accepts(-100.0F));
  EXPECT_FALSE(accepts(0.0F));
}

TEST(Permission, AnIntegerIsAcceptedFromItsLeastToItsGreatestShare) {
  const auto accepts = [](std::uint32_t value) { return crux_parameter_accepts(&kInteger, 5, value); };
  EXPECT_FALSE(accepts(2));
  EXPECT_TRUE(accepts(3));
  EXPECT_TRUE(accepts(10));
  EXPECT_FALSE(accepts(11));
  EXPECT_FALSE(accepts(0));
  EXPECT_FALSE(accepts(0xFFFFFFFFU));
}

TEST(Permission, ReadOnlyIsNotWrittenEvenToTheSameValue) {
  EXPECT_FALSE(crux_parameter_accepts(&kReadOnly, bits(10.0F), bits(10.0F)));
}

TEST(Permission, ARestartNeedsRestNobodyWhoCommandsAndTheAcknowledgement) {
  constexpr std::uint32_t kOff = CRUX_ACKNOWLEDGEMENT_OFF_THE_WALL;
  EXPECT_TRUE(crux_may_restart(CRUX_STATE_HOLD, false, kOff));
  EXPECT_TRUE(crux_may_restart(CRUX_STATE_BOOT, false, kOff));
  EXPECT_FALSE(crux_may_restart(CRUX_STATE_TRACK, false, kOff));
  EXPECT_FALSE(crux_may_restart(CRUX_STATE_HOLD, true, kOff));
  EXPECT_FALSE(crux_may_restart(CRUX_STATE_BOOT, true, kOff));
  EXPECT_FALSE(crux_may_restart(CRUX_STATE_HOLD, false, 0));
  EXPECT_FALSE(crux_may_restart(CRUX_STATE_HOLD, false, kOff + 1U));
  EXPECT_TRUE(crux_may_restart(CRUX_STATE_FAULT, false, kOff));
  EXPECT_FALSE(crux_may_restart(CRUX_STATE_FAULT, true, kOff));
  EXPECT_FALSE(crux_may_restart(CRUX_STATE_FAULT, false, 0));
}

}  // namespace
