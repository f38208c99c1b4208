// Opens a bus by name, says "ready", and sends COUNT received frames back with their identifier + 1 and all payload
// bytes inverted: the other end of the Python tests. usage: bus_echo NAME COUNT
#include <array>
#include <cstdio>
#include <cstdlib>

#include "bus/bus.hpp"

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  try {
    const auto bus = crux::open_bus(argv[1]);
    std::puts("ready");
    std::fflush(stdout);
    std::array<crux::Frame, 32> frames;
    for (long left = std::strtol(argv[2], nullptr, 10); left > 0;) {
      crux::wait_readable({&bus, 1}, std::chrono::seconds(1));
      for (std::size_t i = 0, n = bus->receive(frames); i < n; ++i) {
        crux::Frame& frame = frames[i];
        if (frame.id % 2 != 0) continue;  // an answer of ours
        ++frame.id;
        for (std::size_t k = 0; k < frame.length; ++k) frame.data[k] = static_cast<std::uint8_t>(~frame.data[k]);
        bus->send({&frame, 1});
        --left;
      }
    }
    std::printf("%llu malformed\n", static_cast<unsigned long long>(bus->statistics().malformed));
  } catch (const crux::BusError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
