#include "telemetry/frame_recorder.hpp"

#include <type_traits>
#include <utility>

#include "crux_msgs/faults.hpp"

namespace crux {
namespace {

using crux_msgs::can_frames_t;
using crux_msgs::FaultCode;

/// A log that lags has no room for more.
bool calls_for_frames(const CycleResult& result) {
  const auto code = static_cast<FaultCode>(result.fault.code);
  return result.has_fault && code != FaultCode::kLogGap && code != FaultCode::kLogEnded;
}

void fill(can_frames_t& message, const CycleRecord& record) {
  const auto entries = record.frames.entries();
  message.cycle = record.input.cycle;
  message.lost = static_cast<std::int32_t>(record.frames.lost());
  message.n_frames = static_cast<std::int32_t>(entries.size());
  const auto column = [&](auto& values, auto member) {
    values.clear();
    for (const FrameTape::Entry& entry : entries)
      values.push_back(static_cast<typename std::remove_reference_t<decltype(values)>::value_type>(entry.*member));
  };
  column(message.host_ns, &FrameTape::Entry::host_ns);
  column(message.stamp_ns, &FrameTape::Entry::stamp_ns);
  column(message.id, &FrameTape::Entry::id);
  column(message.bus, &FrameTape::Entry::bus);
  column(message.direction, &FrameTape::Entry::direction);
  column(message.length, &FrameTape::Entry::length);
  message.data.assign(record.frames.data().begin(), record.frames.data().end());
  message.n_bytes = static_cast<std::int32_t>(message.data.size());
}

}  // namespace

void FrameRecorder::write(const Kept& kept, McapLog& log) {
  log.write(crux_msgs::Channel::kCanFrames, kept.log_time_ns, kept.message);
}

void FrameRecorder::take(const CycleRecord& record, McapLog& log) {
  const std::int64_t t = record.log_time_ns;
  Kept kept;
  if (!ring_.empty() && t - ring_.front().log_time_ns > kBeforeFault_ns) {  // the oldest one's memory, for the new one
    kept = std::move(ring_.front());
    ring_.pop_front();
  }
  kept.log_time_ns = t;
  fill(kept.message, record);
  if (calls_for_frames(record.result)) write_until_ns_ = t + kAfterFault_ns;
  if (!every_cycle_ && t > write_until_ns_) {
    ring_.push_back(std::move(kept));
    return;
  }
  for (const Kept& before : ring_) write(before, log);
  ring_.clear();
  write(kept, log);
}

}  // namespace crux
