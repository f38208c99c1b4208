#include "app/realtime.hpp"

#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
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

/// Asks the kernel (PM QoS, /dev/cpu_dma_latency) to let no processor sleep so deep that waking it takes time. The
/// request lasts as long as the file is open: until the process ends.
bool keep_processors_awake() {
  constexpr std::int32_t kWakeUpUs = 0;
  const int file = ::open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
  return file >= 0 && ::write(file, &kWakeUpUs, sizeof kWakeUpUs) == sizeof kWakeUpUs;
}

void add(std::string& refused, const char* what) {
  refused += std::string(refused.empty() ? "" : ", ") + what + " (" + std::strerror(errno) + ")";
}

}  // namespace

std::string become_realtime() {
  std::string refused;
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) add(refused, "memory is not locked");
  touch_stack();
  const sched_param priority{.sched_priority = kPriority};
  if (::sched_setscheduler(0, SCHED_FIFO, &priority) != 0) add(refused, "no SCHED_FIFO");
  if (!keep_processors_awake()) add(refused, "processors may sleep");
  return refused;
}

}  // namespace crux
