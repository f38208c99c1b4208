// The thread that turns cycle records into telemetry.mcap.
#pragma once

#include <atomic>
#include <chrono>
#include <iterator>
#include <memory>
#include <string>

#include "exchange/cycle_record.hpp"
#include "exchange/spsc_ring.hpp"
#include "telemetry/frame_recorder.hpp"
#include "telemetry/mcap_log.hpp"

namespace crux {

class LogWriter {
 public:
  /// @param log where to write; without one the records are only taken and freed
  /// @param broken set when it can be written no more
  /// @param all_frames the CAN frames of every cycle, not of the seconds around a fault alone
  LogWriter(SpscRing<CycleRecord>& records, std::unique_ptr<McapLog> log, std::atomic<bool>& broken, bool all_frames)
      : records_(records), log_(std::move(log)), broken_(broken), frames_(all_frames) {}

  /// Writes until `ended` is set and the queue is empty, then ends the file. After the first error it goes on taking
  /// records, so that nobody waits for it.
  void run(const std::atomic<bool>& ended);

  /// What the log's last record says of the run. Without one, the program did not end in order. To be called before
  /// `ended` is set.
  void set_end(Metadata end) { end_ = std::move(end); }

  /// What went wrong, empty when all is well. To be read when run() has returned.
  [[nodiscard]] const std::string& error() const noexcept { return error_; }

 private:
  static constexpr std::chrono::milliseconds kFlushPeriod{400};
  static constexpr std::chrono::milliseconds kIdle{2};

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
  std::atomic<bool>& broken_;
  FrameRecorder frames_;
  Metadata end_;
  std::string error_;
};

}  // namespace crux
