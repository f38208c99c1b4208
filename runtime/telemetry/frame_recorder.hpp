// CAN frames into the log: of every cycle where that was asked for, else of the seconds around a fault.
#pragma once

#include <cstdint>
#include <deque>

#include "crux_msgs/can_frames_t.hpp"
#include "exchange/cycle_record.hpp"
#include "telemetry/mcap_log.hpp"

namespace crux {

class FrameRecorder {
 public:
  static constexpr std::int64_t kBeforeFault_ns = 2'000'000'000, kAfterFault_ns = 1'000'000'000;

  explicit FrameRecorder(bool every_cycle) : every_cycle_(every_cycle) {}

  /// Takes the frames of a cycle. They are written at once, or kept for a fault that may come.
  /// @throws LogError
  void take(const CycleRecord& record, McapLog& log);

 private:
  struct Kept {
    std::int64_t log_time_ns = 0;
    crux_msgs::can_frames_t message;
  };

  static void write(const Kept& kept, McapLog& log);

  bool every_cycle_;
  std::int64_t write_until_ns_ = -1;
  std::deque<Kept> ring_;
};

}  // namespace crux
