// The files of a run's logs: their names, which are kept, and which are deleted.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "app/options.hpp"
#include "core/robot/robot_description.hpp"
#include "telemetry/log_source.hpp"

namespace crux {

/// `wanted`, or with a number behind it the first name that is free, which is told; the file is there then, empty.
/// @throws LogError
std::string free_name(const std::string& wanted);

/// Of a robot: a log that cannot be written keeps nobody from his runtime. With `idle_log_bytes` a log is called
/// NAME-N.idle.mcap until it is kept as NAME-N.mcap, and the oldest that are called idle, of earlier runs as well, are
/// deleted where all together would take more. What is kept is never deleted.
class LogFiles : public LogSource {
 public:
  /// Both have to outlive it.
  LogFiles(const Options& options, const RobotDescription& robot) : options_(options), robot_(robot) {}

  std::unique_ptr<McapLog> open(const LogBeginning& beginning) override;
  void keep(McapLog& log) override;
  [[nodiscard]] std::uintmax_t part_bytes() const noexcept override { return options_.idle_log_bytes / kParts; }

 private:
  static constexpr std::uintmax_t kParts = 8;  ///< of what all idle logs may take: the last seven eighths are there

  struct Found {
    std::filesystem::path path;
    std::filesystem::file_time_type written;
    std::uintmax_t bytes = 0;
    int number = 1;
    bool idle = false;
  };

  [[nodiscard]] std::vector<Found> found() const;
  [[nodiscard]] std::filesystem::path name(int number, bool idle) const;
  void make_room(std::vector<Found> found) const;
  std::string next_idle_name();

  const Options& options_;
  const RobotDescription& robot_;
  bool deletes_ = true;  ///< not where a log could not be given the name of one that is kept
};

}  // namespace crux
