#include "app/operator_desk.hpp"

#include "crux_msgs/robot_state_t.hpp"

namespace crux {
namespace {

using crux_msgs::acknowledgement_t;
using crux_msgs::command_t;
using crux_msgs::robot_state_t;

constexpr const char* kNotAnswered = "not all nodes have answered yet";
constexpr const char* kPassed = "the cycle it is meant for has passed";
constexpr const char* kTooMany = "too many commands are scheduled already";
constexpr const char* kOvertaken = "another command came in the same cycle";
constexpr const char* kCancelled = "cancelled by HOLD";
constexpr const char* kShuttingDown = "the runtime is shutting down";

Outcome refusal(const Reason& reason, std::int8_t state) { return {acknowledgement_t::REFUSED, state, reason}; }
Outcome refusal(const char* reason, std::int8_t state) { return refusal(Reason{reason}, state); }
Outcome acceptance(std::int8_t state) { return {acknowledgement_t::ACCEPTED, state, {}}; }

}  // namespace

void OperatorDesk::answer(std::uint32_t ticket, bool scheduled, const Outcome& outcome,
                          std::unique_ptr<const PreparedPlan> retired) noexcept {
  // The ring is larger than the ring of requests, and each request has two answers at most: it cannot be full.
  Answer* slot = answers_.back();
  if (slot == nullptr) return;
  slot->ticket = ticket;
  slot->scheduled = scheduled;
  slot->outcome = outcome;
  slot->retired = std::move(retired);
  answers_.push();
}

void OperatorDesk::close_request(Request& request, const Outcome& outcome, EventList& events) noexcept {
  answer(request.ticket, false, outcome, std::move(request.plan));
  events.add(std::move(request.entry), outcome);
}

void OperatorDesk::take_plan(Request& request, std::int8_t supervisor_state, PlanTaker& taker,
                             EventList& events) noexcept {
  const Reason reason = taker.take_plan(request.plan);
  close_request(request, reason ? refusal(reason, supervisor_state) : acceptance(supervisor_state), events);
}

void OperatorDesk::schedule(Request& request, std::int64_t cycle, std::int8_t supervisor_state,
                            EventList& events) noexcept {
  if (request.at_cycle < cycle || n_scheduled_ == kMaxScheduled) {
    close_request(request, refusal(request.at_cycle < cycle ? kPassed : kTooMany, supervisor_state), events);
    return;
  }
  answer(request.ticket, true, acceptance(supervisor_state));
  scheduled_[n_scheduled_++] = std::move(request);
}

void OperatorDesk::refuse_scheduled(const char* reason, std::int8_t supervisor_state, EventList& events) noexcept {
  for (std::size_t i = 0; i < n_scheduled_; ++i)
    close_request(scheduled_[i], refusal(reason, supervisor_state), events);
  n_scheduled_ = 0;
}

void OperatorDesk::take(Request& request, std::int64_t cycle, std::int8_t supervisor_state, PlanTaker& taker,
                        EventList& events) noexcept {
  if (request.kind == Request::Kind::kLogOnly)
    events.add(std::move(request.entry), request.outcome);
  else if (request.kind == Request::Kind::kPlan)
    take_plan(request, supervisor_state, taker, events);
  else if (request.at_cycle > 0)
    schedule(request, cycle, supervisor_state, events);
  else
    current_ = std::move(request);
}

bool OperatorDesk::serve_before_first_cycle(PlanTaker& taker, EventList& events) noexcept {
  bool any = false;
  for (Request* request; events.room() > kMaxScheduled && (request = requests_.front()) != nullptr; requests_.pop()) {
    any = true;
    take(*request, 1, robot_state_t::IDLE, taker, events);
    if (current_.command == command_t::NONE) continue;
    const bool nothing_to_do = current_.command == command_t::HOLD;  // the nodes hold until they are told otherwise
    if (nothing_to_do) refuse_scheduled(kCancelled, robot_state_t::IDLE, events);
    close_request(current_,
                  nothing_to_do ? acceptance(robot_state_t::IDLE) : refusal(kNotAnswered, robot_state_t::IDLE), events);
    current_.command = command_t::NONE;
  }
  return any;
}

std::int8_t OperatorDesk::begin_cycle(std::int64_t cycle, std::int8_t supervisor_state, PlanTaker& taker,
                                      EventList& events) noexcept {
  // Beside what is taken here a cycle may add all scheduled commands and one at once.
  while (current_.command == command_t::NONE && events.room() > kMaxScheduled + 1) {
    Request* request = requests_.front();
    if (request == nullptr) break;
    take(*request, cycle, supervisor_state, taker, events);
    requests_.pop();
  }
  if (current_.command == command_t::HOLD) refuse_scheduled(kCancelled, supervisor_state, events);
  for (std::size_t i = 0; i < n_scheduled_;) {
    if (scheduled_[i].at_cycle != cycle) {
      ++i;
      continue;
    }
    if (current_.command != command_t::NONE) close_request(current_, refusal(kOvertaken, supervisor_state), events);
    current_ = std::move(scheduled_[i]);
    for (std::size_t j = i + 1; j < n_scheduled_; ++j) scheduled_[j - 1] = std::move(scheduled_[j]);
    --n_scheduled_;
  }
  return current_.command;
}

void OperatorDesk::end_cycle(std::int8_t supervisor_state, const Reason& refused_because, EventList& events) noexcept {
  if (current_.command == command_t::NONE) return;
  const bool accepted = !refused_because;
  const bool ends = current_.command == command_t::SHUTDOWN || current_.command == command_t::FORCE_SHUTDOWN;
  if (accepted && ends) shutdown_ = true;
  close_request(current_, accepted ? acceptance(supervisor_state) : refusal(refused_because, supervisor_state), events);
  current_.command = command_t::NONE;
}

void OperatorDesk::close(std::int8_t supervisor_state, EventList& events) noexcept {
  refuse_scheduled(kShuttingDown, supervisor_state, events);
  for (Request* request; events.room() > 0 && (request = requests_.front()) != nullptr; requests_.pop()) {
    if (request->kind == Request::Kind::kLogOnly)
      events.add(std::move(request->entry), request->outcome);
    else
      close_request(*request, refusal(kShuttingDown, supervisor_state), events);
  }
}

}  // namespace crux
