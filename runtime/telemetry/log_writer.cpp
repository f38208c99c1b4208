#include "telemetry/log_writer.hpp"

#include <cstdio>
#include <thread>

namespace crux {

using crux_msgs::Channel;

void LogWriter::run(const std::atomic<bool>& ended) {
  auto next_flush = std::chrono::steady_clock::now() + kFlushPeriod;
  for (;;) {
    const bool last_round = ended.load(std::memory_order_acquire);
    bool idle = true;
    try {
      for (CycleRecord* record; (record = records_.front()) != nullptr; records_.pop()) {
        if (log_) write(*record);
        record->events.clear();
        idle = false;
      }
      const auto now = std::chrono::steady_clock::now();
      if (log_ && now >= next_flush) {
        log_->flush();
        next_flush = now + kFlushPeriod;
      }
      if (last_round && log_) {
        if (!end_.empty()) log_->write_metadata("crux_end", end_);
        log_->close();
      }
    } catch (const LogError& error) {
      fail(error);
    }
    if (last_round) return;
    if (idle) std::this_thread::sleep_for(kIdle);
  }
}

void LogWriter::fail(const LogError& error) {
  error_ = error.what();
  std::fprintf(stderr, "crux-runtime: %s; the control goes on without a log\n", error_.c_str());
  log_.reset();
  broken_.store(true, std::memory_order_relaxed);
}

void LogWriter::write_event(LoggedEvent& event, std::int64_t log_time_ns) {
  LogEntry& entry = *event.entry;
  entry.acknowledgement.verdict = event.outcome.verdict;
  entry.acknowledgement.supervisor_state = event.outcome.supervisor_state;
  if (entry.acknowledgement.reason.empty()) entry.acknowledgement.reason = in_words(event.outcome.reason);
  if (entry.command) log_->write(Channel::kCommand, log_time_ns, *entry.command);
  if (entry.plan && event.outcome.verdict == crux_msgs::acknowledgement_t::ACCEPTED) {
    log_->write_metadata("crux_plan", {{"plan_id", entry.plan->plan_id},
                                       {"scenario_name", entry.plan->scenario_name},
                                       {"scenario_sha256", entry.plan->scenario_sha256}});
    log_->write(Channel::kPlan, log_time_ns, *entry.plan);
  }
  log_->write(Channel::kAcknowledgement, log_time_ns, entry.acknowledgement);
}

void LogWriter::write(CycleRecord& record) {
  const std::int64_t t = record.log_time_ns;
  for (LoggedEvent& event : record.events) write_event(event, t);
  if (!record.has_cycle) return;
  const CycleResult& result = record.result;
  const std::int64_t cycle = record.input.cycle;
  write_due(Channel::kControlInput, cycle, t, record.input);
  write_due(Channel::kControlOutput, cycle, t, result.output);
  write_due(Channel::kRobotState, cycle, t, result.state);
  write_limbs_due(Channel::kLimbReference, cycle, t, result.reference);
  write_limbs_due(Channel::kLimbTelemetry, cycle, t, result.telemetry);
  write_limbs_due(Channel::kBusHealth, cycle, t, record.health);
  if (result.has_fault) log_->write(Channel::kFault, t, result.fault);
  write_due(Channel::kCycleTiming, cycle, t, record.timing);
  frames_.take(record, *log_);
}

}  // namespace crux
