// The thread that turns cycle records into telemetry.mcap.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <iterator>
#include <memory>
#include <string>

#include "exchange/cycle_record.hpp"
#include "exchange/spsc_ring.hpp"
#include "telemetry/frame_recorder.hpp"
#include "telemetry/log_source.hpp"
#include "telemetry/mcap_log.hpp"

namespace crux {

class LogWriter {
 public:
  /// Makes a new control core, for a log that is to be computed again from its first cycle.
  using MakeCore = std::function<std::unique_ptr<ControlCore>()>;

  /// @param log where to write; without one the records are only taken and freed
  /// @param broken set while it cannot be written
  /// @param all_frames the CAN frames of every cycle, not of the seconds around a fault alone
  LogWriter(SpscRing<CycleRecord>& records, std::unique_ptr<McapLog> log, std::atomic<bool>& broken, bool all_frames)
      : records_(records), log_(std::move(log)), broken_(broken), frames_(all_frames) {}

  /// Takes logs from `source` where there is none yet, after an error, tried again every kRetryPeriod, and where an
  /// idle one has become long. The next one begins with a core from `make`, once the real-time thread has taken it
  /// from `cores`; where it does not, for the robot is not as new, it goes on from the one before.
  void take_logs_from(LogSource& source, SpscRing<std::unique_ptr<ControlCore>>& cores, MakeCore make) {
    source_ = &source;
    cores_ = &cores;
    make_core_ = std::move(make);
  }

  /// Writes until `ended` is set and the queue is empty, then ends the file. After an error it goes on taking records,
  /// so that nobody waits for it.
  void run(const std::atomic<bool>& ended);

  /// What the log's last record says of the run. Without one, the program did not end in order. To be called before
  /// `ended` is set.
  void set_end(Metadata end) { end_ = std::move(end); }

  /// What went wrong last, empty when all is well. To be read when run() has returned.
  [[nodiscard]] const std::string& error() const noexcept { return error_; }

 private:
  static constexpr std::chrono::milliseconds kFlushPeriod{400};
  static constexpr std::chrono::milliseconds kIdle{2};
  static constexpr std::chrono::seconds kRetryPeriod{5};
  static constexpr std::chrono::seconds kCorePatience{2};    ///< until the real-time thread has taken a new core
  static constexpr std::int64_t kQuiet_ns = 10'000'000'000;  ///< since the last thing worth keeping: it is over
  using Clock = std::chrono::steady_clock;

  void open_if_due();
  void take_all_there_are(bool& idle);
  void take(CycleRecord& record);
  void flush_if_due();
  void follow_if_long();
  void begin(const LogBeginning& beginning);
  [[nodiscard]] bool worth_keeping(const CycleRecord& record) const noexcept;
  void write(CycleRecord& record);
  /// Writes a message of `cycle` when its channel keeps this cycle.
  template <class Message>
  void write_due(crux_msgs::Channel channel, std::int64_t cycle, std::int64_t log_time_ns, const Message& message) {
    if (is_due(channel, cycle)) log_->write(channel, log_time_ns, message);
  }
  /// The same of a channel that has a topic for each limb.
  template <class Messages>
  void write_limbs_due(crux_msgs::Channel channel, std::int64_t cycle, std::int64_t log_time_ns,
                       const Messages& messages) {
    if (!is_due(channel, cycle)) return;
    for (std::size_t limb = 0; limb < std::size(messages); ++limb)
      log_->write(channel, log_time_ns, messages[limb], limb);
  }
  static bool is_due(crux_msgs::Channel channel, std::int64_t cycle) noexcept {
    return (cycle - 1) % crux_msgs::channel_info(channel).log_every == 0;
  }
  void write_event(LoggedEvent& event, std::int64_t log_time_ns);
  void fail(const LogError& error);

  SpscRing<CycleRecord>& records_;
  std::unique_ptr<McapLog> log_;
  LogSource* source_ = nullptr;
  SpscRing<std::unique_ptr<ControlCore>>* cores_ = nullptr;
  MakeCore make_core_;
  bool kept_ = false;                   ///< the log is no idle one
  std::int64_t busy_until_ns_ = 0;      ///< log time of the last thing worth keeping
  std::int64_t last_time_ns_ = 0;       ///< log time of last_cycle_
  Clock::time_point core_asked_until_;  ///< a new core is waited for until then
  bool core_asked_ = false;
  bool idle_ = false;  ///< in last_cycle_, without a plan: the core may be as new
  Clock::time_point next_try_;
  Clock::time_point next_flush_ = Clock::now() + kFlushPeriod;
  std::int64_t last_cycle_ = 0;  ///< that was taken
  std::atomic<bool>& broken_;
  FrameRecorder frames_;
  Metadata end_;
  std::string error_;
};

}  // namespace crux
