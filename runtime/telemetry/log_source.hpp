// Where the log's writer gets its files from. A run may have several, one after the other.
#pragma once

#include <cstdint>
#include <memory>

#include "telemetry/mcap_log.hpp"

namespace crux {

/// What a log begins with.
struct LogBeginning {
  std::int64_t cycle = 1;
  bool new_core = true;  ///< the control core knows nothing of the cycles before: the log can be computed again alone
};

class LogSource {
 public:
  LogSource() = default;
  LogSource(const LogSource&) = delete;
  LogSource& operator=(const LogSource&) = delete;
  virtual ~LogSource() = default;

  /// Another log. All are called by the writer's thread, which may wait for the disk.
  /// @throws LogError
  virtual std::unique_ptr<McapLog> open(const LogBeginning& beginning) = 0;

  /// Something has happened in it that is worth keeping: it is no idle log any more.
  virtual void keep(McapLog& log) = 0;

  /// What an idle log may become before another one follows it; 0: there is but one.
  [[nodiscard]] virtual std::uintmax_t part_bytes() const noexcept = 0;
};

}  // namespace crux
