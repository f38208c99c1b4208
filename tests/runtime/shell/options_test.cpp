#include "app/options.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "bus/bus.hpp"

namespace crux {
namespace {

Options parse(std::vector<const char*> arguments) {
  arguments.push_back("--insecure");
  return parse_options(arguments);
}

std::string error_of(const std::vector<const char*>& arguments) {
  try {
    parse(arguments);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

TEST(Options, DefaultsAreFourUdpBusesInRealTime) {
  const Options options = parse({});
  EXPECT_EQ(options.buses[0], "udp:239.74.163.2:43113");
  EXPECT_EQ(options.buses[3], "udp:239.74.163.2:43116");
  EXPECT_EQ(options.cycle.pace, Pace::kClock);
  EXPECT_EQ(options.cycle.commands, CommandFrames::kEachNode);
  EXPECT_TRUE(options.log.empty());
}

TEST(Options, EveryOptionIsRead) {
  const Options options = parse({"--robot", "r", "--pace", "bus", "--guard-time", "0.25", "--lcm",
                                 "udpm://239.1.1.1:1?ttl=0", "--log", "l.mcap", "--bus", "RR=socketcan:can3", "--bus",
                                 "LF=socketcan:can0", "--bus", "RF=socketcan:can1", "--bus", "LR=socketcan:can2"});
  EXPECT_EQ(options.robot, "r");
  EXPECT_EQ(options.cycle.pace, Pace::kBus);
  EXPECT_EQ(options.cycle.guard_time, std::chrono::milliseconds(250));
  EXPECT_EQ(options.lcm_url, "udpm://239.1.1.1:1?ttl=0");
  EXPECT_EQ(options.log, "l.mcap");
  EXPECT_FALSE(options.overwrite);
  for (int l = 0; l < 4; ++l) EXPECT_EQ(options.buses[l], "socketcan:can" + std::to_string(l));
}

TEST(Options, TagsAndSwitchesAreRead) {
  EXPECT_FALSE(parse({}).calibrate);
  const Options options =
      parse({"--overwrite", "--calibrate", "--tag", "seed=7", "--tag", "why=a=b", "--note", "new rubber"});
  EXPECT_TRUE(options.overwrite);
  EXPECT_TRUE(options.calibrate);
  EXPECT_EQ(options.tags, (Metadata{{"seed", "7"}, {"why", "a=b"}, {"note", "new rubber"}}));
}

TEST(Options, WhoMayCommandHasToBeSaid) {
  const auto said = [](const std::vector<const char*>& arguments) -> std::string {
    try {
      return "keys " + parse_options(arguments).keys;
    } catch (const OptionError& error) {
      return error.what();
    }
  };
  EXPECT_EQ(said({"--keys", "file"}), "keys file");
  EXPECT_EQ(said({"--insecure"}), "keys ");
  EXPECT_NE(said({"--insecure", "--pace"}).find("--pace needs a value"), std::string::npos);
  EXPECT_NE(said({}).find("crux key new"), std::string::npos);
  EXPECT_NE(said({"--keys", "file", "--insecure"}).find("one of the two"), std::string::npos);
}

TEST(Options, MistakesAreNamed) {
  EXPECT_NE(error_of({"--tag", "seed"}).find("KEY=VALUE"), std::string::npos);
  EXPECT_NE(error_of({"--speed", "2"}).find("--speed"), std::string::npos);
  EXPECT_EQ(parse({"--commands", "broadcast"}).cycle.commands, CommandFrames::kBroadcast);
  EXPECT_NE(error_of({"--commands", "all"}).find("'all'"), std::string::npos);
  EXPECT_NE(error_of({"--pace", "fast"}).find("'fast'"), std::string::npos);
  EXPECT_NE(error_of({"--guard-time", "-1"}).find("'-1'"), std::string::npos);
  EXPECT_NE(error_of({"--guard-time", "nan"}).find("'nan'"), std::string::npos);
  EXPECT_NE(error_of({"--guard-time", "1s"}).find("'1s'"), std::string::npos);
  EXPECT_NE(error_of({"--idle-logs", "0"}).find("'0'"), std::string::npos);
  EXPECT_NE(error_of({"--idle-logs", "8"}).find("--log"), std::string::npos);
  EXPECT_NE(error_of({"--idle-logs", "8", "--log", "x", "--pace", "bus"}).find("--pace clock"), std::string::npos);
  EXPECT_EQ(parse({"--idle-logs", "8", "--log", "x"}).idle_log_bytes, 8'000'000'000);
  EXPECT_NE(error_of({"--bus", "XX=socketcan:can0"}).find("LF, RF, LR, RR"), std::string::npos);
  EXPECT_NE(error_of({"--bus", "LF=socketcan:can0"}).find("RF has no bus"), std::string::npos);
}

}  // namespace
}  // namespace crux
