// The control cycle: answers of the nodes in, control core, commands out, record to the log. The thread that runs it
// neither allocates nor locks; its system calls are the buses' and, in pace `clock`, the timer's.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>

#include "app/log_watch.hpp"
#include "app/operator_desk.hpp"
#include "bus/bus.hpp"
#include "bus/limb_bus.hpp"
#include "core/control_core.hpp"
#include "exchange/cycle_record.hpp"
#include "exchange/runtime_exchange.hpp"
#include "exchange/spsc_ring.hpp"

namespace crux {

enum class Pace : std::uint8_t {
  kBus,    ///< lockstep: a cycle follows when all nodes have answered the one before
  kClock,  ///< real time: a cycle a period
};

struct CycleOptions {
  Pace pace = Pace::kClock;
  std::chrono::nanoseconds guard_time{};  ///< pace bus: how long to wait for the nodes' answers to a cycle
  CommandFrames commands = CommandFrames::kEachNode;
};

struct CycleReport {
  std::int64_t cycles = 0;
  std::int64_t unanswered = 0;        ///< pace bus: cycles that ran into the guard time
  std::int64_t missed_deadlines = 0;  ///< pace clock: cycles that began more than a period late
  std::int64_t dropped_records = 0;   ///< pace clock: cycles that are not in the log because its queue was full
};

class CycleLoop : private PlanTaker {
 public:
  CycleLoop(const RobotDescription& robot, PerLimb<std::unique_ptr<Bus>> buses, RuntimeExchange& exchange,
            SpscRing<CycleRecord>& records, const CycleOptions& options);

  /// Wakes the nodes and runs cycles until a stop is asked for; then tells the nodes to hold.
  CycleReport run();

  /// In place of run(), where the nodes answer in this very thread: takes what they have answered to the last turn, and
  /// sends the next cycle's frames; before the first cycle, Sync(0). False when it is over.
  bool turn();

  /// Before the first cycle: goes on where `left` says, in the middle of `plan`, once nodes and sensors agree.
  void restore(std::unique_ptr<const PreparedPlan> plan, const crux_msgs::restart_t& left,
               std::unique_ptr<LogEntry> entry);

  /// Serves operators before the first cycle, which serves them itself; true when there was something to serve.
  bool serve();

  /// After the last turn; run() does it by itself.
  CycleReport finish();

  [[nodiscard]] const PerLimb<LimbBus>& limbs() const noexcept { return limbs_; }
  [[nodiscard]] const PerLimb<std::unique_ptr<Bus>>& buses() const noexcept { return buses_; }

 private:
  using Clock = std::chrono::steady_clock;

  Reason take_plan(std::unique_ptr<const PreparedPlan>& plan) noexcept override;

  bool wake_nodes();
  void send_wake_up() noexcept;
  bool hear_first_answers() noexcept;
  void run_by_bus();
  void run_by_clock();

  CycleRecord* begin_cycle() noexcept;
  void renew_core(CycleRecord& record) noexcept;
  bool end_cycle(CycleRecord& record, bool answered) noexcept;
  void compute(CycleRecord& record) noexcept;
  void send(CycleRecord& record) noexcept;
  void report_health(CycleRecord& record) const noexcept;
  void send(std::size_t limb, std::span<const Frame> frames) noexcept;
  void receive() noexcept;
  void hear(std::size_t limb, const Frame& frame, std::int64_t host_ns) noexcept;
  void report_nodes() noexcept;
  bool collect_answers() noexcept;
  [[nodiscard]] bool all_answered() const noexcept;
  void take_command(crux_msgs::control_input_t& input) noexcept;

  CycleRecord* next_record() noexcept;
  void push(CycleRecord& record) noexcept;
  void tell(const crux_msgs::fault_t& fault) noexcept;
  void report_log(CycleResult& result) noexcept;
  void push_events(std::int64_t log_time_ns) noexcept;
  void publish(const CycleRecord& record) noexcept;
  [[nodiscard]] bool stop_asked() const noexcept { return exchange_.stop.load(std::memory_order_acquire); }
  [[nodiscard]] bool done() const noexcept { return hold_cycles_ == 0; }
  [[nodiscard]] std::int64_t cycle_time_ns(std::int64_t cycle) const noexcept { return cycle * period_.count(); }
  void print_silent_nodes() const;

  RobotDescription robot_;
  PerLimb<std::unique_ptr<Bus>> buses_;
  PerLimb<LimbBus> limbs_;
  RuntimeExchange& exchange_;
  SpscRing<CycleRecord>& records_;
  CycleOptions options_;
  std::chrono::nanoseconds period_;
  std::int64_t heartbeat_cycles_;
  std::int64_t identify_cycles_;
  std::int64_t snapshot_cycles_;

  std::unique_ptr<ControlCore> core_;
  OperatorDesk desk_;
  EventList events_;
  std::array<Frame, 64> frames_{};
  FrameTape tape_;                  ///< frames since the last record
  CycleRecord* turning_ = nullptr;  ///< turn(): the cycle whose answers have not been taken yet
  bool awake_ = false;              ///< turn(): all nodes have answered once
  CycleRecord spare_;               ///< pace clock: for a cycle that the log has no room for
  std::int64_t cycle_ = 0;
  std::int64_t logged_cycle_ = 0;
  std::int64_t wait_ns_ = 0;
  std::int64_t late_ns_ = 0;
  std::int16_t host_state_ = -1;  ///< last one sent
  int hold_cycles_;               ///< left once a stop is asked for
  LogWatch log_watch_;
  CycleReport report_;
};

}  // namespace crux
