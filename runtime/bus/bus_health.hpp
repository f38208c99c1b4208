// A limb's bus in one message: its state, and the counts behind it.
#pragma once

#include <algorithm>
#include <cstdint>

#include "bus/bus.hpp"
#include "bus/limb_bus.hpp"
#include "crux_msgs/bus_health_t.hpp"

namespace crux {

inline crux_msgs::bus_health_t bus_health(std::int64_t cycle, int limb, const Bus& bus, const LimbBus& nodes) noexcept {
  const auto count = [](std::uint64_t n) { return static_cast<std::int64_t>(n); };
  const BusStatistics& seen = bus.statistics();
  const LimbStatistics& heard = nodes.statistics();
  crux_msgs::bus_health_t health{};
  health.cycle = cycle;
  health.limb = static_cast<std::int8_t>(limb);
  health.state =
      static_cast<std::int8_t>(std::max(bus.state(), nodes.foreign_host() ? BusState::kForeign : BusState::kActive));
  health.error_frames = count(seen.error_frames);
  health.error_passive = count(seen.error_passive);
  health.bus_off = count(seen.bus_off);
  health.restarts = count(seen.restarts);
  health.unacknowledged = count(seen.unacknowledged);
  health.interface_down = count(seen.interface_down);
  health.queue_full = count(seen.queue_full);
  health.send_failed = count(seen.send_failed);
  health.receive_lost = count(seen.receive_lost);
  health.malformed = count(seen.malformed);
  health.crc_errors = count(heard.crc_errors);
  health.repeated = count(heard.repeated);
  health.lost = count(heard.lost);
  health.foreign = count(heard.foreign);
  return health;
}

}  // namespace crux
