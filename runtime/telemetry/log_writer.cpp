#include "telemetry/log_writer.hpp"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <filesystem>
#include <thread>
#include <utility>

#include "crux_msgs/robot_state_t.hpp"

namespace crux {

using crux_msgs::Channel;

void LogWriter::run(const std::atomic<bool>& ended) {
  for (;;) {
    const bool last_round = ended.load(std::memory_order_acquire);
    bool idle = true;
    try {
      open_if_due();
      take_all_there_are(idle);
      flush_if_due();
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

void LogWriter::take_all_there_are(bool& idle) {
  for (CycleRecord* record; (record = records_.front()) != nullptr; records_.pop()) {
    take(*record);
    record->events.clear();
    idle = false;
  }
}

void LogWriter::take(CycleRecord& record) {
  const std::unique_ptr<ControlCore> retired = std::move(record.retired_core);  // once, also where what follows fails
  if (record.has_cycle) {
    last_cycle_ = record.input.cycle;
    last_time_ns_ = record.log_time_ns;
    const crux_msgs::robot_state_t& state = record.result.state;
    idle_ = state.supervisor_state == crux_msgs::robot_state_t::IDLE && state.plan_end_s == 0.0;
  }
  if (retired && source_ != nullptr) begin({.cycle = last_cycle_, .new_core = true});
  if (worth_keeping(record)) {
    busy_until_ns_ = record.log_time_ns + kQuiet_ns;
    if (log_ && source_ != nullptr && !std::exchange(kept_, true)) source_->keep(*log_);
  }
  if (log_) write(record);
}

/// A climb, a plan for one, and what goes wrong while the robot may hang on the wall.
bool LogWriter::worth_keeping(const CycleRecord& record) const noexcept {
  const auto takes_plan = [](const LoggedEvent& event) {
    return event.entry->plan && event.outcome.verdict == crux_msgs::acknowledgement_t::ACCEPTED;
  };
  if (std::any_of(record.events.begin(), record.events.end(), takes_plan)) return true;
  const crux_msgs::robot_state_t& state = record.result.state;
  const bool has_plan = state.plan_end_s > 0.0;
  return record.has_cycle &&
         (state.supervisor_state == crux_msgs::robot_state_t::CLIMBING || (has_plan && record.result.has_fault));
}

void LogWriter::flush_if_due() {
  const auto now = Clock::now();
  if (!log_ || now < next_flush_) return;
  log_->flush();
  next_flush_ = now + kFlushPeriod;
  follow_if_long();
}

/// Asks for a new core first, so that the next log needs none before it; goes on with the old one where that is used.
void LogWriter::follow_if_long() {
  if (source_ == nullptr || source_->part_bytes() == 0 || last_time_ns_ < busy_until_ns_) return;
  std::error_code unknown;
  const std::uintmax_t size = std::filesystem::file_size(log_->path(), unknown);
  if (unknown || size < source_->part_bytes()) return;
  if (idle_ && !std::exchange(core_asked_, true)) {
    core_asked_until_ = Clock::now() + kCorePatience;
    if (std::unique_ptr<ControlCore>* slot = cores_->back()) {  // else the one from before still waits
      *slot = make_core_();
      cores_->push();
    }
  }
  if (!idle_ || Clock::now() >= core_asked_until_) begin({.cycle = last_cycle_ + 1, .new_core = false});
}

void LogWriter::begin(const LogBeginning& beginning) {
  core_asked_ = false;
  kept_ = false;
  if (log_) {
    log_->write_metadata("crux_end", {{"goes_on", "yes"}});
    log_->close();
  }
  log_ = source_->open(beginning);
  next_flush_ = Clock::now() + kFlushPeriod;
}

void LogWriter::open_if_due() {
  if (log_ || source_ == nullptr || Clock::now() < next_try_) return;
  next_try_ = Clock::now() + kRetryPeriod;
  begin({.cycle = last_cycle_ + 1, .new_core = last_cycle_ == 0});
  if (!broken_.exchange(false, std::memory_order_relaxed)) return;
  std::fprintf(stderr, "crux-runtime: there is a log again, %s, from cycle %" PRId64 " on\n", log_->path().c_str(),
               last_cycle_ + 1);
}

void LogWriter::fail(const LogError& error) {
  if (error_ != error.what())  // not every few seconds
    std::fprintf(stderr, "crux-runtime: %s; the control goes on without a log%s\n", error.what(),
                 source_ != nullptr ? ", which is tried again" : "");
  error_ = error.what();
  log_.reset();
  next_try_ = Clock::now() + kRetryPeriod;
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
    if (entry.restart) log_->write(Channel::kRestart, log_time_ns, *entry.restart);
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
