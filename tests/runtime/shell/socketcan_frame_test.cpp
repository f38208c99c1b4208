// The conversions of the SocketCAN back-end; the socket itself needs a kernel that has one.
#include <gtest/gtest.h>

#include "bus/socketcan_bus.hpp"

namespace crux {
namespace {

TEST(SocketCanFrame, CarriesAnFdFrameBothWays) {
  Frame sent;
  sent.id = 0x107;
  sent.length = 16;
  for (std::uint8_t i = 0; i < 16; ++i) sent.data[i] = static_cast<std::uint8_t>(200 + i);
  canfd_frame kernel{};
  ASSERT_EQ(to_kernel(sent, kernel), static_cast<std::size_t>(CANFD_MTU));
  EXPECT_EQ(kernel.can_id, 0x107U);
  EXPECT_EQ(kernel.flags & CANFD_BRS, CANFD_BRS);
  EXPECT_EQ(kernel.len, 16);
  Frame got;
  ASSERT_TRUE(from_kernel(kernel, CANFD_MTU, got));
  EXPECT_EQ(got.id, sent.id);
  EXPECT_TRUE(got.fd);
  EXPECT_TRUE(got.bit_rate_switch);
  EXPECT_EQ(got.length, sent.length);
  EXPECT_EQ(got.data, sent.data);
}

TEST(SocketCanFrame, TellsClassicExtendedRemoteAndErrorFrames) {
  canfd_frame kernel{};
  Frame got;
  kernel.can_id = 0x1abcde | CAN_EFF_FLAG | CAN_RTR_FLAG;
  kernel.len = 3;
  ASSERT_TRUE(from_kernel(kernel, CAN_MTU, got));
  EXPECT_FALSE(got.fd);
  EXPECT_TRUE(got.extended);
  EXPECT_TRUE(got.remote);
  EXPECT_EQ(got.id, 0x1abcdeU);
  kernel.can_id = CAN_ERR_FLAG | 0x40;
  ASSERT_TRUE(from_kernel(kernel, CAN_MTU, got));
  EXPECT_TRUE(got.error);
  EXPECT_FALSE(from_kernel(kernel, 7, got));
  kernel.len = 9;
  EXPECT_FALSE(from_kernel(kernel, CAN_MTU, got));
  kernel.len = 65;
  EXPECT_FALSE(from_kernel(kernel, CANFD_MTU, got));
}

}  // namespace
}  // namespace crux
