#include "bus/controller_errors.hpp"

#include <linux/can/error.h>

namespace crux {
namespace {

constexpr unsigned kPassiveBits = CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE;
constexpr unsigned kBelowPassiveBits = CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING | CAN_ERR_CRTL_ACTIVE;

}  // namespace

void ControllerErrors::take(const canfd_frame& error, BusStatistics& statistics) noexcept {
  ++statistics.error_frames;
  const canid_t classes = error.can_id & CAN_ERR_MASK;
  const unsigned detail = error.data[1];  // of class CRTL
  if ((classes & CAN_ERR_CRTL) != 0) {
    if ((detail & CAN_ERR_CRTL_RX_OVERFLOW) != 0) ++statistics.receive_lost;
    if ((detail & kPassiveBits) != 0) {
      statistics.error_passive += passive_ ? 0 : 1;
      passive_ = true;
    } else if ((detail & kBelowPassiveBits) != 0) {
      passive_ = false;
    }
  }
  if ((classes & CAN_ERR_ACK) != 0) {
    ++statistics.unacknowledged;
    unacknowledged_ = true;
  }
  if ((classes & CAN_ERR_BUSOFF) != 0) {
    statistics.bus_off += off_ ? 0 : 1;
    off_ = true;
  }
  if ((classes & CAN_ERR_RESTARTED) != 0) {
    ++statistics.restarts;
    off_ = passive_ = unacknowledged_ = false;
  }
}

BusState ControllerErrors::state() const noexcept {
  if (off_) return BusState::kOff;
  if (unacknowledged_) return BusState::kUnacknowledged;
  return passive_ ? BusState::kPassive : BusState::kActive;
}

}  // namespace crux
