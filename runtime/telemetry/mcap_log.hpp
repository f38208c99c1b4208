// telemetry.mcap: messages as CDR with ros2msg schemas, the channels of msgs/channels.yaml that are logged.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/robot/reason.hpp"
#include "crux_msgs/cdr.hpp"
#include "crux_msgs/channels.hpp"

struct McapWriter;

namespace crux {

/// A log that cannot be written; the message names the file and the reason.
class LogError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

using Metadata = std::vector<std::pair<std::string, std::string>>;

class McapLog {
 public:
  /// Creates the file with all schemas and channels.
  /// @throws LogError
  explicit McapLog(const std::string& path);

  [[nodiscard]] const std::string& path() const noexcept { return path_; }
  /// Its file has another name now.
  void renamed(std::string path) noexcept { path_ = std::move(path); }

  /// @param limb of a channel that has a topic for each limb
  template <class Message>
  void write(crux_msgs::Channel channel, std::int64_t log_time_ns, const Message& message, std::size_t limb = 0) {
    const std::size_t size = crux_msgs::cdr_size(message);
    if (buffer_.size() < size) buffer_.resize(size);
    write_bytes(channel, limb, log_time_ns, crux_msgs::encode_cdr(message, buffer_));
  }

  /// @throws LogError as all below
  void write_metadata(const std::string& name, const Metadata& metadata);

  /// A file of its own inside the log.
  void attach(const std::string& name, const std::string& media_type, const std::string& bytes);

  /// Makes what was written so far safe from a kill of this program.
  void flush();

  /// Writes what is left and reports errors; the destructor does so in silence.
  void close();

 private:
  struct Deleter {
    void operator()(McapWriter* writer) const noexcept;
  };

  /// A topic of the log.
  struct Stream {
    std::uint16_t id = 0;
    std::uint32_t sequence = 0;
  };

  void write_bytes(crux_msgs::Channel channel, std::size_t limb, std::int64_t log_time_ns, std::size_t size);
  std::int32_t checked(std::int32_t result);

  std::string path_;
  std::unique_ptr<McapWriter, Deleter> writer_;
  std::array<PerLimb<Stream>, crux_msgs::kChannels.size()> streams_{};
  std::vector<std::uint8_t> buffer_;
};

}  // namespace crux
