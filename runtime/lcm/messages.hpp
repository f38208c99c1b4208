// One line on standard error for what an operator at the machine should read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "bus/limb_bus.hpp"
#include "core/robot/reason.hpp"
#include "crux_msgs/channels.hpp"
#include "crux_msgs/fault_t.hpp"

namespace crux {

void print_fault(const crux_msgs::fault_t& fault);

/// What a fault's text leaves out.
void print_reason(const Reason& reason);

/// A node that says it has restarted is no news.
void print_notice(const NodeNotice& notice);

/// `count`: how many there have been; only the 1st, 2nd, 4th, 8th .. are told of, a flood fills no disk.
void print_malformed(crux_msgs::Channel channel, std::size_t bytes, std::uint64_t count);

/// A message that the gate has not let through; `count` as above.
void print_refused(const std::string& reason, std::uint64_t count);

}  // namespace crux
