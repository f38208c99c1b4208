#include "lcm/operator_server.hpp"

#include <poll.h>

#include <algorithm>
#include <cstdio>

#include "core/hash.hpp"
#include "core/supervisor.hpp"
#include "crux_msgs/cdr.hpp"
#include "lcm/messages.hpp"

namespace crux {
namespace {

using crux_msgs::acknowledgement_t;
using crux_msgs::Channel;
using crux_msgs::channel_info;
using crux_msgs::command_t;
using crux_msgs::plan_piece_t;
using crux_msgs::plan_t;
using crux_msgs::robot_state_t;
using namespace std::chrono_literals;

constexpr auto kRepeatWindow = 3s;  // within it, the same bytes again are a sender that missed the answer
constexpr auto kPollTime = 5ms;
constexpr const char* kTooMany = "too many requests at once";

static_assert(channel_info(Channel::kLimbReference).rate_Hz == channel_info(Channel::kRobotState).rate_Hz &&
                  channel_info(Channel::kLimbTelemetry).rate_Hz == channel_info(Channel::kRobotState).rate_Hz &&
                  channel_info(Channel::kBusHealth).rate_Hz == channel_info(Channel::kRobotState).rate_Hz &&
                  channel_info(Channel::kCycleTiming).rate_Hz == channel_info(Channel::kRobotState).rate_Hz,
              "a snapshot goes out whole");

std::span<const std::uint8_t> bytes_of(const lcm::ReceiveBuffer& buffer) {
  return {static_cast<const std::uint8_t*>(buffer.data), static_cast<std::size_t>(buffer.data_size)};
}

std::unique_ptr<LogEntry> entry_of(const acknowledgement_t& acknowledgement) {
  auto entry = std::make_unique<LogEntry>();
  entry->acknowledgement = acknowledgement;
  return entry;
}

/// A fault that does not end a climb.
bool only_told(std::int16_t code) {
  const crux_msgs::FaultInfo* info = crux_msgs::fault_info(code);
  return info != nullptr && info->to == robot_state_t::CLIMBING;
}

}  // namespace

OperatorServer::OperatorServer(const std::string& url, const RobotDescription& robot, RuntimeExchange& exchange,
                               bool prints)
    : lcm_(url), robot_(robot), exchange_(exchange), prints_(prints) {
  if (!lcm_.good())
    throw LcmError(
        "LCM at '" + url +
        "' cannot be opened; right is for example udpm://239.255.76.67:7667?ttl=0, and multicast needs a route");
  // Functions, not members: g++ 12 with UBSan calls through a pointer to member on a wrong object.
  using Self = OperatorServer*;
  const auto on_piece = [](const lcm::ReceiveBuffer* buffer, const std::string&, Self self) {
    self->on_piece(bytes_of(*buffer));
  };
  const auto on_command = [](const lcm::ReceiveBuffer* buffer, const std::string&, Self self) {
    self->on_command(bytes_of(*buffer));
  };
  lcm_.subscribeFunction<Self>(channel_info(Channel::kPlanPiece).name, on_piece, this);
  lcm_.subscribeFunction<Self>(channel_info(Channel::kCommand).name, on_command, this);
}

void OperatorServer::run(const std::atomic<bool>& ended) {
  while (!ended.load(std::memory_order_acquire)) {
    serve(kPollTime);
    publish_snapshot();
  }
  drain();
}

bool OperatorServer::serve(std::chrono::milliseconds patience) {
  pollfd descriptor{.fd = lcm_.getFileno(), .events = POLLIN, .revents = 0};
  const bool any = ::poll(&descriptor, 1, static_cast<int>(patience.count())) > 0;
  if (any) lcm_.handle();
  drain();
  return any;
}

void OperatorServer::drain() {
  drain_answers();
  drain_faults();
  drain_notices();
}

acknowledgement_t OperatorServer::new_acknowledgement(std::int8_t subject, std::int64_t request_id,
                                                      const std::string& plan_id) const {
  acknowledgement_t acknowledgement{};
  acknowledgement.subject = subject;
  acknowledgement.request_id = request_id;
  acknowledgement.piece = -1;
  acknowledgement.verdict = acknowledgement_t::ACCEPTED;
  acknowledgement.supervisor_state = exchange_.supervisor_state.load(std::memory_order_relaxed);
  acknowledgement.plan_id = plan_id;
  return acknowledgement;
}

void OperatorServer::acknowledge(const acknowledgement_t& acknowledgement) {
  if (acknowledgement.subject == acknowledgement_t::PLAN && acknowledgement.request_id == plan_verdict_.transfer_id)
    plan_verdict_.acknowledgement = acknowledgement;
  if (acknowledgement.subject == acknowledgement_t::COMMAND) last_command_.acknowledgement = acknowledgement;
  publish(Channel::kAcknowledgement, acknowledgement);
}

bool OperatorServer::submit(Request request, std::optional<Pending> pending) {
  Request* slot = exchange_.requests.back();
  if (slot == nullptr) return false;
  request.ticket = next_ticket_++;
  if (pending) pending_.emplace(request.ticket, std::move(*pending));
  *slot = std::move(request);
  exchange_.requests.push();
  return true;
}

/// Sends an acknowledgement that needs no word of the real-time thread, which only logs it.
void OperatorServer::answer_at_once(const acknowledgement_t& acknowledgement, std::optional<command_t> command) {
  acknowledge(acknowledgement);
  Request request;
  request.outcome.verdict = acknowledgement.verdict;
  request.outcome.supervisor_state = acknowledgement.supervisor_state;
  request.entry = entry_of(acknowledgement);
  request.entry->command = std::move(command);
  submit(std::move(request), std::nullopt);
}

// ---- plans

void OperatorServer::on_piece(std::span<const std::uint8_t> bytes) {
  plan_piece_t piece{};
  if (!crux_msgs::decode_lcm(bytes, piece)) return print_malformed(Channel::kPlanPiece, bytes.size(), ++malformed_);
  acknowledgement_t acknowledgement =
      new_acknowledgement(acknowledgement_t::PLAN_PIECE, piece.transfer_id, piece.plan_id);
  acknowledgement.piece = piece.piece;
  if (repeated_after_verdict(piece)) return publish(Channel::kAcknowledgement, acknowledgement);

  acknowledgement.reason = assembly_.take(piece);
  if (!acknowledgement.reason.empty()) acknowledgement.verdict = acknowledgement_t::REFUSED;
  publish(Channel::kAcknowledgement, acknowledgement);
  if (assembly_.complete()) judge_plan(piece.plan_id);
}

/// True when the piece's plan has just been decided; the verdict is then sent once more.
bool OperatorServer::repeated_after_verdict(const plan_piece_t& piece) {
  if (plan_verdict_.transfer_id != piece.transfer_id || Clock::now() - plan_verdict_.at > kRepeatWindow) return false;
  if (plan_verdict_.acknowledgement) publish(Channel::kAcknowledgement, *plan_verdict_.acknowledgement);
  return true;
}

void OperatorServer::refuse_plan(acknowledgement_t acknowledgement, const std::string& reason) {
  acknowledgement.verdict = acknowledgement_t::REFUSED;
  acknowledgement.reason = reason;
  answer_at_once(acknowledgement, std::nullopt);
}

void OperatorServer::judge_plan(const std::string& plan_id) {
  plan_verdict_ = {assembly_.transfer_id(), Clock::now(), std::nullopt};
  const acknowledgement_t acknowledgement =
      new_acknowledgement(acknowledgement_t::PLAN, assembly_.transfer_id(), plan_id);
  plan_t plan{};
  std::unique_ptr<const PreparedPlan> prepared;
  const std::string reason = plan_defect(plan_id, plan, prepared);
  assembly_.clear();
  plan_verdict_.at = Clock::now();
  if (!reason.empty()) return refuse_plan(acknowledgement, reason);

  Request request;
  request.kind = Request::Kind::kPlan;
  request.plan = std::move(prepared);
  request.entry = entry_of(acknowledgement);
  request.entry->plan = plan;
  if (!submit(std::move(request), Pending{acknowledgement, std::move(plan), false}))
    refuse_plan(acknowledgement, kTooMany);
}

/// Everything about an assembled plan that can be judged outside the real-time thread. Empty when it is good.
std::string OperatorServer::plan_defect(const std::string& plan_id, plan_t& plan,
                                        std::unique_ptr<const PreparedPlan>& prepared) {
  if (exchange_.supervisor_state.load(std::memory_order_relaxed) == robot_state_t::CLIMBING)
    return "the robot is climbing; hold it first";
  if (std::ranges::any_of(pending_, [](const auto& item) { return item.second.scheduled; }))
    return "a command is scheduled for the plan that is loaded; HOLD cancels it";
  const std::vector<std::uint8_t> bytes = assembly_.bytes();
  const std::string sha256 = sha256_hex({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  if (sha256 != assembly_.bytes_sha256())
    return "the plan was damaged on the way: its pieces have SHA-256 " + sha256 + ", announced was " +
           assembly_.bytes_sha256();
  if (!crux_msgs::decode_lcm(bytes, plan)) return "the bytes are not a whole plan_t message of this version";
  if (plan.plan_id != plan_id)
    return "the pieces announce plan '" + plan_id + "', the plan itself says '" + plan.plan_id + "'";
  Result<std::unique_ptr<const PreparedPlan>> result = prepare_plan(robot_, plan);
  if (!result) return result.reason();
  prepared = std::move(result.value());
  return "";
}

// ---- commands

void OperatorServer::on_command(std::span<const std::uint8_t> bytes) {
  command_t command{};
  if (!crux_msgs::decode_lcm(bytes, command)) return print_malformed(Channel::kCommand, bytes.size(), ++malformed_);
  acknowledgement_t acknowledgement =
      new_acknowledgement(acknowledgement_t::COMMAND, command.request_id, loaded_plan_id_);
  if (command.command == command_t::STATUS) {
    publish_status(command.request_id);
    return publish(Channel::kAcknowledgement, acknowledgement);
  }
  if (repeated(bytes, command.command)) return;

  acknowledgement.reason = command_defect(command);
  if (!acknowledgement.reason.empty()) {
    acknowledgement.verdict = acknowledgement_t::REFUSED;
    return answer_at_once(acknowledgement, command);
  }
  const bool ends = command.command == command_t::SHUTDOWN || command.command == command_t::FORCE_SHUTDOWN;
  if (ends && command.at_cycle == 0) {
    answer_at_once(acknowledgement, command);
    exchange_.stop.store(true, std::memory_order_release);
    return;
  }
  Request request;
  request.kind = Request::Kind::kCommand;
  request.command = command.command;
  request.value = command.value;
  request.at_cycle = command.at_cycle;
  request.entry = entry_of(acknowledgement);
  request.entry->command = command;
  if (submit(std::move(request), Pending{acknowledgement, std::nullopt, false})) return;
  acknowledgement.verdict = acknowledgement_t::REFUSED;
  acknowledgement.reason = kTooMany;
  acknowledge(acknowledgement);
}

/// True when these bytes came just before: the sender missed the answer, which is sent again if there is one already.
bool OperatorServer::repeated(std::span<const std::uint8_t> bytes, std::int8_t command) {
  const Clock::time_point now = Clock::now();
  const bool same = command != command_t::HOLD && now - last_command_.at < kRepeatWindow &&
                    std::ranges::equal(bytes, last_command_.bytes);
  if (same && last_command_.acknowledgement) publish(Channel::kAcknowledgement, *last_command_.acknowledgement);
  if (!same) last_command_ = {{bytes.begin(), bytes.end()}, now, std::nullopt};
  return same;
}

std::string OperatorServer::command_defect(const command_t& command) const {
  if (command.command < command_t::START || command.command > command_t::SPEED)
    return "command " + std::to_string(command.command) + " is unknown";
  if (command.at_cycle < 0)
    return "at_cycle is " + std::to_string(command.at_cycle) + ", right is 0 for at once or a coming cycle";
  const bool idle = exchange_.supervisor_state.load(std::memory_order_relaxed) == robot_state_t::IDLE;
  if (command.command == command_t::SHUTDOWN && command.at_cycle == 0 && !idle) return kOnTheWall;
  if (command.command != command_t::START && command.command != command_t::STEP) return "";
  if (loaded_plan_id_.empty()) return "no plan is loaded";
  if (command.plan_id != loaded_plan_id_)
    return std::string(command.command == command_t::START ? "START" : "STEP") + " names plan '" + command.plan_id +
           "', loaded is '" + loaded_plan_id_ + "'";
  return "";
}

// ---- what the real-time thread has to tell

void OperatorServer::drain_answers() {
  for (Answer* answer; (answer = exchange_.answers.front()) != nullptr; exchange_.answers.pop()) {
    answer->retired.reset();
    const auto found = pending_.find(answer->ticket);
    if (found == pending_.end()) continue;
    Pending& pending = found->second;
    const bool again = std::exchange(pending.scheduled, answer->scheduled);
    acknowledgement_t& acknowledgement = pending.acknowledgement;
    acknowledgement.verdict = answer->outcome.verdict;
    acknowledgement.supervisor_state = answer->outcome.supervisor_state;
    acknowledgement.reason = in_words(answer->outcome.reason);
    const bool accepted = acknowledgement.verdict == acknowledgement_t::ACCEPTED;
    if (pending.plan && accepted) {
      loaded_plan_id_ = pending.plan->plan_id;
      publish(Channel::kPlan, *pending.plan);
    }
    // A scheduled command was granted when it came in; only a failure in its cycle is news.
    if (!again || !accepted) acknowledge(acknowledgement);
    if (!answer->scheduled) pending_.erase(found);
  }
}

void OperatorServer::drain_faults() {
  for (const crux_msgs::fault_t* fault; (fault = exchange_.faults.front()) != nullptr; exchange_.faults.pop()) {
    if (!only_told(fault->code) || exchange_.fault_code.load(std::memory_order_relaxed) != fault_.code ||
        fault_.code == 0) {
      fault_ = *fault;
      fault_at_ = Clock::now();
    }
    publish(Channel::kFault, *fault);
    if (prints_) print_fault(*fault);
  }
}

void OperatorServer::drain_notices() {
  for (const NodeNotice* notice; (notice = exchange_.notices.front()) != nullptr; exchange_.notices.pop()) {
    if (prints_) print_notice(*notice);
  }
}

void OperatorServer::publish_status(std::int64_t request_id) {
  drain_faults();  // what the control cycle has told must not come after
  if (const NodeStates* states = exchange_.nodes.take()) nodes_ = *states;
  crux_msgs::status_t status{};
  status.request_id = request_id;
  std::ranges::copy(nodes_, std::begin(status.node_state));
  // What is only told is no fault of the control; it is said while none of these stands.
  const std::int16_t standing = exchange_.fault_code.load(std::memory_order_relaxed);
  if (fault_.code != 0 && (standing == fault_.code || (standing == 0 && only_told(fault_.code)))) {
    status.fault = fault_;
    status.fault_age_s = std::chrono::duration<double>(Clock::now() - fault_at_).count();
  }
  take_snapshot();
  if (snapshot_ != nullptr) {
    status.state = snapshot_->state;
    std::ranges::copy(snapshot_->reference, std::begin(status.reference));
    std::ranges::copy(snapshot_->telemetry, std::begin(status.telemetry));
  }
  publish(Channel::kStatus, status);
}

void OperatorServer::take_snapshot() {
  if (const Snapshot* newer = exchange_.snapshot.take()) {
    snapshot_ = newer;
    snapshot_is_new_ = true;
  }
}

void OperatorServer::publish_snapshot() {
  const Clock::time_point now = Clock::now();
  if (now < next_snapshot_) return;
  take_snapshot();
  if (!std::exchange(snapshot_is_new_, false)) return;
  next_snapshot_ = now + std::chrono::duration_cast<Clock::duration>(
                             std::chrono::duration<double>(1.0 / channel_info(Channel::kRobotState).rate_Hz));
  publish(Channel::kRobotState, snapshot_->state);
  for (const auto& reference : snapshot_->reference) publish(Channel::kLimbReference, reference);
  for (const auto& telemetry : snapshot_->telemetry) publish(Channel::kLimbTelemetry, telemetry);
  for (const auto& health : snapshot_->health) publish(Channel::kBusHealth, health);
  publish(Channel::kCycleTiming, snapshot_->timing);
}

}  // namespace crux
