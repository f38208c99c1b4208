#include "bus/bus.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <string>

#include "bus/descriptor.hpp"

namespace crux {
namespace {

using namespace std::chrono_literals;

// Away from the ports that programs use, and from those of tests that may run beside this one.
std::string test_bus(int offset) { return "udp:239.74.163.9:" + std::to_string(20000 + ::getpid() % 20000 + offset); }

std::string error_of(const std::string& name) {
  try {
    open_bus(name);
  } catch (const BusError& error) {
    return error.what();
  }
  return "";
}

std::size_t receive_within(const std::unique_ptr<Bus>& bus, std::span<Frame> frames, std::chrono::milliseconds limit) {
  const auto end = std::chrono::steady_clock::now() + limit;
  std::size_t n = 0;
  while (n < frames.size() && std::chrono::steady_clock::now() < end) {
    wait_readable({&bus, 1}, 10ms);
    n += bus->receive(frames.subspan(n));
  }
  return n;
}

TEST(Bus, WrongNamesAreNamed) {
  EXPECT_NE(error_of("can0").find("'can0'"), std::string::npos);
  EXPECT_NE(error_of("udp:239.74.163.2").find("udp:GROUP:PORT"), std::string::npos);
  EXPECT_NE(error_of("udp:239.74.163.2:").find("1 to 65535"), std::string::npos);
  EXPECT_NE(error_of("udp:239.74.163.2:65536").find("1 to 65535"), std::string::npos);
  EXPECT_NE(error_of("udp:239.74.163.2:12x").find("'12x'"), std::string::npos);
  EXPECT_NE(error_of("udp:192.168.0.1:43113").find("not an IPv4 multicast address"), std::string::npos);
  EXPECT_NE(error_of("socketcan:").find("socketcan:"), std::string::npos);
  EXPECT_NE(error_of("socketcan:no_such_bus").find("socketcan:no_such_bus"), std::string::npos);
}

TEST(Bus, FourConsecutivePorts) {
  const auto names = consecutive_udp_buses("udp:239.74.163.2:65532");
  EXPECT_EQ(names[0], "udp:239.74.163.2:65532");
  EXPECT_EQ(names[3], "udp:239.74.163.2:65535");
  EXPECT_THROW(consecutive_udp_buses("udp:239.74.163.2:65533"), BusError);
  EXPECT_THROW(consecutive_udp_buses("socketcan:can0"), BusError);
}

TEST(Bus, UdpKeepsOrderAndHearsItself) {
  const auto sender = open_bus(test_bus(0));
  const auto receiver = open_bus(test_bus(0));
  std::array<Frame, 100> sent{};
  for (std::size_t i = 0; i < sent.size(); ++i) {
    sent[i].id = static_cast<std::uint32_t>(i);
    sent[i].length = 8;
    sent[i].data[0] = static_cast<std::uint8_t>(i);
  }
  EXPECT_EQ(sender->send(sent), sent.size());
  for (const auto& bus : {std::cref(receiver), std::cref(sender)}) {
    std::array<Frame, 100> got{};
    ASSERT_EQ(receive_within(bus, got, 2s), got.size());
    for (std::size_t i = 0; i < got.size(); ++i) EXPECT_EQ(got[i].id, i);
  }
  EXPECT_EQ(sender->statistics().sent, 100U);
  EXPECT_EQ(receiver->statistics().received, 100U);
}

TEST(Bus, UdpBusesOfOtherPortsAndGroupsAreSilent) {
  const auto sender = open_bus(test_bus(1));
  const auto other_port = open_bus(test_bus(2));
  std::string name = test_bus(1);
  const auto other_group = open_bus(name.replace(name.find("163.9"), 5, "163.8"));
  const Frame frame;
  sender->send({&frame, 1});
  std::array<Frame, 1> got{};
  EXPECT_EQ(receive_within(other_port, got, 100ms), 0U);
  EXPECT_EQ(receive_within(other_group, got, 100ms), 0U);
}

TEST(Bus, MalformedDatagramsAreCountedAndSkipped) {
  const std::string name = test_bus(3);
  const auto bus = open_bus(name);
  const Descriptor socket(::socket(AF_INET, SOCK_DGRAM, 0));
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(name.substr(name.rfind(':') + 1))));
  ::inet_pton(AF_INET, "239.74.163.9", &to.sin_addr);
  const std::string huge(2000, 'x');
  for (const std::string& bad : {std::string("hello"), std::string("\x8b", 1), huge})
    ASSERT_GT(::sendto(socket.get(), bad.data(), bad.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
  Frame good;
  good.id = 0x181;
  bus->send({&good, 1});
  std::array<Frame, 1> got{};
  ASSERT_EQ(receive_within(bus, got, 2s), 1U);
  EXPECT_EQ(got[0].id, 0x181U);
  EXPECT_EQ(bus->statistics().malformed, 3U);
}

}  // namespace
}  // namespace crux
