// One entry of the log's queue: a whole control cycle with the events that took effect in it.
#pragma once

#include <cstdint>
#include <memory>

#include "core/control_core.hpp"
#include "core/robot/geometry.hpp"
#include "crux_msgs/bus_health_t.hpp"
#include "crux_msgs/control_input_t.hpp"
#include "crux_msgs/cycle_timing_t.hpp"
#include "exchange/frame_tape.hpp"
#include "exchange/operator_exchange.hpp"

namespace crux {

struct CycleRecord {
  std::int64_t log_time_ns = 0;  ///< cycle · dt
  bool has_cycle = false;        ///< false: events only, outside any cycle
  EventList events;
  crux_msgs::control_input_t input{};
  CycleResult result;
  PerLimb<crux_msgs::bus_health_t> health{};
  crux_msgs::cycle_timing_t timing{};
  std::unique_ptr<ControlCore> retired_core;  ///< a new core computes from this cycle on; the old one is to be freed
  FrameTape frames;                           ///< since the record before
};

}  // namespace crux
