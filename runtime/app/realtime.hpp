// What a thread needs from the operating system to keep a period.
#pragma once

#include <string>

namespace crux {

/// Locks memory, touches the stack, asks for SCHED_FIFO and for processors that wake at once. Empty when all was
/// granted, else what was not; the caller goes on without.
std::string become_realtime();

}  // namespace crux
