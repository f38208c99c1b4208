#include "lcm/operator_server.hpp"

#include <poll.h>

#include <algorithm>
#include <cstdio>

#include "core/hash.hpp"
#include "core/supervisor.hpp"
#include "crux_msgs/cdr.hpp"
#include "lcm/messages.hpp"
#include "lcm/this_machine.hpp"

namespace crux {
namespace {

using crux_msgs::acknowledgement_t;
using crux_msgs::channel_info;
using crux_msgs::command_t;
using crux_msgs::plan_piece_t;
using crux_msgs::plan_t;
using crux_msgs::robot_state_t;
using namespace std::chrono_literals;

constexpr auto kRepeatWindow = 3s;  // within it, the same bytes again are a sender that missed the answer
constexpr auto kPollTime = 5ms;
constexpr int kLoggedRefusals = 10;  // a second: a flood of them fills neither the log nor the way of good requests
constexpr const char* kTooMany = "too many requests at once";
constexpr const char* kUnsigned =
    "it is not signed, and this runtime takes only what an operator has signed (`crux key new` makes a key)";

std::span<const std::uint8_t> bytes_of(const lcm::ReceiveBuffer& buffer) {
  return {static_cast<const std::uint8_t*>(buffer.data), static_cast<std::size_t>(buffer.data_size)};
}

std::unique_ptr<LogEntry> entry_of(const acknowledgement_t& acknowledgement) {
  auto entry = std::make_unique<LogEntry>();
  entry->acknowledgement = acknowledgement;
  return entry;
}

}  // namespace

OperatorServer::OperatorServer(const std::string& url, const RobotDescription& robot, RuntimeExchange& exchange,
                               CommandGate gate, bool prints)
    : lcm_(url), robot_(robot), exchange_(exchange), gate_(std::move(gate)), prints_(prints) {
  if (!lcm_.good())
    throw LcmError(
        "LCM at '" + url +
        "' cannot be opened; right is for example udpm://239.255.76.67:7667?ttl=0, and multicast needs a route");
  // Functions, not members: g++ 12 with UBSan calls through a pointer to member on a wrong object.
  using Self = OperatorServer*;
  const auto on_message = [](const lcm::ReceiveBuffer* buffer, const std::string& name, Self self) {
    for (const Channel channel : {Channel::kPlanPiece, Channel::kCommand, Channel::kSigned})
      if (name == channel_info(channel).name) self->on_message(channel, bytes_of(*buffer));
  };
  for (const Channel channel : {Channel::kPlanPiece, Channel::kCommand, Channel::kSigned})
    lcm_.subscribeFunction<Self>(channel_info(channel).name, on_message, this);
  if (const std::string open = hear_only_this_machine(url); !open.empty() && prints_)
    std::fprintf(stderr, "crux-runtime: %s\n", open.c_str());
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
  log(acknowledgement, std::move(command));
}

void OperatorServer::log(const acknowledgement_t& acknowledgement, std::optional<command_t> command) {
  Request request;
  request.outcome.verdict = acknowledgement.verdict;
  request.outcome.supervisor_state = acknowledgement.supervisor_state;
  request.entry = entry_of(acknowledgement);
  request.entry->command = std::move(command);
  submit(std::move(request), std::nullopt);
}

// ---- what comes in

void OperatorServer::on_message(Channel channel, std::span<const std::uint8_t> bytes) {
  const Opened opened = open(channel, bytes);
  if (opened.kind == Opened::Kind::kNothing) return print_malformed(channel, bytes.size(), ++malformed_);
  if (opened.denial) return refuse(opened);
  if (opened.kind == Opened::Kind::kPiece) return on_piece(opened.piece);
  if (opened.kind == Opened::Kind::kCommand) return on_command(opened.command, opened.bytes);
  on_lease(opened);
}

/// What is in a message; one that is not signed is refused but for a question, unless anybody may command.
Opened OperatorServer::open(Channel channel, std::span<const std::uint8_t> bytes) {
  if (channel == Channel::kSigned) return gate_.open(bytes, Clock::now());
  Opened opened;
  if (channel == Channel::kCommand && crux_msgs::decode_lcm(bytes, opened.command))
    opened.kind = Opened::Kind::kCommand;
  else if (channel == Channel::kPlanPiece && crux_msgs::decode_lcm(bytes, opened.piece))
    opened.kind = Opened::Kind::kPiece;
  opened.bytes.assign(bytes.begin(), bytes.end());
  const bool asks = opened.kind == Opened::Kind::kCommand && opened.command.command == command_t::STATUS;
  if (!gate_.insecure() && !asks) opened.denial = {kUnsigned};
  return opened;
}

void OperatorServer::on_lease(const Opened& opened) {
  acknowledgement_t acknowledgement = new_acknowledgement(acknowledgement_t::COMMAND, opened.counter, loaded_plan_id_);
  publish_status(opened.counter);
  if (opened.new_holder.empty()) return publish(Channel::kAcknowledgement, acknowledgement);
  acknowledgement.reason = "operator '" + opened.new_holder + "' has the lease";
  publish(Channel::kAcknowledgement, acknowledgement);
  log(acknowledgement, std::nullopt);
}

/// Says why, to the sender and to the log. No acknowledgement of what was let through is touched.
void OperatorServer::refuse(const Opened& opened) {
  const bool piece = opened.kind == Opened::Kind::kPiece, command = opened.kind == Opened::Kind::kCommand;
  acknowledgement_t acknowledgement =
      new_acknowledgement(piece ? acknowledgement_t::PLAN_PIECE : acknowledgement_t::COMMAND,
                          piece     ? opened.piece.transfer_id
                          : command ? opened.command.request_id
                                    : opened.counter,
                          loaded_plan_id_);
  if (piece) acknowledgement.piece = opened.piece.piece;
  acknowledgement.verdict = acknowledgement_t::REFUSED;
  acknowledgement.reason = opened.denial.reason;
  if (opened.denial.stale) publish_status(acknowledgement.request_id);
  publish(Channel::kAcknowledgement, acknowledgement);
  ++refused_;
  if (prints_) print_refused(acknowledgement.reason, refused_);
  if (!refusal_is_logged()) return;
  log(acknowledgement, command ? std::optional(opened.command) : std::nullopt);
}

bool OperatorServer::refusal_is_logged() {
  const Clock::time_point now = Clock::now();
  if (now - refusals_since_ >= 1s) {
    refusals_since_ = now;
    refusals_logged_ = 0;
  }
  return ++refusals_logged_ <= kLoggedRefusals;
}

// ---- plans

void OperatorServer::on_piece(const plan_piece_t& piece) {
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

void OperatorServer::on_command(const command_t& command, std::span<const std::uint8_t> bytes) {
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

}  // namespace crux
