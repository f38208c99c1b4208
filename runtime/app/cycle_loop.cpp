#include "app/cycle_loop.hpp"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "bus/bus_health.hpp"
#include "crux_msgs/channels.hpp"

namespace crux {
namespace {

using namespace std::chrono_literals;
using crux_msgs::can_frames_t;
using crux_msgs::command_t;
using crux_msgs::robot_state_t;
using std::chrono::nanoseconds;

constexpr auto kWakeUpPeriod = 50ms;
constexpr auto kServePeriod = 5ms;  // while nodes are silent: requests of operators, and whether a stop is asked for
constexpr auto kSilenceReport = 5s;
constexpr auto kStopPatience = 1s;  // pace bus: for answers after a stop has been asked for
constexpr auto kFullLogPause = 100us;
constexpr double kHeartbeatRate_Hz = 10.0;
constexpr double kIdentifyRate_Hz = 100.0;  // a bus, while it has nodes that have not said who they are
constexpr int kHoldCycles = 10;             // HOLD is sent so often before the program ends: frames may be lost
constexpr std::uint8_t kInReverse = 0x08, kPlanComplete = 0x10;  // in HostHeartbeat.HostState, beside the state

std::int64_t now_ns() { return std::chrono::steady_clock::now().time_since_epoch().count(); }

PerLimb<LimbBus> make_limbs(const RobotDescription& robot, CommandFrames frames) {
  return {LimbBus(0, robot, frames), LimbBus(1, robot, frames), LimbBus(2, robot, frames), LimbBus(3, robot, frames)};
}

}  // namespace

CycleLoop::CycleLoop(const RobotDescription& robot, PerLimb<std::unique_ptr<Bus>> buses, RuntimeExchange& exchange,
                     SpscRing<CycleRecord>& records, const CycleOptions& options)
    : robot_(robot),
      buses_(std::move(buses)),
      limbs_(make_limbs(robot, options.commands)),
      exchange_(exchange),
      records_(records),
      options_(options),
      period_(std::llround(1e9 / robot.can.rate_Hz)),
      heartbeat_cycles_(std::max<std::int64_t>(1, std::llround(robot.can.rate_Hz / kHeartbeatRate_Hz))),
      identify_cycles_(std::max<std::int64_t>(1, std::llround(robot.can.rate_Hz / kIdentifyRate_Hz))),
      snapshot_cycles_(std::max<std::int64_t>(
          1, std::llround(robot.can.rate_Hz / crux_msgs::channel_info(crux_msgs::Channel::kRobotState).rate_Hz))),
      core_(std::make_unique<ControlCore>(robot)),
      desk_(exchange.requests, exchange.answers),
      hold_cycles_(kHoldCycles) {}

Reason CycleLoop::take_plan(std::unique_ptr<const PreparedPlan>& plan) noexcept { return core_->exchange_plan(plan); }

void CycleLoop::restore(std::unique_ptr<const PreparedPlan> plan, const crux_msgs::restart_t& left,
                        std::unique_ptr<LogEntry> entry) {
  core_->exchange_plan(plan);
  core_->restore(left);
  events_.add(std::move(entry), {});
}

CycleReport CycleLoop::run() {
  if (wake_nodes()) {
    if (options_.pace == Pace::kBus)
      run_by_bus();
    else
      run_by_clock();
  }
  return finish();
}

CycleReport CycleLoop::finish() {
  push_events(cycle_time_ns(logged_cycle_));
  desk_.close(static_cast<std::int8_t>(core_->state()), events_);
  push_events(cycle_time_ns(logged_cycle_));
  report_.cycles = cycle_;
  return report_;
}

/// Repeats Sync(0) until every node has answered; false when a stop was asked for first.
bool CycleLoop::wake_nodes() {
  Clock::time_point next_sync = Clock::now();
  Clock::time_point next_report = next_sync + kSilenceReport;
  while (!stop_asked()) {
    const Clock::time_point now = Clock::now();
    if (now >= next_sync) {
      send_wake_up();
      next_sync = now + kWakeUpPeriod;
    }
    if (now >= next_report) {
      print_silent_nodes();
      next_report = Clock::time_point::max();
    }
    wait_readable(buses_, std::min<nanoseconds>(next_sync - now, kServePeriod));
    if (hear_first_answers()) return true;
  }
  return false;
}

void CycleLoop::send_wake_up() noexcept {
  for (std::size_t l = 0; l < limbs_.size(); ++l) send(l, limbs_[l].pack_wake_up());
}

bool CycleLoop::hear_first_answers() noexcept {
  receive();
  report_nodes();
  serve();
  return all_answered();
}

bool CycleLoop::serve() {
  bool any = false;
  for (; cycle_ == 0 && desk_.serve_before_first_cycle(*this, events_); any = true) push_events(0);
  return any;
}

bool CycleLoop::turn() {
  if (!awake_) awake_ = hear_first_answers();
  if (turning_ != nullptr) {
    receive();
    if (!end_cycle(*std::exchange(turning_, nullptr), all_answered())) return false;
  }
  if (done() || (!awake_ && stop_asked())) return false;
  if (awake_)
    turning_ = begin_cycle();
  else
    send_wake_up();
  return true;
}

void CycleLoop::print_silent_nodes() const {
  std::string silent;
  for (const LimbBus& limb : limbs_) {
    for (const int node : limb.silent_nodes())
      silent += (silent.empty() ? "" : ", ") + robot_.limbs[static_cast<std::size_t>(&limb - limbs_.data())].name +
                " " + std::to_string(node);
  }
  std::fprintf(stderr, "crux-runtime: still waiting for these nodes to answer: %s\n", silent.c_str());
}

void CycleLoop::run_by_bus() {
  while (!done()) {
    CycleRecord* record = begin_cycle();
    if (!end_cycle(*record, collect_answers())) return;
  }
}

CycleRecord* CycleLoop::begin_cycle() noexcept {
  CycleRecord* record = next_record();
  if (record != &spare_) renew_core(*record);
  compute(*record);
  send(*record);
  return record;
}

/// So that a log can begin with this cycle and be computed again from there.
void CycleLoop::renew_core(CycleRecord& record) noexcept {
  std::unique_ptr<ControlCore>* made = exchange_.new_cores.front();
  if (made == nullptr || !core_->as_new()) return;
  record.retired_core = std::exchange(core_, std::move(*made));
  exchange_.new_cores.pop();
}

/// A half-answered cycle at the very end depends on when the stop came: it does not belong into the log.
bool CycleLoop::end_cycle(CycleRecord& record, bool answered) noexcept {
  if (!answered && stop_asked()) return false;
  report_.unanswered += answered ? 0 : 1;
  push(record);
  return true;
}

void CycleLoop::run_by_clock() {
  Clock::time_point next = Clock::now() + period_;
  while (!done()) {
    const std::int64_t before_ns = now_ns();
    const nanoseconds since_boot = next.time_since_epoch();
    const timespec at{.tv_sec = since_boot.count() / 1'000'000'000, .tv_nsec = since_boot.count() % 1'000'000'000};
    while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) != 0 && !stop_asked()) {
    }
    const Clock::time_point now = Clock::now();
    late_ns_ = std::max<std::int64_t>(0, nanoseconds(now - next).count());
    wait_ns_ = now.time_since_epoch().count() - before_ns;
    if (now - next > period_) {
      ++report_.missed_deadlines;
      next = now;  // what is lost is lost: no burst of cycles to catch up
    }
    next += period_;
    receive();
    push(*begin_cycle());
  }
}

