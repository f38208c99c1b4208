// The SocketCAN back-end on a virtual interface of a real kernel. Needs root and the interface `vcan0`; tests/socketcan
// runs it. What it is compared with are plain sockets and the tools ip and tc.
#include "bus/socketcan_bus.hpp"

#include <gtest/gtest.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>

#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "bus/frame_kind.hpp"

namespace crux {
namespace {

using namespace std::chrono_literals;

constexpr const char* kInterface = "vcan0";
constexpr auto kWhile = 300ms;

void call(const std::string& command) { ASSERT_EQ(std::system(command.c_str()), 0) << command; }

/// The other side: a plain CAN FD socket of the kernel.
class PlainSocket {
 public:
  PlainSocket() : fd_(::socket(PF_CAN, SOCK_RAW, CAN_RAW)) {
    const int on = 1;
    EXPECT_EQ(::setsockopt(fd_.get(), SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on), 0);
    const timeval limit{.tv_sec = 0, .tv_usec = 300'000};
    EXPECT_EQ(::setsockopt(fd_.get(), SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit), 0);
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = static_cast<int>(::if_nametoindex(kInterface));
    EXPECT_EQ(::bind(fd_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  void send(canid_t id, std::uint8_t length = 8, std::size_t mtu = CANFD_MTU, std::uint8_t detail = 0) {
    canfd_frame frame{};
    frame.can_id = id;
    frame.len = length;
    frame.flags = mtu == CANFD_MTU ? CANFD_BRS : 0;
    frame.data[1] = detail;
    EXPECT_EQ(::write(fd_.get(), &frame, mtu), static_cast<ssize_t>(mtu));
  }
  /// Bytes read, 0 when nothing came.
  std::size_t receive(canfd_frame& frame) {
    const ssize_t n = ::read(fd_.get(), &frame, sizeof frame);
    return n > 0 ? static_cast<std::size_t>(n) : 0;
  }

 private:
  Descriptor fd_;
};

class SocketCanTest : public ::testing::Test {
 protected:
  void SetUp() override {
    bus_ = open_bus(std::string("socketcan:") + kInterface);
    other_ = std::make_unique<PlainSocket>();
  }
  static Frame frame(std::uint32_t id, std::uint8_t length = 16) {
    Frame made;
    made.id = id;
    made.length = length;
    for (std::uint8_t i = 0; i < length; ++i) made.data[i] = static_cast<std::uint8_t>(3 * i + 1);
    return made;
  }
  std::size_t send(std::uint32_t id, std::size_t count = 1) { return bus_->send(std::vector<Frame>(count, frame(id))); }
  std::vector<Frame> receive() {
    std::vector<Frame> all;
    std::array<Frame, 8> part;
    while (wait_readable({&bus_, 1}, kWhile)) {
      const std::size_t n = bus_->receive(part);
      if (n == 0) break;
      all.insert(all.end(), part.begin(), part.begin() + static_cast<std::ptrdiff_t>(n));
    }
    return all;
  }
  BusState report(canid_t classes, std::uint8_t detail = 0) {
    other_->send(CAN_ERR_FLAG | classes, CAN_ERR_DLC, CAN_MTU, detail);
    EXPECT_TRUE(receive().empty()) << "error frames are no frames";
    return bus_->state();
  }

  std::unique_ptr<Bus> bus_;
  std::unique_ptr<PlainSocket> other_;
};

TEST_F(SocketCanTest, SendsFdFramesWithTheFastBitRate) {
  ASSERT_EQ(send(0x105), 1U);
  canfd_frame got{};
  ASSERT_EQ(other_->receive(got), static_cast<std::size_t>(CANFD_MTU));
  EXPECT_EQ(got.can_id, 0x105U);
  EXPECT_EQ(got.len, 16);
  EXPECT_EQ(got.flags & CANFD_BRS, CANFD_BRS);
  EXPECT_EQ(got.data[15], 46);
}

TEST_F(SocketCanTest, HearsTheDatabasesIdentifiersAndNoOthers) {
  unsigned known = 0;
  for (canid_t id = 0; id < 0x800; ++id) {
    known += kFrameMeanings[id].kind != FrameKind::kUnknown ? 1 : 0;
    other_->send(id);
  }
  other_->send(0x181 | CAN_EFF_FLAG);
  other_->send(0x181 | CAN_RTR_FLAG, 0, CAN_MTU);
  const std::vector<Frame> got = receive();
  EXPECT_EQ(got.size(), known);
  for (const Frame& each : got) EXPECT_NE(kFrameMeanings[each.id].kind, FrameKind::kUnknown);
}

TEST_F(SocketCanTest, StampsWhatCameAndWhatHasGoneOut) {
  timespec now{};
  ::clock_gettime(CLOCK_REALTIME, &now);
  const std::int64_t before_ns = now.tv_sec * 1'000'000'000 + now.tv_nsec;
  send(CRUX_CAN_ID_SYNC);
  other_->send(0x181, 16);
  const std::vector<Frame> got = receive();
  ASSERT_EQ(got.size(), 2U);
  EXPECT_EQ(got[0].id, CRUX_CAN_ID_SYNC);
  EXPECT_TRUE(got[0].own);
  EXPECT_FALSE(got[1].own);
  EXPECT_GE(got[0].stamp_ns, before_ns);
  EXPECT_GE(got[1].stamp_ns, got[0].stamp_ns);
  EXPECT_LT(got[1].stamp_ns, before_ns + 1'000'000'000);
}

TEST_F(SocketCanTest, FilesErrorFrames) {
  EXPECT_EQ(report(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE), BusState::kPassive);
  EXPECT_EQ(report(CAN_ERR_ACK), BusState::kUnacknowledged);
  EXPECT_EQ(report(CAN_ERR_BUSOFF), BusState::kOff);
  EXPECT_EQ(send(0x101), 1U) << "the kernel goes on taking frames";
  EXPECT_EQ(bus_->state(), BusState::kOff);
  EXPECT_EQ(receive().size(), 1U) << "the echo of that";
  EXPECT_EQ(report(CAN_ERR_RESTARTED), BusState::kActive);
  EXPECT_EQ(bus_->statistics().error_frames, 4U);
  EXPECT_EQ(bus_->statistics().bus_off, 1U);
  EXPECT_EQ(bus_->statistics().restarts, 1U);
}

TEST_F(SocketCanTest, AnInterfaceThatIsDownIsNoticedAndUsedAgain) {
  call("ip link set vcan0 down");
  EXPECT_TRUE(receive().empty());
  EXPECT_EQ(bus_->state(), BusState::kDown) << "noticed without sending";
  EXPECT_EQ(send(0x101, 9), 0U);
  EXPECT_EQ(bus_->statistics().send_failed, 9U);
  EXPECT_EQ(bus_->statistics().interface_down, 1U);
  call("ip link set vcan0 up");
  EXPECT_EQ(send(0x101, 9), 9U);
  EXPECT_EQ(bus_->state(), BusState::kActive);
  other_ = std::make_unique<PlainSocket>();
  receive();
  other_->send(0x181);
  EXPECT_EQ(receive().size(), 1U);
}

TEST_F(SocketCanTest, AnInterfaceThatWasUnpluggedIsFoundAgain) {
  call("ip link del vcan0");
  receive();
  EXPECT_EQ(send(0x101), 0U);
  EXPECT_EQ(bus_->state(), BusState::kDown);
  call("ip link add vcan0 type vcan && ip link set vcan0 mtu 72 up");
  for (int cycle = 0; cycle < 100; ++cycle) send(0x101);
  EXPECT_EQ(bus_->state(), BusState::kActive);
  EXPECT_EQ(bus_->statistics().interface_down, 1U);
  receive();
  other_ = std::make_unique<PlainSocket>();
  other_->send(0x181);
  EXPECT_EQ(receive().size(), 1U);
}

TEST_F(SocketCanTest, AFullTransmitQueueIsCountedByCallAndByFrame) {
  call("tc qdisc add dev vcan0 root netem delay 200ms limit 4");
  EXPECT_EQ(send(0x101, 9), 4U);
  EXPECT_EQ(bus_->state(), BusState::kFull);
  EXPECT_EQ(send(0x101, 9), 0U);
  EXPECT_EQ(bus_->statistics().queue_full, 2U);
  EXPECT_EQ(bus_->statistics().send_failed, 14U);
  call("sleep 0.3");
  EXPECT_EQ(send(0x101, 2), 2U);
  EXPECT_EQ(bus_->state(), BusState::kActive);
  call("tc qdisc del dev vcan0 root");
}

TEST(SocketCanOpening, NamesWhatIsMissing) {
  call("ip link add vcan9 type vcan && ip link set vcan9 mtu 16 up");
  EXPECT_THROW(open_bus("socketcan:vcan9"), BusError);
  EXPECT_THROW(open_bus("socketcan:nosuch"), BusError);
  call("ip link del vcan9");
}

}  // namespace
}  // namespace crux
