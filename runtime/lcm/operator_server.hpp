// The runtime's face to its operators: plans and commands in, acknowledgements, state and faults out. Runs in a thread
// of its own; whatever comes in over LCM is taken for hostile until it has been checked.
#pragma once

#include <chrono>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <unordered_set>

#include "core/robot/robot_description.hpp"
#include "crux_msgs/acknowledgement_t.hpp"
#include "crux_msgs/channels.hpp"
#include "crux_msgs/command_t.hpp"
#include "crux_msgs/plan_t.hpp"
#include "exchange/runtime_exchange.hpp"
#include "lcm/command_gate.hpp"
#include "lcm/fair_queue.hpp"
#include "lcm/identity.hpp"
#include "lcm/plan_assembly.hpp"
#include "lcm/service_manager.hpp"
#include "lcm/udpm_inbox.hpp"

namespace crux {

/// LCM cannot be opened; the message names the URL.
class LcmError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class OperatorServer {
 public:
  /// @param gate who may command
  /// @param identity signs the answers
  /// @param prints faults and notices, on standard error
  /// @throws LcmError
  OperatorServer(const std::string& url, const RobotDescription& robot, RuntimeExchange& exchange, CommandGate gate,
                 Identity identity, bool prints = true);

  /// Serves until `ended` is set, then sends what is left to send.
  void run(const std::atomic<bool>& ended);

  /// Waits so long for a message at the most, and hands on what there is; false when nothing came in.
  bool serve(std::chrono::milliseconds patience);

  /// Before run(). `taken` hears of every plan that is taken over, `refused` that a restart is. `left`: a plan that the
  /// control core may go on with.
  void keep_plans(std::function<void(const crux_msgs::plan_t&)> taken, std::function<void()> refused,
                  std::optional<crux_msgs::plan_t> left);

  /// For operators in the same process, where the URL is memq://.
  [[nodiscard]] lcm::LCM& link() noexcept { return lcm_; }

 private:
  using Clock = std::chrono::steady_clock;
  using Channel = crux_msgs::Channel;

  using Digest = std::array<std::uint8_t, 32>;

  /// Who wants to know, by what he has sent.
  struct Asked {
    std::int64_t request_id = 0;
    Digest message{};
  };
  /// A request the real-time thread has not answered yet.
  struct Pending {
    crux_msgs::acknowledgement_t acknowledgement;
    std::vector<Asked> asked;
    std::optional<crux_msgs::plan_t> plan;
    bool scheduled = false;
    bool holds = false;
  };
  /// The last plan's verdict, for pieces that are sent again because its acknowledgement was lost.
  struct PlanVerdict {
    std::int64_t transfer_id = 0;
    Clock::time_point at;
    std::optional<crux_msgs::acknowledgement_t> acknowledgement;  ///< none while it is being decided
  };
  struct LastCommand {  // but HOLD
    std::int64_t request_id = 0;
    std::vector<std::uint8_t> bytes;
    Clock::time_point at;
    std::optional<crux_msgs::acknowledgement_t> acknowledgement;
  };

  void put(std::uint64_t sender, std::string_view channel, std::span<const std::uint8_t> bytes);
  void serve_next(FairQueue& queue);
  Denial on_message(Channel channel, std::span<const std::uint8_t> bytes);
  void on_piece(const crux_msgs::plan_piece_t& piece);
  void on_command(const crux_msgs::command_t& command, std::span<const std::uint8_t> bytes);
  Opened open(Channel channel, std::span<const std::uint8_t> bytes);
  void on_lease(const Opened& opened);
  void refuse(const Opened& opened);
  bool refusal_is_logged();

  bool repeated_after_verdict(const crux_msgs::plan_piece_t& piece);
  void judge_plan(const std::string& plan_id);
  std::string plan_defect(const std::string& plan_id, crux_msgs::plan_t& plan,
                          std::unique_ptr<const PreparedPlan>& prepared);
  bool repeated(std::span<const std::uint8_t> bytes, const crux_msgs::command_t& command);
  std::string command_defect(const crux_msgs::command_t& command) const;

  /// Hands a request to the real-time thread; false when it has too many already.
  bool submit(Request request, std::optional<Pending> pending);
  void log(const crux_msgs::acknowledgement_t& acknowledgement, std::optional<crux_msgs::command_t> command);
  void answer_at_once(const crux_msgs::acknowledgement_t& acknowledgement, std::optional<crux_msgs::command_t> command);
  void refuse_plan(crux_msgs::acknowledgement_t acknowledgement, const std::string& reason);
  crux_msgs::acknowledgement_t new_acknowledgement(std::int8_t subject, std::int64_t request_id,
                                                   const std::string& plan_id) const;
  void acknowledge(const crux_msgs::acknowledgement_t& acknowledgement, const Digest& to);
  void answer(crux_msgs::acknowledgement_t acknowledgement, const Digest& to, bool with_status = false);
  bool joins_a_hold(const crux_msgs::command_t& command);

  void take_plan(const crux_msgs::plan_t& plan);
  void end_restart(FaultCode code);
  void drain();
  void drain_answers();
  void drain_faults();
  void drain_notices();
  void take_snapshot();
  void publish_snapshot();
  crux_msgs::status_t status();
  void add_standing(crux_msgs::status_t& status, Clock::time_point now);

  template <class Message>
  void publish(Channel channel, const Message& message) {
    lcm_.publish(crux_msgs::channel_info(channel).name, &message);
  }

  lcm::LCM lcm_;
  const RobotDescription& robot_;
  RuntimeExchange& exchange_;
  CommandGate gate_;
  Identity identity_;
  bool prints_;
  std::unique_ptr<UdpmInbox> inbox_;  ///< none where LCM's URL is not udpm://
  FairQueue holds_, others_;          ///< what may be HOLD has a turn of its own
  FairQueue doubtful_;                ///< of those who have sent something forged: when nothing else waits
  std::unordered_set<std::uint64_t> forgers_;
  Digest serving_{};  ///< of the message that is being served
  ServiceManager service_manager_;
  PlanAssembly assembly_;
  PlanVerdict plan_verdict_;
  LastCommand last_command_;
  crux_msgs::plan_t loaded_plan_{};  ///< the one that was taken last
  std::function<void(const crux_msgs::plan_t&)> plan_taken_;
  std::function<void()> restart_refused_;
  std::optional<crux_msgs::plan_t> plan_left_;
  std::map<std::uint32_t, Pending> pending_;
  std::uint32_t next_ticket_ = 1;
  NodeStates nodes_{};
  Standing standing_{};
  std::vector<std::pair<crux_msgs::fault_t, Clock::time_point>> told_;  ///< of the standing ones, as they were told
  crux_msgs::fault_t fault_{};                                          ///< the last one that is only told
  Clock::time_point fault_at_;
  std::uint64_t malformed_ = 0;  ///< messages so far that could not be read
  std::uint64_t refused_ = 0;    ///< that the gate has not let through
  int refusals_logged_ = 0;      ///< since `refusals_since_`
  Clock::time_point refusals_since_;
  const Snapshot* snapshot_ = nullptr;  ///< the newest one; valid until the next is taken
  bool snapshot_is_new_ = false;        ///< not published yet
  Clock::time_point next_snapshot_ = Clock::now();
};

}  // namespace crux
