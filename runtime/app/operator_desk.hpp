// The real-time thread's side of an operator's wishes: at most one command a cycle, scheduled ones exactly in theirs.
#pragma once

#include <array>
#include <cstdint>

#include "exchange/operator_exchange.hpp"
#include "exchange/spsc_ring.hpp"

namespace crux {

/// Takes a plan over at a cycle boundary.
class PlanTaker {
 public:
  virtual ~PlanTaker() = default;
  /// Swaps `plan` with the one in use. Returns why it keeps the old one, empty when it took it.
  virtual Reason take_plan(std::unique_ptr<const PreparedPlan>& plan) noexcept = 0;
};

class OperatorDesk {
 public:
  OperatorDesk(SpscRing<Request>& requests, SpscRing<Answer>& answers) : requests_(requests), answers_(answers) {}

  /// Serves requests while the nodes have not all answered yet: plans are taken, commands scheduled, HOLD is granted,
  /// other commands at once are refused. True when there were any, false too when the list of events is full.
  bool serve_before_first_cycle(PlanTaker& taker, EventList& events) noexcept;

  /// Serves requests and returns the command to carry out in `cycle` (command_t).
  std::int8_t begin_cycle(std::int64_t cycle, std::int8_t supervisor_state, PlanTaker& taker,
                          EventList& events) noexcept;

  /// command_t.value of what begin_cycle() returned.
  [[nodiscard]] double value() const noexcept {
    return current_.command == crux_msgs::command_t::NONE ? 0.0 : current_.value;
  }

  /// Answers the command that begin_cycle() returned. `refused_because`: the control core's reason, empty when it
  /// obeyed.
  void end_cycle(std::int8_t supervisor_state, const Reason& refused_because, EventList& events) noexcept;

  /// Answers everything that is left with a refusal.
  void close(std::int8_t supervisor_state, EventList& events) noexcept;

  /// A SHUTDOWN has been carried out.
  [[nodiscard]] bool shutdown() const noexcept { return shutdown_; }

 private:
  static constexpr std::size_t kMaxScheduled = 4;

  void take(Request& request, std::int64_t cycle, std::int8_t supervisor_state, PlanTaker& taker,
            EventList& events) noexcept;
  void take_plan(Request& request, std::int8_t supervisor_state, PlanTaker& taker, EventList& events) noexcept;
  void schedule(Request& request, std::int64_t cycle, std::int8_t supervisor_state, EventList& events) noexcept;
  void close_request(Request& request, const Outcome& outcome, EventList& events) noexcept;
  void refuse_scheduled(const char* reason, std::int8_t supervisor_state, EventList& events) noexcept;
  void answer(std::uint32_t ticket, bool scheduled, const Outcome& outcome,
              std::unique_ptr<const PreparedPlan> retired = nullptr) noexcept;

  SpscRing<Request>& requests_;
  SpscRing<Answer>& answers_;
  std::array<Request, kMaxScheduled> scheduled_{};
  std::size_t n_scheduled_ = 0;
  Request current_;  ///< the command of this cycle; NONE when there is none
  bool shutdown_ = false;
};

}  // namespace crux
