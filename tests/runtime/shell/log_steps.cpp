// Writes a log as the runtime does, FLUSHES times a flush with CYCLES cycles of random numbers, and prints how many
// bytes it wrote. With a FOLDER it keeps the file as it was in the middle of every write and after it, as
// FOLDER/STEP-FLUSHED.mcap with the number of cycles flushed by then: what a kill or a power cut there would leave.
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <string>

#include "telemetry/mcap_log.hpp"

namespace {

using namespace crux;

struct Steps {
  std::filesystem::path log, folder;
  bool recording = false;
  int count = 0;
  int flushed_cycles = 0;
  long long bytes = 0;

  void keep() {
    if (!recording || folder.empty()) return;
    const std::string name = std::to_string(count++) + "-" + std::to_string(flushed_cycles) + ".mcap";
    std::filesystem::copy_file(log, folder / name);
  }
} g_steps;

ssize_t write_at(int file, const void* bytes, std::size_t size, off_t at) {
  return syscall(SYS_pwrite64, file, bytes, size, at);
}

}  // namespace

// The C library's own, with an eye on what goes through.
extern "C" ssize_t pwrite64(int file, const void* bytes, std::size_t size, off_t at) {
  const std::size_t half = size / 2;
  const ssize_t first = write_at(file, bytes, half, at);
  g_steps.keep();
  if (first != static_cast<ssize_t>(half)) return first;
  const ssize_t second = write_at(file, static_cast<const char*>(bytes) + half, size - half, at + first);
  if (second < 0) return first;
  g_steps.keep();
  g_steps.bytes += first + second;
  return first + second;
}

int main(int count, char** arguments) {
  if (count < 4) return 2;
  const int flushes = std::atoi(arguments[2]), cycles = std::atoi(arguments[3]);
  g_steps.log = arguments[1];
  if (count > 4) g_steps.folder = arguments[4];
  McapLog log(arguments[1]);
  log.flush();
  g_steps.recording = true;
  std::mt19937_64 numbers(1);  // NOLINT(cert-msc51-cpp): the same ones every time
  crux_msgs::control_output_t output{};
  for (int flush = 0; flush < flushes; ++flush) {
    for (int i = 0; i < cycles; ++i) {
      ++output.cycle;
      for (double& value : output.joint_position_rad) value = std::uniform_real_distribution<double>()(numbers);
      log.write(crux_msgs::Channel::kControlOutput, output.cycle * 2'000'000, output);
    }
    log.flush();
    g_steps.flushed_cycles += cycles;
  }
  log.close();
  g_steps.keep();
  std::printf("%lld\n", g_steps.bytes);
}
