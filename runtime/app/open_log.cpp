#include "app/open_log.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <limits>

#include "app/log_files.hpp"
#include "app/robot_meshes.hpp"
#include "commit.hpp"

namespace crux {
namespace {

constexpr int kClockReadings = 8;
constexpr const char* kMediaYaml = "application/yaml";
constexpr const char* kMediaUrdf = "application/xml";
constexpr const char* kMediaMesh = "application/octet-stream";
constexpr std::uintmax_t kMostMeshBytes = 64 << 20;  // of all of a robot's; more would make every log as long

std::int64_t now_ns(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return std::int64_t{now.tv_sec} * std::nano::den + now.tv_nsec;
}

/// What to add to CLOCK_MONOTONIC for UTC: the best of some readings, for the program may be interrupted within one.
std::int64_t utc_minus_monotonic_ns() {
  std::int64_t offset = 0, least_gap = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < kClockReadings; ++i) {
    const std::int64_t before = now_ns(CLOCK_MONOTONIC), utc = now_ns(CLOCK_REALTIME);
    const std::int64_t gap = now_ns(CLOCK_MONOTONIC) - before;
    if (gap < least_gap) offset = utc - before - gap / 2;
    least_gap = std::min(gap, least_gap);
  }
  return offset;
}

/// ISO 8601, with microseconds.
std::string utc_text(std::int64_t time_ns) {
  const std::time_t seconds = time_ns / std::nano::den;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  std::array<char, 20> date{};
  std::strftime(date.data(), date.size(), "%FT%T", &utc);
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%s.%06lldZ", date.data(),
                static_cast<long long>(time_ns % std::nano::den / 1000));
  return text.data();
}

std::string host() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

/// Those that pictures of the robot need; what is missing or too much is told, and the log does without.
void attach_meshes(McapLog& log, const std::string& urdf, const std::filesystem::path& folder) {
  std::uintmax_t left = kMostMeshBytes;
  for (const RobotMesh& mesh : meshes_of(urdf, folder)) {
    std::error_code unknown;
    const std::uintmax_t size = std::filesystem::file_size(mesh.path, unknown);
    std::ifstream file(mesh.path, std::ios::binary);
    std::string bytes(unknown || size > left ? 0 : size, '\0');
    if (bytes.empty() || !file.read(bytes.data(), static_cast<std::streamsize>(size))) {
      std::fprintf(stderr, "crux-runtime: the mesh %s is not in the log: %s\n", mesh.path.c_str(),
                   size > left && !unknown ? "with it there were more than 64 MiB of meshes" : "it cannot be read");
      continue;
    }
    log.attach(mesh.name, kMediaMesh, bytes);
    left -= size;
  }
}

}  // namespace

std::string version() { return std::string(CRUX_VERSION " (commit ") + crux_msgs::kCommit + ")"; }

std::unique_ptr<McapLog> begin_log(const std::string& path, const Options& options, const RobotDescription& robot,
                                   const LogBeginning& beginning) {
  auto log = std::make_unique<McapLog>(path);
  log->write_metadata("crux", {{"format", std::to_string(crux_msgs::kLogFormat)},
                               {"version", CRUX_VERSION},
                               {"commit", crux_msgs::kCommit},
                               {"robot", robot.name},
                               {"robot_sha256", robot.sha256},
                               {"first_cycle", std::to_string(beginning.cycle)},
                               {"new_core", beginning.new_core ? "yes" : "no"},
                               {"calibrates", robot.calibrates ? "yes" : "no"},
                               {"pace", options.cycle.pace == Pace::kBus ? "bus" : "clock"},
                               {"started_utc", utc_text(now_ns(CLOCK_REALTIME))},
                               {"utc_minus_monotonic_ns", std::to_string(utc_minus_monotonic_ns())},
                               {"host", host()},
                               {"command_line", options.command_line}});
  if (!options.tags.empty()) log->write_metadata("crux_tags", options.tags);
  log->attach(robot.files[0].first, kMediaYaml, robot.files[0].second);
  log->attach(robot.files[1].first, kMediaUrdf, robot.files[1].second);
  attach_meshes(*log, robot.files[1].second, options.robot);
  log->flush();
  return log;
}

std::unique_ptr<McapLog> open_log(const Options& options, const RobotDescription& robot) {
  return options.log.empty() ? nullptr : LogFiles(options, robot).open({});
}

Metadata end_of(const CycleReport& report) {
  return {{"cycles", std::to_string(report.cycles)},
          {"unanswered", std::to_string(report.unanswered)},
          {"missed_deadlines", std::to_string(report.missed_deadlines)},
          {"dropped_records", std::to_string(report.dropped_records)}};
}

}  // namespace crux
