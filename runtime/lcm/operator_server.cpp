#include "lcm/operator_server.hpp"

#include <poll.h>

#include <algorithm>
#include <cstdio>

#include "core/plan/plan_join.hpp"
#include "core/plan/plan_preparation.hpp"
#include "core/robot/hash.hpp"
#include "core/supervise/supervisor.hpp"
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
constexpr std::size_t kMostForgers = 4096;  // that are remembered
constexpr std::size_t kMostHolding = 256;   // who are told of one HOLD
constexpr int kLoggedRefusals = 10;  // a second: a flood of them fills neither the log nor the way of good requests
constexpr const char* kTooMany = "too many requests at once";
constexpr const char* kUnsigned =
    "it is not signed, and this runtime takes only what an operator has signed (`crux key new` makes a key)";

constexpr std::array kChannels = {Channel::kPlanPiece, Channel::kCommand, Channel::kSigned};

/// What may be HOLD, by its looks.
bool seems_to_hold(Channel channel, std::span<const std::uint8_t> bytes) {
  crux_msgs::signed_t envelope{};
  command_t command{};
  const bool is_signed =
      channel == Channel::kSigned && bytes.size() < FairQueue::kSmall && crux_msgs::decode_lcm(bytes, envelope);
  return (is_signed || channel == Channel::kCommand) &&
         crux_msgs::decode_lcm(is_signed ? std::span<const std::uint8_t>(envelope.data) : bytes, command) &&
         command.command == command_t::HOLD;
}

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
                               CommandGate gate, Identity identity, bool prints)
    : lcm_(url),
      robot_(robot),
      exchange_(exchange),
      gate_(std::move(gate)),
      identity_(std::move(identity)),
      prints_(prints) {
  try {
    if (!lcm_.good()) throw std::runtime_error("no such LCM");
    if (UdpmInbox::serves(url)) inbox_ = std::make_unique<UdpmInbox>(url);
  } catch (const std::runtime_error& error) {
    throw LcmError("LCM at '" + url + "' cannot be opened (" + error.what() +
                   "); right is for example udpm://239.255.76.67:7667?ttl=0, and multicast needs a route");
  }
  if (inbox_) return;  // LCM itself only sends: it receives nothing, and takes no memory for it, without a subscription
  // Functions, not members: g++ 12 with UBSan calls through a pointer to member on a wrong object.
  using Self = OperatorServer*;
  const auto on_message = [](const lcm::ReceiveBuffer* buffer, const std::string& name, Self self) {
    for (const Channel channel : kChannels)
      if (name == channel_info(channel).name) self->on_message(channel, bytes_of(*buffer));
  };
  for (const Channel channel : kChannels) lcm_.subscribeFunction<Self>(channel_info(channel).name, on_message, this);
}

void OperatorServer::keep_plans(std::function<void(const plan_t&)> taken, std::function<void()> refused,
                                std::optional<plan_t> left) {
  plan_taken_ = std::move(taken);
  restart_refused_ = std::move(refused);
  plan_left_ = std::move(left);
}

void OperatorServer::run(const std::atomic<bool>& ended) {
  while (!ended.load(std::memory_order_acquire)) {
    serve(kPollTime);
    publish_snapshot();
  }
  drain();
}

bool OperatorServer::serve(std::chrono::milliseconds patience) {
  bool waiting = !holds_.empty() || !others_.empty() || !doubtful_.empty();
  pollfd descriptor{.fd = inbox_ ? inbox_->fd() : lcm_.getFileno(), .events = POLLIN, .revents = 0};
  bool any = ::poll(&descriptor, 1, waiting ? 0 : static_cast<int>(patience.count())) > 0;
  if (any && !inbox_) lcm_.handle();
  if (any && inbox_)
    inbox_->drain([this](std::uint64_t sender, std::string_view channel, std::span<const std::uint8_t> bytes) {
      put(sender, channel, bytes);
    });
  waiting = !holds_.empty() || !others_.empty() || !doubtful_.empty();
  if (holds_.empty() && others_.empty()) serve_next(doubtful_);
  serve_next(holds_);
  serve_next(others_);
  drain();
  return any || waiting;
}