/// The operator's command of this cycle; once a stop is asked for it is HOLD.
void CycleLoop::take_command(crux_msgs::control_input_t& input) noexcept {
  if (desk_.shutdown()) exchange_.stop.store(true, std::memory_order_release);
  if (stop_asked()) {
    --hold_cycles_;
    input.operator_command = command_t::HOLD;
    input.command_value = 0.0;
    return;
  }
  input.operator_command = desk_.begin_cycle(cycle_, static_cast<std::int8_t>(core_->state()), *this, events_);
  input.command_value = desk_.value();
}

void CycleLoop::compute(CycleRecord& record) noexcept {
  const std::int64_t begin_ns = now_ns();
  if (++cycle_ == 1) tape_.clear();  // what woke the nodes is no cycle's
  record.has_cycle = true;
  record.log_time_ns = cycle_time_ns(cycle_);
  record.input.cycle = cycle_;
  record.input.dt_s = 1.0 / robot_.can.rate_Hz;
  record.input.late_s = 1e-9 * static_cast<double>(late_ns_);
  for (const LimbBus& limb : limbs_) limb.fill(record.input);
  report_health(record);
  take_command(record.input);
  core_->step(record.input, record.result);

  const CycleResult& result = record.result;
  const std::int8_t state = result.state.supervisor_state;
  desk_.end_cycle(state, result.command_refusal, events_);
  exchange_.supervisor_state.store(state, std::memory_order_relaxed);
  exchange_.fault_code.store(result.state.fault_code, std::memory_order_relaxed);
  if (result.has_fault) tell(result.fault);
  Standing& standing = exchange_.standing.slot();
  standing = {.faults = core_->standing(), .joint_dead_time_s = core_->joint_dead_time_s()};
  exchange_.standing.publish();
  report_log(record.result);
  record.timing.cycle = cycle_;
  record.timing.wall_ns = begin_ns;
  record.timing.wait_ns = wait_ns_;
  record.timing.late_ns = late_ns_;
  record.timing.answer_ns = 0;
  for (const LimbBus& limb : limbs_) record.timing.answer_ns = std::max(record.timing.answer_ns, limb.answer_time_ns());
  record.timing.compute_ns = now_ns() - begin_ns;
}

