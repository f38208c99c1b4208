// What a board makes of its readings: the thermistor against the exponential law that it is made by, and time against
// counted ticks.
#include <gtest/gtest.h>

#include <cmath>

extern "C" {
#include "drive/board_watch.h"
}

namespace crux::firmware {
namespace {

/// Share of the reference over a thermistor of 10 kOhm at 25 degC with B = 3435 K, below 10 kOhm.
float share_at(double temperature_degc) {
  const double ratio = std::exp(3435.0 * (1.0 / (temperature_degc + 273.15) - 1.0 / 298.15));
  return static_cast<float>(ratio / (ratio + 1.0));
}

TEST(BoardWatch, ReadsTheWindingsTemperature) {
  for (const double degc : {-40.0, 0.0, 25.0, 60.0, 95.0, 150.0}) {
    EXPECT_NEAR(crux_thermistor_degC(share_at(degc)), degc, 0.05) << degc;
  }
}

TEST(BoardWatch, KnowsNoTemperatureOfAThermistorThatIsOpenOrShorted) {
  for (const float share : {0.0F, 1.0F / 4096.0F, 4095.0F / 4096.0F, 1.0F}) {
    EXPECT_TRUE(std::isnan(crux_thermistor_degC(share))) << share;
  }
}

TEST(BoardWatch, SeesThatTheLoopStandsAfterTwoTicks) {
  crux_loop_watch watch{};
  EXPECT_TRUE(crux_loop_runs(&watch, 20, false));
  EXPECT_TRUE(crux_loop_runs(&watch, 20, false));
  EXPECT_FALSE(crux_loop_runs(&watch, 20, false));
  EXPECT_FALSE(crux_loop_runs(&watch, 20, false));
  EXPECT_TRUE(crux_loop_runs(&watch, 21, false));
}

TEST(BoardWatch, TakesTicksThatComeAtOnceForNoStandingLoop) {
  crux_loop_watch watch{};
  EXPECT_TRUE(crux_loop_runs(&watch, 20, true));  // so far behind that the next ones have come already
  for (int late = 0; late < 5; ++late) {
    EXPECT_TRUE(crux_loop_runs(&watch, 20, late < 4));
  }
  EXPECT_TRUE(crux_loop_runs(&watch, 20, false));
  EXPECT_FALSE(crux_loop_runs(&watch, 20, false));
}

TEST(BoardWatch, TellsAShortFaultLongEnough) {
  uint32_t left = crux_fault_ticks(0, true, 3);
  int told = 0;
  for (; left > 0 && told < 10; ++told) left = crux_fault_ticks(left, false, 3);
  EXPECT_EQ(told, 3);
  EXPECT_EQ(crux_fault_ticks(0, false, 3), 0U);
}

}  // namespace
}  // namespace crux::firmware