void OperatorServer::serve_next(FairQueue& queue) {
  const auto next = queue.take();
  if (!next || !on_message(next->channel, next->bytes).forged) return;
  if (forgers_.size() == kMostForgers) forgers_.clear();
  forgers_.insert(next->sender);
}

void OperatorServer::put(std::uint64_t sender, std::string_view name, std::span<const std::uint8_t> bytes) {
  const auto* const channel =
      std::ranges::find_if(kChannels, [name](Channel each) { return name == channel_info(each).name; });
  if (channel == kChannels.end()) return;  // the runtime's own, mostly
  FairQueue& trusted = seems_to_hold(*channel, bytes) ? holds_ : others_;
  (forgers_.contains(sender) ? doubtful_ : trusted).put(sender, *channel, bytes);
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

void OperatorServer::acknowledge(const acknowledgement_t& acknowledgement, const Digest& to) {
  if (acknowledgement.subject == acknowledgement_t::PLAN && acknowledgement.request_id == plan_verdict_.transfer_id)
    plan_verdict_.acknowledgement = acknowledgement;
  if (acknowledgement.subject == acknowledgement_t::COMMAND && acknowledgement.request_id == last_command_.request_id)
    last_command_.acknowledgement = acknowledgement;
  answer(acknowledgement, to);
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
  acknowledge(acknowledgement, serving_);
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

/// Returns why it is refused, where it is.
Denial OperatorServer::on_message(Channel channel, std::span<const std::uint8_t> bytes) {
  const Opened opened = open(channel, bytes);
  if (opened.kind == Opened::Kind::kNothing) {
    print_malformed(channel, bytes.size(), ++malformed_);
    return {};
  }
  serving_ = digest_of(bytes);
  if (opened.denial)
    refuse(opened);
  else if (opened.kind == Opened::Kind::kPiece)
    on_piece(opened.piece);
  else if (opened.kind == Opened::Kind::kCommand)
    on_command(opened.command, opened.bytes);
  else
    on_lease(opened);
  return opened.denial;
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
  acknowledgement_t acknowledgement =
      new_acknowledgement(acknowledgement_t::COMMAND, opened.counter, loaded_plan_.plan_id);
  if (!opened.new_holder.empty()) acknowledgement.reason = "operator '" + opened.new_holder + "' has the lease";
  answer(acknowledgement, serving_, true);
  if (!opened.new_holder.empty()) log(acknowledgement, std::nullopt);
}

/// Says why, to the sender and to the log. No acknowledgement of what was let through is touched.
void OperatorServer::refuse(const Opened& opened) {
  const bool piece = opened.kind == Opened::Kind::kPiece, command = opened.kind == Opened::Kind::kCommand;
  acknowledgement_t acknowledgement =
      new_acknowledgement(piece ? acknowledgement_t::PLAN_PIECE : acknowledgement_t::COMMAND,
                          piece     ? opened.piece.transfer_id
                          : command ? opened.command.request_id
                                    : opened.counter,
                          loaded_plan_.plan_id);
  if (piece) acknowledgement.piece = opened.piece.piece;
  acknowledgement.verdict = acknowledgement_t::REFUSED;
  acknowledgement.reason = opened.denial.reason;
  const bool logged = refusal_is_logged();
  if (logged || !opened.denial.forged) answer(acknowledgement, serving_, opened.denial.stale);
  ++refused_;
  if (prints_) print_refused(acknowledgement.reason, refused_);
  if (!logged) return;
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
  if (repeated_after_verdict(piece)) return answer(acknowledgement, serving_);

  acknowledgement.reason = assembly_.take(piece);
  if (!acknowledgement.reason.empty()) acknowledgement.verdict = acknowledgement_t::REFUSED;
  answer(acknowledgement, serving_);
  if (assembly_.complete()) judge_plan(piece.plan_id);
}

/// True when the piece's plan has just been decided; the verdict is then sent once more.
bool OperatorServer::repeated_after_verdict(const plan_piece_t& piece) {
  if (plan_verdict_.transfer_id != piece.transfer_id || Clock::now() - plan_verdict_.at > kRepeatWindow) return false;
  if (plan_verdict_.acknowledgement) answer(*plan_verdict_.acknowledgement, serving_);
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
  if (!submit(std::move(request), Pending{acknowledgement, {{0, serving_}}, std::move(plan)}))
    refuse_plan(acknowledgement, kTooMany);
}

/// Everything about an assembled plan that can be judged outside the real-time thread. Empty when it is good.
std::string OperatorServer::plan_defect(const std::string& plan_id, plan_t& plan,
                                        std::unique_ptr<const PreparedPlan>& prepared) {
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
  const bool climbing = exchange_.supervisor_state.load(std::memory_order_relaxed) == robot_state_t::CLIMBING;
  const std::string apart = climbing ? join_defect(loaded_plan_, plan) : "";
  if (!apart.empty())
    return "the robot is climbing; hold it first, or go on from a stance of the loaded plan: " + apart;
  Result<std::unique_ptr<const PreparedPlan>> result = prepare_plan(robot_, plan);
  if (!result) return result.reason();
  prepared = std::move(result.value());
  if (climbing) prepared = prepare_joined(loaded_plan_, plan = joined(loaded_plan_, plan));
  return "";
}

// ---- commands

void OperatorServer::on_command(const command_t& command, std::span<const std::uint8_t> bytes) {
  acknowledgement_t acknowledgement =
      new_acknowledgement(acknowledgement_t::COMMAND, command.request_id, loaded_plan_.plan_id);
  if (command.command == command_t::STATUS) return answer(acknowledgement, serving_, true);
  if (repeated(bytes, command) || joins_a_hold(command)) return;

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
  const bool holds = command.command == command_t::HOLD && command.at_cycle == 0;
  if (submit(std::move(request),
             Pending{acknowledgement, {{command.request_id, serving_}}, std::nullopt, false, holds}))
    return;
  acknowledgement.verdict = acknowledgement_t::REFUSED;
  acknowledgement.reason = kTooMany;
  acknowledge(acknowledgement, serving_);
}

/// One HOLD at a time is on its way to the control cycle, however many are sent; its outcome answers them all.
bool OperatorServer::joins_a_hold(const command_t& command) {
  if (command.command != command_t::HOLD || command.at_cycle != 0) return false;
  const auto found = std::ranges::find_if(pending_, [](const auto& each) { return each.second.holds; });
  if (found == pending_.end()) return false;
  std::vector<Asked>& asked = found->second.asked;
  const auto same = [this](const Asked& each) { return each.message == serving_; };
  if (asked.size() < kMostHolding && std::ranges::none_of(asked, same)) asked.push_back({command.request_id, serving_});
  return true;
}

/// True when these bytes came just before: the sender missed the answer, which is sent again if there is one already. A
/// HOLD is carried out each time, and what was sent before it is not by being sent again after it.
bool OperatorServer::repeated(std::span<const std::uint8_t> bytes, const command_t& command) {
  if (command.command == command_t::HOLD) return false;
  const Clock::time_point now = Clock::now();
  const bool same = now - last_command_.at < kRepeatWindow && std::ranges::equal(bytes, last_command_.bytes);
  if (same && last_command_.acknowledgement) answer(*last_command_.acknowledgement, serving_);
  if (!same) last_command_ = {command.request_id, {bytes.begin(), bytes.end()}, now, std::nullopt};
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
  if (loaded_plan_.plan_id.empty()) return "no plan is loaded";
  if (command.plan_id != loaded_plan_.plan_id)
    return std::string(command.command == command_t::START ? "START" : "STEP") + " names plan '" + command.plan_id +
           "', loaded is '" + loaded_plan_.plan_id + "'";
  return "";
}

}  // namespace crux
