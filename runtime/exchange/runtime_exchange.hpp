// Everything the real-time thread shares with the other threads but the log.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>

#include "bus/limb_bus.hpp"
#include "core/control_core.hpp"
#include "core/robot/geometry.hpp"
#include "crux_msgs/bus_health_t.hpp"
#include "crux_msgs/cycle_timing_t.hpp"
#include "crux_msgs/fault_t.hpp"
#include "crux_msgs/limb_reference_t.hpp"
#include "crux_msgs/limb_telemetry_t.hpp"
#include "crux_msgs/restart_t.hpp"
#include "crux_msgs/robot_state_t.hpp"
#include "crux_msgs/status_t.hpp"
#include "exchange/latest_value.hpp"
#include "exchange/operator_exchange.hpp"
#include "exchange/spsc_ring.hpp"

namespace crux {

/// What goes out over LCM a few times a second.
struct Snapshot {
  crux_msgs::robot_state_t state;
  PerLimb<crux_msgs::limb_reference_t> reference;
  PerLimb<crux_msgs::limb_telemetry_t> telemetry;
  PerLimb<crux_msgs::bus_health_t> health;
  crux_msgs::cycle_timing_t timing;
};

/// What the run after this one needs to know.
struct RestartPoint {
  static constexpr std::size_t kPlanId = 64;  // its length
  RestartPoint() { left.plan_id.reserve(kPlanId); }
  crux_msgs::restart_t left{};
  std::int64_t cycle = 0;  ///< of this run
};

/// Of each node, limb-major, as in status_t.
using NodeStates = std::array<std::int8_t, std::size(decltype(crux_msgs::status_t::node_state){})>;

/// What status_t says beside the snapshot, of this very cycle.
struct Standing {
  FaultList faults;
  std::array<double, kAllJoints> joint_dead_time_s{};  ///< -1: not known
};

struct RuntimeExchange {
  SpscRing<Request> requests{64};
  SpscRing<std::unique_ptr<ControlCore>> new_cores{1};  ///< to be taken where the old one is as new, for a new log
  SpscRing<Answer> answers{256};
  SpscRing<crux_msgs::fault_t> faults{64};
  SpscRing<NodeNotice> notices{64};
  LatestValue<Snapshot> snapshot;
  LatestValue<NodeStates> nodes;
  LatestValue<RestartPoint> restart;
  LatestValue<Reason> restart_refusal;
  LatestValue<Standing> standing;
  std::atomic<std::int8_t> supervisor_state{crux_msgs::robot_state_t::IDLE};
  std::atomic<std::int16_t> fault_code{0};  ///< of the fault that stands, as in robot_state_t
  std::atomic<bool> log_broken{false};      ///< the log cannot be written
  std::atomic<bool> stop{false};            ///< asks the real-time thread to hold and end
};

}  // namespace crux