void CycleLoop::tell(const crux_msgs::fault_t& fault) noexcept {
  if (fault.code == static_cast<std::int16_t>(FaultCode::kRestartRefused)) {
    exchange_.restart_refusal.slot() = core_->restart_refusal();
    exchange_.restart_refusal.publish();
  }
  crux_msgs::fault_t* slot = exchange_.faults.back();
  if (slot == nullptr) return;
  *slot = fault;
  exchange_.faults.push();
}

/// A log that is not whole is told; the robot climbs on.
void CycleLoop::report_log(CycleResult& result) noexcept {
  const bool broken = exchange_.log_broken.load(std::memory_order_relaxed);
  const std::int64_t gaps = records_.back() != nullptr ? report_.dropped_records : 0;
  const crux_msgs::fault_t fault = log_watch_.look(cycle_, broken, gaps);
  if (fault.code == 0) return;
  tell(fault);
  if (result.has_fault) return;
  result.has_fault = true;
  result.fault = fault;
}

/// The state of each bus is an input of the core; the counts behind it go out and into the log.
void CycleLoop::report_health(CycleRecord& record) const noexcept {
  for (std::size_t l = 0; l < limbs_.size(); ++l) {
    record.health[l] = bus_health(cycle_, static_cast<int>(l), *buses_[l], limbs_[l]);
    record.input.bus_state[l] = record.health[l].state;
  }
}

void CycleLoop::send(CycleRecord& record) noexcept {
  const std::int64_t begin_ns = now_ns();
  const robot_state_t& state = record.result.state;
  const bool in_reverse = state.supervisor_state == robot_state_t::CLIMBING && state.motion == robot_state_t::REVERSE;
  const auto host_state = static_cast<std::uint8_t>(state.supervisor_state | (in_reverse ? kInReverse : 0) |
                                                    (state.plan_complete != 0 ? kPlanComplete : 0));
  const HostHeartbeat heartbeat{host_state, static_cast<std::uint32_t>(cycle_time_ns(cycle_) / 1'000'000)};
  const bool due = cycle_ % heartbeat_cycles_ == 0 || host_state != host_state_;
  host_state_ = host_state;
  const auto cycle = static_cast<std::uint32_t>(cycle_);
  const bool may_ask = cycle_ % identify_cycles_ == 0;
  for (std::size_t l = 0; l < limbs_.size(); ++l) {
    const bool beat = due || (may_ask && !limbs_[l].identified());
    send(l, limbs_[l].pack_cycle(record.result.output, cycle, beat ? &heartbeat : nullptr));
  }
  report_nodes();
  record.timing.send_ns = now_ns() - begin_ns;
}

void CycleLoop::send(std::size_t limb, std::span<const Frame> frames) noexcept {
  const std::size_t taken = buses_[limb]->send(frames);
  const std::int64_t host_ns = now_ns();
  for (const Frame& frame : frames.first(taken)) tape_.add(static_cast<int>(limb), can_frames_t::SENT, frame, host_ns);
}

