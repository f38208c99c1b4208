#include "app/log_files.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "app/open_log.hpp"

namespace crux {
namespace {

constexpr int kMostNames = 100'000;
constexpr std::string_view kIdle = ".idle";

/// Creates an empty file; false when there is one already.
bool create_new(const std::string& path) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file >= 0) close(file);
  if (file < 0 && errno != EEXIST) throw LogError("log " + path + ": cannot be created: " + std::strerror(errno));
  return file >= 0;
}

std::filesystem::path numbered(const std::filesystem::path& wanted, int number, std::string_view more) {
  std::filesystem::path path = wanted;
  path.replace_filename(wanted.stem().string() + (number > 1 ? "-" + std::to_string(number) : "") + std::string(more) +
                        wanted.extension().string());
  return path;
}

}  // namespace

std::string free_name(const std::string& wanted) {
  if (create_new(wanted)) return wanted;
  for (int n = 2; n < kMostNames; ++n) {
    const std::filesystem::path path = numbered(wanted, n, "");
    if (!create_new(path)) continue;
    std::fprintf(stderr, "crux-runtime: %s is there already and stays as it is; this log is %s\n", wanted.c_str(),
                 path.c_str());
    return path;
  }
  throw LogError("log " + wanted + ": is there already, and so are all names with a number behind it");
}

std::unique_ptr<McapLog> LogFiles::open(const LogBeginning& beginning) {
  std::error_code unknown;  // what cannot be looked at cannot be created either
  if (std::filesystem::exists(options_.log, unknown) && !std::filesystem::is_regular_file(options_.log, unknown))
    throw LogError("log " + options_.log + ": is no file that a log can be written to");
  if (options_.overwrite && beginning.cycle == 1) return begin_log(options_.log, options_, robot_, beginning);
  const std::string path = options_.idle_log_bytes > 0 ? next_idle_name() : free_name(options_.log);
  try {
    return begin_log(path, options_, robot_, beginning);
  } catch (const LogError&) {
    std::filesystem::remove(path, unknown);  // or every try would leave one
    throw;
  }
}

std::filesystem::path LogFiles::name(int number, bool idle) const {
  return numbered(options_.log, number, idle ? kIdle : std::string_view());
}

/// A number that no log has yet: those that are deleted leave none behind.
std::string LogFiles::next_idle_name() {
  std::vector<Found> there = found();
  int number = 1;
  for (const Found& each : there) number = std::max(number, each.number + 1);
  if (deletes_) make_room(std::move(there));
  for (; number < kMostNames; ++number)
    if (std::string path = name(number, true); create_new(path)) return path;
  throw LogError("log " + options_.log + ": all names with a number behind it are taken");
}

std::vector<LogFiles::Found> LogFiles::found() const {
  const std::filesystem::path wanted = std::filesystem::path(options_.log);
  const std::string stem = wanted.stem().string(), extension = wanted.extension().string();
  std::vector<Found> logs;
  std::error_code unknown;  // a folder that cannot be read has no logs to delete
  std::filesystem::directory_iterator entries(wanted.has_parent_path() ? wanted.parent_path() : ".", unknown);
  for (; !unknown && entries != std::filesystem::directory_iterator(); entries.increment(unknown)) {
    const std::string file = entries->path().filename().string();
    std::string_view middle = file;
    if (!middle.starts_with(stem) || !middle.ends_with(extension) || file.size() < stem.size() + extension.size())
      continue;
    middle = middle.substr(stem.size(), file.size() - stem.size() - extension.size());
    Found log{.path = entries->path(), .written = {}, .idle = middle.ends_with(kIdle)};
    if (log.idle) middle.remove_suffix(kIdle.size());
    if (middle.starts_with('-')) {
      const auto [end, wrong] = std::from_chars(middle.data() + 1, middle.data() + middle.size(), log.number);
      if (wrong != std::errc{} || end != middle.data() + middle.size() || log.number >= kMostNames) continue;
    } else if (!middle.empty()) {
      continue;
    }
    std::error_code gone;
    if (!std::filesystem::is_regular_file(entries->symlink_status(gone)) || gone) continue;
    log.written = entries->last_write_time(gone);
    log.bytes = entries->file_size(gone);
    if (!gone) logs.push_back(std::move(log));
  }
  return logs;
}

/// For another idle log beside those that there are.
void LogFiles::make_room(std::vector<Found> found) const {
  std::erase_if(found, [](const Found& log) { return !log.idle; });
  std::ranges::sort(found, {}, &Found::written);
  std::uintmax_t bytes = part_bytes();
  for (const Found& log : found) bytes += log.bytes;
  for (const Found& log : found) {
    if (bytes <= options_.idle_log_bytes) return;
    std::error_code unknown;
    if (std::filesystem::remove(log.path, unknown)) bytes -= log.bytes;
  }
}

void LogFiles::keep(McapLog& log) {
  std::string path = log.path();
  const std::size_t idle = path.rfind(kIdle);
  if (options_.idle_log_bytes == 0 || idle == std::string::npos) return;
  path.erase(idle, kIdle.size());
  if (::renameat2(AT_FDCWD, log.path().c_str(), AT_FDCWD, path.c_str(), RENAME_NOREPLACE) == 0) {
    std::fprintf(stderr, "crux-runtime: this climb's log is %s\n", path.c_str());
    return log.renamed(std::move(path));
  }
  std::fprintf(stderr, "crux-runtime: log %s: cannot be called %s: %s; no idle log is deleted from now on\n",
               log.path().c_str(), path.c_str(), std::strerror(errno));
  deletes_ = false;
}

}  // namespace crux
