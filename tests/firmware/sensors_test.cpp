// Encoder frames and the force/torque sensor's samples.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <vector>

extern "C" {
#include "drive/as5047p.h"
#include "wrench_sensor.h"
}

namespace crux::firmware {
namespace {

TEST(As5047p, OfAllAnswersTheOnesWithEvenParityAndNoErrorFlagAreValid) {
  for (std::uint32_t word = 0; word < 0x10000; ++word) {
    const auto answer = static_cast<std::uint16_t>(word);
    ASSERT_EQ(crux_as5047p_valid(answer), std::popcount(answer) % 2 == 0 && (word & 0x4000) == 0) << word;
    ASSERT_EQ(crux_as5047p_angle(answer), word & 0x3FFF);
  }
}

TEST(As5047p, CommandsReadAndHaveEvenParity) {
  for (const std::uint32_t command : {CRUX_AS5047P_READ_ANGLE, CRUX_AS5047P_READ_ERRORS}) {
    EXPECT_EQ(std::popcount(command) % 2, 0);
    EXPECT_NE(command & 0x4000, 0U);
  }
}

constexpr std::uint32_t kMillisecond = 1000;

struct Sensor {
  crux_wrench_sensor sensor{};

  Sensor() { crux_wrench_sensor_init(&sensor); }
  // A sample as the sensor sends it: counts big-endian, then the overload flags.
  static std::vector<crux_frame> sample(const std::array<int, 6>& counts, std::uint8_t overload = 0) {
    std::array<std::uint8_t, 16> bytes{0x0B};
    for (std::size_t i = 0; i < 6; ++i) {
      bytes[1 + 2 * i] = static_cast<std::uint8_t>(static_cast<unsigned>(counts[i]) >> 8);
      bytes[2 + 2 * i] = static_cast<std::uint8_t>(counts[i]);
    }
    bytes[13] = overload;
    std::vector<crux_frame> frames(2);
    for (std::size_t half = 0; half < 2; ++half) {
      frames[half].id = static_cast<std::uint16_t>(half + 1);
      frames[half].length = 8;
      std::copy_n(bytes.begin() + static_cast<long>(8 * half), 8, frames[half].data);
    }
    return frames;
  }
  void hear(const crux_frame& frame) { crux_wrench_sensor_on_frame(&sensor, &frame); }
  bool pass(std::uint32_t us, crux_frame* asked = nullptr) {
    crux_frame frame{};
    return crux_wrench_sensor_tick(&sensor, us, asked != nullptr ? asked : &frame);
  }
};

TEST(WrenchSensor, ReadsForcesInFiftiethsAndMomentsInTwoThousandths) {
  Sensor s;
  for (const crux_frame& frame : Sensor::sample({50, -50, 10000, 2000, -2000, -32768}, 1)) {
    s.hear(frame);
  }
  const std::array<float, 6> expected{1.0F, -1.0F, 200.0F, 1.0F, -1.0F, -16.384F};
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_FLOAT_EQ(s.sensor.wrench[i], expected[i]) << i;
  }
  EXPECT_TRUE(crux_wrench_sensor_valid(&s.sensor));
  EXPECT_TRUE(s.sensor.overloaded);
}

TEST(WrenchSensor, HalvesOfDifferentSamplesAreNotPutTogether) {
  Sensor s;
  const auto old = Sensor::sample({1, 2, 3, 4, 5, 6});
  const auto next = Sensor::sample({100, 200, 300, 400, 500, 600});
  s.hear(old[1]);  // its first half is lost
  EXPECT_FALSE(crux_wrench_sensor_valid(&s.sensor));
  s.hear(old[0]);
  s.hear(old[1]);
  s.hear(next[1]);  // first half lost: the sample before stays
  EXPECT_FLOAT_EQ(s.sensor.wrench[4], 5.0F / 2000.0F);
  s.hear(next[0]);  // second half of `old` never came twice
  EXPECT_FLOAT_EQ(s.sensor.wrench[0], 1.0F / 50.0F);
  s.hear(next[1]);
  EXPECT_FLOAT_EQ(s.sensor.wrench[0], 2.0F);
}

TEST(WrenchSensor, OtherFramesAreNotSamples) {
  Sensor s;
  auto frames = Sensor::sample({1, 2, 3, 4, 5, 6});
  frames[0].data[0] = 0x10;  // the answer to another command
  s.hear(frames[0]);
  s.hear(frames[1]);
  frames = Sensor::sample({1, 2, 3, 4, 5, 6});
  frames[0].length = 7;
  s.hear(frames[0]);
  s.hear(frames[1]);
  frames = Sensor::sample({1, 2, 3, 4, 5, 6});
  frames[0].id = 0x64;
  s.hear(frames[0]);
  s.hear(frames[1]);
  EXPECT_FALSE(crux_wrench_sensor_valid(&s.sensor));
}

TEST(WrenchSensor, IsAskedUntilItAnswersAndAgainWhenItFallsSilent) {
  Sensor s;
  crux_frame asked{};
  EXPECT_TRUE(s.pass(kMillisecond, &asked));
  EXPECT_EQ(asked.id, 0x64);
  EXPECT_EQ(asked.length, 8);
  EXPECT_EQ(asked.data[0], 0x0B);
  int times = 0;
  for (int k = 0; k < 1000; ++k) {
    times += s.pass(kMillisecond) ? 1 : 0;
  }
  EXPECT_EQ(times, 10);
  for (int k = 0; k < 1000; ++k) {  // 200 samples a second, the factory's setting
    if (k % 5 == 0) {
      for (const crux_frame& frame : Sensor::sample({k, 0, 0, 0, 0, 0})) {
        s.hear(frame);
      }
    }
    EXPECT_FALSE(s.pass(kMillisecond));
    EXPECT_TRUE(crux_wrench_sensor_valid(&s.sensor));
  }
  for (int k = 0; k < 12; ++k) {
    s.pass(kMillisecond);
  }
  EXPECT_FALSE(crux_wrench_sensor_valid(&s.sensor));
  for (int k = 0; k < 100000; ++k) {
    s.pass(100 * kMillisecond);  // ages do not wrap
    ASSERT_FALSE(crux_wrench_sensor_valid(&s.sensor));
  }
}

}  // namespace
}  // namespace crux::firmware
