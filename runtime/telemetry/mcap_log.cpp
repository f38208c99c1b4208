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
    const auto [name, text] = crux_msgs::ros2_schema(info.type);
    const auto schema = static_cast<std::uint16_t>(
        checked(mcap_c_add_schema(writer_.get(), std::string(name).c_str(), kSchemaEncoding,
                                  reinterpret_cast<const std::uint8_t*>(text.data()), text.size())));
    for (std::size_t limb = 0; limb < (info.per_limb ? kLimbNames.size() : 1); ++limb) {
      const std::string topic = (info.per_limb ? "/" + std::string(kLimbNames[limb]) : "") + std::string(info.topic);
      streams_[i][limb].id = static_cast<std::uint16_t>(
          checked(mcap_c_add_channel(writer_.get(), schema, topic.c_str(), kMessageEncoding)));
    }
  }
}

std::int32_t McapLog::checked(std::int32_t result) {
  if (result >= 0) return result;
  std::array<char, kErrorBytes> error{};
  mcap_c_error(writer_.get(), error.data(), error.size());
  throw LogError("log " + path_ + ": cannot be written: " + error.data());
}

void McapLog::write_bytes(Channel channel, std::size_t limb, std::int64_t log_time_ns, std::size_t size) {
  Stream& stream = streams_[static_cast<std::size_t>(channel)][limb];
  checked(mcap_c_write(writer_.get(), stream.id, stream.sequence++, static_cast<std::uint64_t>(log_time_ns),
                       buffer_.data(), size));
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
