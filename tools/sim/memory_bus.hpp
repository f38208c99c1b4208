// The runtime's end of a limb's bus in memory; the nodes' end is in firmware/ports/host.
#pragma once

#include <algorithm>

#include "bus/bus.hpp"

extern "C" {
#include "crux_nodes.h"
}

namespace crux::sim {

class MemoryBus final : public Bus {
 public:
  MemoryBus(crux_nodes* nodes, int limb) : nodes_(nodes), limb_(limb) {}

  std::size_t send(std::span<const Frame> frames) noexcept override {
    std::size_t taken = 0;
    for (const Frame& frame : frames) {
      crux_frame out{.id = static_cast<std::uint16_t>(frame.id), .length = frame.length, .data = {}};
      std::ranges::copy(frame.payload(), out.data);
      if (crux_nodes_put(nodes_, limb_, &out) == 0) break;
      ++taken;
    }
    statistics_.sent += taken;
    statistics_.send_failed += frames.size() - taken;
    return taken;
  }

  std::size_t receive(std::span<Frame> frames) noexcept override {
    std::size_t written = 0;
    for (crux_frame in; written < frames.size() && crux_nodes_get(nodes_, limb_, &in) != 0; ++written) {
      Frame& frame = frames[written] = Frame{};
      frame.id = in.id;
      frame.length = in.length;
      std::copy_n(in.data, in.length, frame.data.begin());
    }
    statistics_.received += written;
    return written;
  }

  [[nodiscard]] int descriptor() const noexcept override { return -1; }  // nobody waits for it

 private:
  crux_nodes* nodes_;
  int limb_;
};

}  // namespace crux::sim
