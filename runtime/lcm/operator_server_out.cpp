// What the runtime tells its operators: the answers, faults and notices of the real-time thread, state, status.
#include <algorithm>
#include <utility>

#include "crux_msgs/answer_t.hpp"
#include "crux_msgs/faults.hpp"
#include "lcm/messages.hpp"
#include "lcm/operator_server.hpp"

namespace crux {
namespace {

using crux_msgs::acknowledgement_t;
using crux_msgs::Channel;
using crux_msgs::channel_info;
using crux_msgs::robot_state_t;

static_assert(channel_info(Channel::kLimbReference).rate_Hz == channel_info(Channel::kRobotState).rate_Hz &&
                  channel_info(Channel::kLimbTelemetry).rate_Hz == channel_info(Channel::kRobotState).rate_Hz &&
                  channel_info(Channel::kBusHealth).rate_Hz == channel_info(Channel::kRobotState).rate_Hz &&
                  channel_info(Channel::kCycleTiming).rate_Hz == channel_info(Channel::kRobotState).rate_Hz,
              "a snapshot goes out whole");

/// A fault that does not end a climb.
bool only_told(std::int16_t code) {
  const crux_msgs::FaultInfo* info = crux_msgs::fault_info(code);
  return info != nullptr && info->to == robot_state_t::CLIMBING;
}

bool is(const crux_msgs::fault_t& told, const FaultEvent& fault) {
  return told.code == static_cast<std::int16_t>(fault.code) && told.limb == fault.limb && told.node == fault.node;
}

}  // namespace

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
    if (pending.plan && accepted) take_plan(*pending.plan);
    // A scheduled command was granted when it came in; only a failure in its cycle is news.
    for (const Asked& asked : pending.asked) {
      if (again && accepted) break;
      if (acknowledgement.subject == acknowledgement_t::COMMAND) acknowledgement.request_id = asked.request_id;
      acknowledge(acknowledgement, asked.message);
    }
    if (!answer->scheduled) pending_.erase(found);
  }
}

void OperatorServer::take_plan(const crux_msgs::plan_t& plan) {
  loaded_plan_ = plan;
  publish(Channel::kPlan, plan);
  if (plan_taken_) plan_taken_(plan);
}

/// What the run before left behind has been decided on.
void OperatorServer::end_restart(FaultCode code) {
  if (code == FaultCode::kRestarted && plan_left_) take_plan(*plan_left_);
  if (code == FaultCode::kRestartRefused) {
    const Reason* reason = exchange_.restart_refusal.take();
    if (prints_ && reason != nullptr) print_reason(*reason);
    if (restart_refused_) restart_refused_();
  }
  plan_left_.reset();
}

void OperatorServer::drain_faults() {
  for (const crux_msgs::fault_t* fault; (fault = exchange_.faults.front()) != nullptr; exchange_.faults.pop()) {
    if (only_told(fault->code)) {
      fault_ = *fault;
      fault_at_ = Clock::now();
    }
    std::erase_if(told_, [&](const auto& each) {
      return each.first.code == fault->code && each.first.limb == fault->limb && each.first.node == fault->node;
    });
    if (told_.size() == FaultList::kMost) told_.erase(told_.begin());
    told_.emplace_back(*fault, Clock::now());
    publish(Channel::kFault, *fault);
    if (prints_) print_fault(*fault);
    const auto code = static_cast<FaultCode>(fault->code);
    if (code == FaultCode::kRestarted || code == FaultCode::kRestartRefused) end_restart(code);
  }
}

void OperatorServer::drain_notices() {
  for (const NodeNotice* notice; (notice = exchange_.notices.front()) != nullptr; exchange_.notices.pop()) {
    if (prints_) print_notice(*notice);
  }
}

/// Tells everybody, and signs it for whoever asked.
void OperatorServer::answer(acknowledgement_t acknowledgement, const Digest& to, bool with_status) {
  for (std::string* text : {&acknowledgement.reason, &acknowledgement.plan_id})
    std::ranges::replace_if(*text, [](char c) { return c < ' ' || c > '~'; }, '?');  // of a damaged plan, say
  publish(Channel::kAcknowledgement, acknowledgement);
  crux_msgs::answer_t answer{};
  std::ranges::copy(identity_.key(), std::begin(answer.key));
  std::ranges::copy(to, std::begin(answer.request));
  answer.acknowledgement = std::move(acknowledgement);
  if (with_status) answer.status = {status()};
  answer.n_status = static_cast<std::int32_t>(answer.status.size());
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(answer.getEncodedSize()));
  answer.encode(bytes.data(), 0, answer.getEncodedSize());
  const std::size_t content = bytes.size() - sizeof answer.signature;
  std::ranges::copy(identity_.sign(std::span(bytes).first(content)),
                    bytes.begin() + static_cast<std::ptrdiff_t>(content));
  lcm_.publish(channel_info(Channel::kAnswer).name, bytes.data(), static_cast<unsigned>(bytes.size()));
}

