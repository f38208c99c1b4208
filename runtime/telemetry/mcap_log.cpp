#include "telemetry/mcap_log.hpp"

#include "crux_msgs/ros2msg.hpp"
#include "mcap_c.h"

namespace crux {
namespace {

using crux_msgs::Channel;
using crux_msgs::ChannelInfo;
using crux_msgs::kChannels;

constexpr std::uint64_t kChunkBytes = 1 << 20;
constexpr std::size_t kErrorBytes = 256;
constexpr const char* kProfile = "ros2";
constexpr const char* kSchemaEncoding = "ros2msg";
constexpr const char* kMessageEncoding = "cdr";

std::string_view schema_of(const ChannelInfo& info) {
  switch (info.channel) {
    case Channel::kPlanPiece:
      return crux_msgs::Ros2Schema<crux_msgs::plan_piece_t>::kDefinition;
    case Channel::kCommand:
      return crux_msgs::Ros2Schema<crux_msgs::command_t>::kDefinition;
    case Channel::kAcknowledgement:
      return crux_msgs::Ros2Schema<crux_msgs::acknowledgement_t>::kDefinition;
    case Channel::kStatus:
      return crux_msgs::Ros2Schema<crux_msgs::status_t>::kDefinition;
    case Channel::kPlan:
      return crux_msgs::Ros2Schema<crux_msgs::plan_t>::kDefinition;
    case Channel::kRobotState:
      return crux_msgs::Ros2Schema<crux_msgs::robot_state_t>::kDefinition;
    case Channel::kLimbReference:
      return crux_msgs::Ros2Schema<crux_msgs::limb_reference_t>::kDefinition;
    case Channel::kLimbTelemetry:
      return crux_msgs::Ros2Schema<crux_msgs::limb_telemetry_t>::kDefinition;
    case Channel::kControlInput:
      return crux_msgs::Ros2Schema<crux_msgs::control_input_t>::kDefinition;
    case Channel::kControlOutput:
      return crux_msgs::Ros2Schema<crux_msgs::control_output_t>::kDefinition;
    case Channel::kCycleTiming:
      return crux_msgs::Ros2Schema<crux_msgs::cycle_timing_t>::kDefinition;
    case Channel::kBusHealth:
      return crux_msgs::Ros2Schema<crux_msgs::bus_health_t>::kDefinition;
    case Channel::kFault:
      return crux_msgs::Ros2Schema<crux_msgs::fault_t>::kDefinition;
  }
  return {};
}

}  // namespace

void McapLog::Deleter::operator()(McapWriter* writer) const noexcept {
  std::array<char, kErrorBytes> unread{};
  mcap_c_close(writer, unread.data(), unread.size());
}

McapLog::McapLog(const std::string& path) : path_(path) {
  std::array<char, kErrorBytes> error{};
  writer_.reset(mcap_c_open(path.c_str(), kProfile, "crux-runtime", kChunkBytes, error.data(), error.size()));
  if (!writer_) throw LogError("log " + path + ": cannot be created: " + error.data());
  for (std::size_t i = 0; i < kChannels.size(); ++i) {
    const ChannelInfo& info = kChannels[i];
    if (!info.logged) continue;
    const std::string_view text = schema_of(info);
    const std::int32_t schema =
        checked(mcap_c_add_schema(writer_.get(), std::string(info.schema_name).c_str(), kSchemaEncoding,
                                  reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
    ids_[i] = static_cast<std::uint16_t>(checked(mcap_c_add_channel(
        writer_.get(), static_cast<std::uint16_t>(schema), std::string(info.topic).c_str(), kMessageEncoding)));
  }
}

std::int32_t McapLog::checked(std::int32_t result) {
  if (result >= 0) return result;
  std::array<char, kErrorBytes> error{};
  mcap_c_error(writer_.get(), error.data(), error.size());
  throw LogError("log " + path_ + ": cannot be written: " + error.data());
}

void McapLog::write_bytes(Channel channel, std::int64_t log_time_ns, std::size_t size) {
  const auto i = static_cast<std::size_t>(channel);
  checked(mcap_c_write(writer_.get(), ids_[i], sequences_[i]++, static_cast<std::uint64_t>(log_time_ns), buffer_.data(),
                       size));
}

void McapLog::write_metadata(const std::string& name, const Metadata& metadata) {
  std::vector<const char*> keys, values;
  for (const auto& [key, value] : metadata) {
    keys.push_back(key.c_str());
    values.push_back(value.c_str());
  }
  checked(mcap_c_write_metadata(writer_.get(), name.c_str(), keys.data(), values.data(), keys.size()));
}

void McapLog::attach(const std::string& name, const std::string& media_type, const std::string& bytes) {
  checked(mcap_c_attach(writer_.get(), name.c_str(), media_type.c_str(),
                        reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()));
}

void McapLog::flush() { checked(mcap_c_flush(writer_.get())); }

void McapLog::close() {
  std::array<char, kErrorBytes> error{};
  if (writer_ && mcap_c_close(writer_.release(), error.data(), error.size()) != 0)
    throw LogError("log " + path_ + ": cannot be finished: " + error.data());
}

}  // namespace crux
