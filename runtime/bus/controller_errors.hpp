#pragma once

#include <linux/can.h>

#include "bus/bus.hpp"

namespace crux {

/// What a CAN controller's error frames (linux/can/error.h) say about the bus. Owns no socket.
class ControllerErrors {
 public:
  /// Files one error frame and counts what it reports.
  void take(const canfd_frame& error, BusStatistics& statistics) noexcept;

  /// A frame of somebody else arrived whole: somebody is there to acknowledge.
  void heard() noexcept { unacknowledged_ = false; }

  /// The interface has been down: its controller starts anew.
  void reset() noexcept { *this = {}; }

  [[nodiscard]] BusState state() const noexcept;

 private:
  bool passive_ = false;
  bool off_ = false;
  bool unacknowledged_ = false;
};

}  // namespace crux
