// What a run leaves behind for the run after it, where the runtime ends with its robot on the wall: two small files,
// the plan and the point of it at which the robot hangs. Each is replaced as a whole, so one is there after a power
// cut, too.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "app/cycle_loop.hpp"
#include "core/plan/prepared_plan.hpp"
#include "core/robot/robot_description.hpp"
#include "crux_msgs/plan_t.hpp"
#include "crux_msgs/restart_t.hpp"
#include "exchange/runtime_exchange.hpp"
#include "lcm/operator_server.hpp"

namespace crux {

class RestartKeeper {
 public:
  /// What was found: the plan, ready to be taken over, and the point of it.
  struct Left {
    crux_msgs::plan_t plan;
    std::unique_ptr<const PreparedPlan> prepared;
    crux_msgs::restart_t point;
  };

  /// `folder`: of this robot's alone; it is made when there is something to keep. Empty: nothing is kept or found.
  RestartKeeper(std::string folder, const RobotDescription& robot, RuntimeExchange& exchange);

  /// What the run before left behind; none where it left nothing, or where `trouble` says why it is of no use.
  std::optional<Left> find(std::string& trouble) const;

  /// A plan that the control core has taken over. Any thread but the real-time one.
  void take_plan(const crux_msgs::plan_t& plan);

  /// The files are not to be found again: what they say is not so.
  void retire() const;

  /// Keeps what is new until `ended`.
  void run(const std::atomic<bool>& ended);

  /// Keeps what is new, now.
  void keep();

  /// A folder for the robot on these buses, in the runtime's state folder; empty where it has none.
  static std::string default_folder(const std::array<std::string, kLimbs>& buses);

 private:
  void keep_plan();
  void keep_point(const crux_msgs::restart_t& point);
  void fail(const std::string& what);

  std::string folder_;
  const RobotDescription& robot_;
  RuntimeExchange& exchange_;
  std::mutex mutex_;
  std::optional<crux_msgs::plan_t> new_plan_;
  std::string plan_id_;  ///< of the plan that is on the disk
  crux_msgs::restart_t kept_;
  std::int64_t kept_cycle_ = 0;
  std::string trouble_;
};

/// Before loop and server run: has the loop go on where the run before has left the robot, and `keeper` keep what
/// server and loop tell. Says on standard error what of it is of no use.
void take_up(RestartKeeper& keeper, CycleLoop& loop, OperatorServer& server, RuntimeExchange& exchange);

}  // namespace crux
