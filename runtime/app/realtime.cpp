#include "app/realtime.hpp"

#include <sched.h>
#include <sys/mman.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace crux {
namespace {

constexpr int kPriority = 80;  // above the kernel's threaded interrupts, below its watchdogs
constexpr std::size_t kStackBytes = 1 << 18;
constexpr std::size_t kPageBytes = 4096;

/// Touches the pages below the stack pointer, so that none has to be made later.
[[gnu::noinline]] void touch_stack() {
  std::array<volatile char, kStackBytes> pages;
  for (std::size_t i = 0; i < pages.size(); i += kPageBytes) pages[i] = 0;
}

}  // namespace

std::string become_realtime() {
  std::string refused;
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0)
    refused += std::string("memory is not locked (") + std::strerror(errno) + ")";
  touch_stack();
  const sched_param priority{.sched_priority = kPriority};
  if (::sched_setscheduler(0, SCHED_FIFO, &priority) != 0)
    refused += std::string(refused.empty() ? "" : ", ") + "no SCHED_FIFO (" + std::strerror(errno) + ")";
  return refused;
}

}  // namespace crux