void CycleLoop::report_nodes() noexcept {
  NodeStates& states = exchange_.nodes.slot();
  for (std::size_t i = 0; i < states.size(); ++i)
    states[i] = limbs_[i / CRUX_CAN_NODES].node_state(static_cast<std::uint8_t>(i % CRUX_CAN_NODES + 1));
  exchange_.nodes.publish();
}

void CycleLoop::receive() noexcept {
  for (std::size_t l = 0; l < limbs_.size(); ++l) {
    for (std::size_t n = frames_.size(); n == frames_.size();) {
      n = buses_[l]->receive(frames_);
      const std::int64_t host_ns = n > 0 ? now_ns() : 0;
      for (std::size_t i = 0; i < n; ++i) hear(l, frames_[i], host_ns);
    }
  }
}

void CycleLoop::hear(std::size_t limb, const Frame& frame, std::int64_t host_ns) noexcept {
  const bool echo = limbs_[limb].is_echo(frame);
  if (!echo || frame.stamp_ns != 0)
    tape_.add(static_cast<int>(limb), echo ? can_frames_t::ECHO : can_frames_t::RECEIVED, frame, host_ns);
  NodeNotice notice;
  if (!limbs_[limb].take(frame, notice)) return;
  if (NodeNotice* slot = exchange_.notices.back()) {
    *slot = notice;
    exchange_.notices.push();
  }
}

bool CycleLoop::all_answered() const noexcept {
  return std::ranges::all_of(limbs_, [](const LimbBus& limb) { return limb.complete(); });
}

/// Waits until every node has answered the cycle; false after the guard time, or soon after a stop was asked for.
bool CycleLoop::collect_answers() noexcept {
  const Clock::time_point begin = Clock::now();
  Clock::time_point end = begin + options_.guard_time;
  bool answered = false;
  for (bool stopping = false;;) {
    receive();
    answered = all_answered();
    const Clock::time_point now = Clock::now();
    if (!stopping && stop_asked()) {
      stopping = true;
      end = std::min(end, now + kStopPatience);
    }
    if (answered || now >= end) break;
    wait_readable(buses_, std::min<nanoseconds>(end - now, kServePeriod));
  }
  wait_ns_ = nanoseconds(Clock::now() - begin).count();
  return answered;
}

/// A place for the next cycle. In lockstep nothing is lost by waiting for one; in real time the cycle goes unlogged.
CycleRecord* CycleLoop::next_record() noexcept {
  CycleRecord* record = records_.back();
  if (options_.pace == Pace::kClock) return record != nullptr ? record : &spare_;
  for (; record == nullptr; record = records_.back()) {
    const timespec pause{.tv_sec = 0, .tv_nsec = nanoseconds(kFullLogPause).count()};
    ::nanosleep(&pause, nullptr);
  }
  return record;
}

void CycleLoop::push(CycleRecord& record) noexcept {
  publish(record);
  if (&record == &spare_) {
    ++report_.dropped_records;
    return;
  }
  events_.move_to(record.events);
  tape_.move_to(record.frames);
  logged_cycle_ = cycle_;
  records_.push();
}

void CycleLoop::push_events(std::int64_t log_time_ns) noexcept {
  if (events_.empty()) return;
  CycleRecord* record = records_.back();
  if (record == nullptr) return;  // they stay for the next call
  record->has_cycle = false;
  record->log_time_ns = log_time_ns;
  events_.move_to(record->events);
  records_.push();
}

void CycleLoop::publish(const CycleRecord& record) noexcept {
  if (cycle_ % snapshot_cycles_ != 0) return;
  exchange_.restart.slot().cycle = cycle_;
  core_->leave(exchange_.restart.slot().left);
  exchange_.restart.publish();
  Snapshot& snapshot = exchange_.snapshot.slot();
  snapshot.state = record.result.state;
  std::ranges::copy(record.result.reference, snapshot.reference.begin());
  std::ranges::copy(record.result.telemetry, snapshot.telemetry.begin());
  snapshot.health = record.health;
  snapshot.timing = record.timing;
  exchange_.snapshot.publish();
}

}  // namespace crux