/// What stands beside the fault that leads.
void OperatorServer::add_standing(crux_msgs::status_t& status, Clock::time_point now) {
  if (const Standing* standing = exchange_.standing.take()) standing_ = *standing;
  std::ranges::copy(standing_.joint_dead_time_s, std::begin(status.joint_dead_time_s));
  std::erase_if(told_, [this](const auto& each) {
    return std::ranges::none_of(standing_.faults, [&](const FaultEvent& fault) { return is(each.first, fault); });
  });
  const auto leads_to_fault = [](const auto& each) {
    const crux_msgs::FaultInfo* info = crux_msgs::fault_info(each.first.code);
    return info != nullptr && info->to == robot_state_t::FAULT;
  };
  std::stable_partition(told_.begin(), told_.end(), leads_to_fault);
  for (const auto& [fault, at] : told_) {
    if (fault.code == status.fault.code && fault.limb == status.fault.limb && fault.node == status.fault.node) continue;
    status.beside.push_back(fault);
    status.beside_age_s.push_back(std::chrono::duration<double>(now - at).count());
  }
  status.n_beside = static_cast<std::int32_t>(status.beside.size());
}

crux_msgs::status_t OperatorServer::status() {
  drain_faults();  // what the control cycle has told must not come after
  const bool logs = !exchange_.log_broken.load(std::memory_order_relaxed);
  if (logs && static_cast<FaultCode>(fault_.code) == FaultCode::kLogEnded) fault_ = {};
  if (const NodeStates* states = exchange_.nodes.take()) nodes_ = *states;
  crux_msgs::status_t status{};
  std::ranges::copy(nodes_, std::begin(status.node_state));
  // What is only told is no fault of the control; it is said while none of these stands.
  const std::int16_t leading = exchange_.fault_code.load(std::memory_order_relaxed);
  const auto leads = std::ranges::find_if(told_, [leading](const auto& each) { return each.first.code == leading; });
  if (leading != 0 && leads != told_.end()) {
    status.fault = leads->first;
    status.fault_age_s = std::chrono::duration<double>(Clock::now() - leads->second).count();
  } else if (leading == 0 && fault_.code != 0) {
    status.fault = fault_;
    status.fault_age_s = std::chrono::duration<double>(Clock::now() - fault_at_).count();
  }
  take_snapshot();
  if (snapshot_ != nullptr) {
    status.state = snapshot_->state;
    std::ranges::copy(snapshot_->reference, std::begin(status.reference));
    std::ranges::copy(snapshot_->telemetry, std::begin(status.telemetry));
  }
  const Clock::time_point now = Clock::now();
  add_standing(status, now);
  status.insecure = gate_.insecure() ? 1 : 0;
  status.session = gate_.session();
  status.lease = gate_.lease(now);
  status.lease_holder = gate_.holder(now);
  status.lease_s = gate_.left(now).count();
  return status;
}

void OperatorServer::take_snapshot() {
  if (const Snapshot* newer = exchange_.snapshot.take()) {
    snapshot_ = newer;
    snapshot_is_new_ = true;
    // A restart is over once the robot climbs.
    const auto told = static_cast<FaultCode>(fault_.code);
    const bool of_restart = told == FaultCode::kRestarted || told == FaultCode::kRestartRefused;
    if (of_restart && newer->state.supervisor_state == robot_state_t::CLIMBING) fault_ = {};
  }
}

void OperatorServer::publish_snapshot() {
  const Clock::time_point now = Clock::now();
  if (now < next_snapshot_) return;
  take_snapshot();
  if (!std::exchange(snapshot_is_new_, false)) return;
  next_snapshot_ = now + std::chrono::duration_cast<Clock::duration>(
                             std::chrono::duration<double>(1.0 / channel_info(Channel::kRobotState).rate_Hz));
  service_manager_.goes_on();
  publish(Channel::kRobotState, snapshot_->state);
  for (const auto& reference : snapshot_->reference) publish(Channel::kLimbReference, reference);
  for (const auto& telemetry : snapshot_->telemetry) publish(Channel::kLimbTelemetry, telemetry);
  for (const auto& health : snapshot_->health) publish(Channel::kBusHealth, health);
  publish(Channel::kCycleTiming, snapshot_->timing);
}

}  // namespace crux
