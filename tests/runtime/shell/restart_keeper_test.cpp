// The files that a run leaves behind: whole or not there, and believed only by the robot and plan that they are of.
#include "app/restart_keeper.hpp"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "fixture.hpp"

namespace crux {
namespace {

namespace fs = std::filesystem;
using crux_test::robot;
using crux_test::sample_plan;

class KeeperTest : public testing::Test {
 protected:
  KeeperTest() : folder_(fs::temp_directory_path() / ("crux-keeper-" + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
  }
  ~KeeperTest() override { fs::remove_all(folder_); }

  RestartKeeper keeper() { return {folder_.string(), robot(), exchange_}; }

  /// A plan and, of plan `plan_id`, the interval in which the robot hangs.
  void leave(RestartKeeper& keeper, const std::string& plan_id, int interval) {
    keeper.take_plan(sample_plan());
    RestartPoint& point = exchange_.restart.slot();
    point.left.plan_id = plan_id;
    point.left.interval = interval;
    point.cycle = 100 * interval;
    exchange_.restart.publish();
    keeper.keep();
  }

  std::string trouble_of(const RestartKeeper& keeper) {
    std::string trouble;
    EXPECT_FALSE(keeper.find(trouble).has_value());
    return trouble;
  }

  std::string bytes_of(const char* name) {
    std::ifstream file(folder_ / name, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }

  fs::path folder_;
  RuntimeExchange exchange_;
};

TEST_F(KeeperTest, TheNextRunFindsIt) {
  RestartKeeper first = keeper();
  EXPECT_EQ(trouble_of(first), "");  // there is nothing yet, which is no trouble
  leave(first, sample_plan().plan_id, 1);
  leave(first, sample_plan().plan_id, 4);
  std::string trouble;
  const auto left = keeper().find(trouble);
  ASSERT_TRUE(left.has_value()) << trouble;
  EXPECT_EQ(left->point.interval, 4);
  EXPECT_EQ(left->prepared->plan_id, sample_plan().plan_id);
}

TEST_F(KeeperTest, APointOfAnotherPlanIsNotKept) {
  RestartKeeper first = keeper();
  leave(first, std::string(RestartPoint::kPlanId, '0'), 4);
  EXPECT_EQ(trouble_of(keeper()), "");
}

TEST_F(KeeperTest, EveryDamageIsSeen) {
  RestartKeeper first = keeper();
  leave(first, sample_plan().plan_id, 4);
  for (const char* name : {"point", "plan"}) {
    const std::string whole = bytes_of(name);
    for (const std::size_t at : {std::size_t{0}, std::size_t{40}, whole.size() / 2, whole.size() - 1}) {
      std::string damaged = whole;
      damaged[at] = static_cast<char>(damaged[at] ^ 1);
      std::ofstream(folder_ / name, std::ios::binary) << damaged;
      EXPECT_NE(trouble_of(keeper()).find(name), std::string::npos) << at;
      std::ofstream(folder_ / name, std::ios::binary) << whole.substr(0, at);
      EXPECT_NE(trouble_of(keeper()).find(name), std::string::npos) << at;
    }
    std::ofstream(folder_ / name, std::ios::binary) << whole;
  }
  std::string trouble;
  EXPECT_TRUE(keeper().find(trouble).has_value()) << trouble;
}

TEST_F(KeeperTest, AnotherRobotsIsRefused) {
  RobotDescription other = robot();
  other.sha256 = std::string(64, 'f');
  RestartKeeper first(folder_.string(), other, exchange_);
  leave(first, sample_plan().plan_id, 4);
  EXPECT_NE(trouble_of(keeper()).find("another robot description"), std::string::npos);
}

TEST_F(KeeperTest, WhatTheRobotBeliesIsNotFoundAgain) {
  RestartKeeper first = keeper();
  leave(first, sample_plan().plan_id, 4);
  first.retire();
  EXPECT_EQ(trouble_of(keeper()), "");
  EXPECT_TRUE(fs::exists(folder_ / "point.refused"));
}

}  // namespace
}  // namespace crux
