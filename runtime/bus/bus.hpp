#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "bus/frame.hpp"
#include "crux_msgs/bus_health_t.hpp"

namespace crux {

/// A bus that cannot be opened; the message says which, why and what would be right.
class BusError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// How a bus is, by gravity.
enum class BusState : std::int8_t {
  kActive = crux_msgs::bus_health_t::ACTIVE,
  kPassive = crux_msgs::bus_health_t::PASSIVE,                ///< the controller is error passive
  kUnacknowledged = crux_msgs::bus_health_t::UNACKNOWLEDGED,  ///< nobody acknowledges, nobody speaks
  kFull = crux_msgs::bus_health_t::FULL,                      ///< the last frames found no room in the transmit queue
  kForeign = crux_msgs::bus_health_t::FOREIGN,                ///< somebody else sends what only a runtime sends
  kOff = crux_msgs::bus_health_t::OFF,                        ///< the controller has left the bus
  kDown = crux_msgs::bus_health_t::DOWN,                      ///< the interface is down, or gone
};

struct BusStatistics {
  std::uint64_t sent = 0;
  std::uint64_t received = 0;
  std::uint64_t malformed = 0;       ///< datagrams or frames that could not be understood
  std::uint64_t send_failed = 0;     ///< frames the kernel did not take
  std::uint64_t queue_full = 0;      ///< calls of send() whose frames did not all find room
  std::uint64_t interface_down = 0;  ///< times the interface went down or away
  std::uint64_t receive_lost = 0;    ///< frames dropped because they were not fetched in time
  std::uint64_t error_frames = 0;    ///< controller and bus errors reported by the driver
  std::uint64_t error_passive = 0;   ///< times the controller became error passive
  std::uint64_t bus_off = 0;         ///< times the controller left the bus
  std::uint64_t restarts = 0;        ///< times it came back
  std::uint64_t unacknowledged = 0;  ///< frames nobody acknowledged

  BusStatistics& operator+=(const BusStatistics& other) noexcept;
};

/// One CAN bus. All calls after opening are free of allocation, exceptions and blocking.
class Bus {
 public:
  Bus() = default;
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;
  virtual ~Bus() = default;

  /// Hands the frames to the kernel in order; returns how many it took.
  virtual std::size_t send(std::span<const Frame> frames) noexcept = 0;

  /// Reads what has arrived, at most frames.size(); returns how many frames were written.
  virtual std::size_t receive(std::span<Frame> frames) noexcept = 0;

  /// Becomes readable when frames are waiting.
  [[nodiscard]] virtual int descriptor() const noexcept = 0;

  [[nodiscard]] virtual BusState state() const noexcept { return BusState::kActive; }

  [[nodiscard]] const BusStatistics& statistics() const noexcept { return statistics_; }

 protected:
  BusStatistics statistics_;
};

/// Opens `socketcan:NAME` or `udp:GROUP:PORT`.
/// @throws BusError when the name is wrong or the machine has no such bus
std::unique_ptr<Bus> open_bus(std::string_view name);

/// Four bus names on consecutive ports from `udp:GROUP:PORT`.
/// @throws BusError when the name is not of that form or the ports end above 65535
std::array<std::string, 4> consecutive_udp_buses(std::string_view first);

/// Room for what arrives while the reader is held up: a second of four limbs. `name` begins the message.
/// @throws BusError when the machine gives none
void take_receive_buffer(int socket, std::string_view name);

/// Blocks until a bus has frames or the time is over; true when one has.
bool wait_readable(std::span<const std::unique_ptr<Bus>> buses, std::chrono::nanoseconds timeout) noexcept;

}  // namespace crux
