// What the runtime prints of what its nodes tell.
#include "lcm/messages.hpp"

#include <gtest/gtest.h>

#include <bit>

#include "crux_can.h"

namespace crux {
namespace {

std::string printed(int node, int cause, std::uint32_t detail) {
  testing::internal::CaptureStderr();
  print_notice({.kind = NodeNotice::Kind::kEmergency,
                .limb = 0,
                .node = static_cast<std::uint8_t>(node),
                .cause = static_cast<std::uint8_t>(cause),
                .detail = detail});
  return testing::internal::GetCapturedStderr();
}

TEST(Emergency, ALimitIsTheValueAskedForInItsUnit) {
  const auto bits = std::bit_cast<std::uint32_t>(0.1234F);
  EXPECT_EQ(printed(3, CRUX_CAN_JOINT_EMERGENCY_CAUSE_POSITION_LIMIT_CHOICE, bits),
            "crux-runtime: LF node 3: emergency: commanded beyond the position limit (0.1234 rad)\n");
  EXPECT_EQ(printed(3, CRUX_CAN_JOINT_EMERGENCY_CAUSE_VELOCITY_LIMIT_CHOICE, bits),
            "crux-runtime: LF node 3: emergency: commanded beyond the velocity limit (0.1234 rad/s)\n");
  EXPECT_EQ(printed(7, CRUX_CAN_JOINT_EMERGENCY_CAUSE_POSITION_LIMIT_CHOICE, bits),
            "crux-runtime: LF node 7: emergency: commanded beyond the position limit (0.1234 m)\n");
}

TEST(Emergency, EachDetailHasItsUnit) {
  EXPECT_EQ(printed(1, CRUX_CAN_JOINT_EMERGENCY_CAUSE_OVER_TEMPERATURE_CHOICE, std::bit_cast<std::uint32_t>(81.4F)),
            "crux-runtime: LF node 1: emergency: too hot (81 degC)\n");
  EXPECT_EQ(printed(1, CRUX_CAN_JOINT_EMERGENCY_CAUSE_COMMAND_TIMEOUT_CHOICE, 10500),
            "crux-runtime: LF node 1: emergency: no valid command in time, holding (silent for 10.5 ms)\n");
  EXPECT_EQ(printed(1, CRUX_CAN_JOINT_EMERGENCY_CAUSE_E2_E_CRC_CHOICE, 4),
            "crux-runtime: LF node 1: emergency: damaged command (CRC) (4 so far)\n");
  EXPECT_EQ(printed(1, CRUX_CAN_JOINT_EMERGENCY_CAUSE_BUS_OFF_CHOICE, 0),
            "crux-runtime: LF node 1: emergency: bus off\n");
}

}  // namespace
}  // namespace crux
