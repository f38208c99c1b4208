#include <gtest/gtest.h>

#include <set>

#include "crux_msgs/channels.hpp"
#include "crux_msgs/faults.hpp"
#include "crux_msgs/ros2msg.hpp"

namespace {

TEST(Tables, EveryChannelHasASchemaOfItsOwnType) {
  std::set<std::string_view> topics;
  for (const crux_msgs::ChannelInfo& channel : crux_msgs::kChannels) {
    EXPECT_EQ(&crux_msgs::channel_info(channel.channel), &channel);
    EXPECT_EQ(crux_msgs::ros2_schema(channel.type).name, channel.schema_name);
    EXPECT_FALSE(crux_msgs::ros2_schema(channel.type).definition.empty());
    EXPECT_EQ(channel.logged, !channel.topic.empty());
    EXPECT_FALSE(channel.topic.starts_with("/truth")) << "the simulation's alone";
    if (channel.logged) {
      EXPECT_TRUE(topics.insert(channel.topic).second) << channel.topic;
    }
  }
  EXPECT_TRUE(crux_msgs::ros2_schema("no_such_t").name.empty());
}

TEST(Tables, FaultsAreFoundByTheirCode) {
  for (const crux_msgs::FaultInfo& fault : crux_msgs::kFaults) {
    EXPECT_EQ(crux_msgs::fault_info(static_cast<std::int16_t>(fault.code)), &fault);
  }
  EXPECT_EQ(crux_msgs::fault_info(0), nullptr);
  EXPECT_EQ(crux_msgs::fault_info(-1), nullptr);
  EXPECT_EQ(crux_msgs::fault_info(static_cast<std::int16_t>(crux_msgs::kFaults.size() + 1)), nullptr);
}

}  // namespace
