// What the LCM thread and the real-time thread hand to each other about an operator's wishes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "core/plan/prepared_plan.hpp"
#include "core/robot/reason.hpp"
#include "crux_msgs/acknowledgement_t.hpp"
#include "crux_msgs/command_t.hpp"
#include "crux_msgs/plan_t.hpp"
#include "crux_msgs/restart_t.hpp"

namespace crux {

/// What the log keeps of a request. The outcome is filled into `acknowledgement` by the telemetry thread.
struct LogEntry {
  std::optional<crux_msgs::plan_t> plan;        ///< logged only when it was accepted
  std::optional<crux_msgs::restart_t> restart;  ///< with a plan that a new run goes on with
  std::optional<crux_msgs::command_t> command;
  crux_msgs::acknowledgement_t acknowledgement;
};

/// How a request ended. `reason` is empty when accepted.
struct Outcome {
  std::int8_t verdict = crux_msgs::acknowledgement_t::ACCEPTED;
  std::int8_t supervisor_state = 0;
  Reason reason;
};

/// LCM thread -> real-time thread. Ownership moves along, so that the real-time thread neither allocates nor frees.
struct Request {
  enum class Kind : std::uint8_t {
    kLogOnly,  ///< already answered; write `entry` into the log here
    kPlan,
    kCommand,
  };
  Kind kind = Kind::kLogOnly;
  std::uint32_t ticket = 0;
  std::int8_t command = crux_msgs::command_t::NONE;
  double value = 0.0;         ///< command_t.value
  std::int64_t at_cycle = 0;  ///< 0: at once
  Outcome outcome;            ///< of kLogOnly
  std::unique_ptr<const PreparedPlan> plan;
  std::unique_ptr<LogEntry> entry;
};

/// Real-time thread -> LCM thread.
struct Answer {
  std::uint32_t ticket = 0;
  bool scheduled = false;  ///< not carried out yet; a second answer follows
  Outcome outcome;
  std::unique_ptr<const PreparedPlan> retired;  ///< a plan nobody reads any more, to be freed
};

struct LoggedEvent {
  std::unique_ptr<LogEntry> entry;
  Outcome outcome;
};

/// The events of one cycle, in order.
class EventList {
 public:
  static constexpr std::size_t kCapacity = 8;

  [[nodiscard]] std::size_t room() const noexcept { return kCapacity - n_; }
  [[nodiscard]] bool empty() const noexcept { return n_ == 0; }
  void add(std::unique_ptr<LogEntry> entry, const Outcome& outcome) noexcept {
    events_[n_].entry = std::move(entry);
    events_[n_].outcome = outcome;
    ++n_;
  }
  LoggedEvent* begin() noexcept { return events_.data(); }
  LoggedEvent* end() noexcept { return events_.data() + n_; }
  [[nodiscard]] const LoggedEvent* begin() const noexcept { return events_.data(); }
  [[nodiscard]] const LoggedEvent* end() const noexcept { return events_.data() + n_; }
  /// Frees the entries: for the telemetry thread.
  void clear() noexcept {
    for (LoggedEvent& event : *this) event.entry.reset();
    n_ = 0;
  }
  /// Moves all events into an empty list.
  void move_to(EventList& other) noexcept {
    for (LoggedEvent& event : *this) other.add(std::move(event.entry), event.outcome);
    n_ = 0;
  }

 private:
  std::array<LoggedEvent, kCapacity> events_{};
  std::size_t n_ = 0;
};

}  // namespace crux
