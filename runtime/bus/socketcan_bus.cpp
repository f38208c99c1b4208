#include "bus/socketcan_bus.hpp"

#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>

namespace crux {

std::size_t to_kernel(const Frame& frame, canfd_frame& out) noexcept {
  out = {};
  out.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0U) | (frame.remote ? CAN_RTR_FLAG : 0U);
  out.len = frame.length;
  if (frame.fd)
    out.flags =
        static_cast<std::uint8_t>((frame.bit_rate_switch ? CANFD_BRS : 0) | (frame.error_state ? CANFD_ESI : 0));
  std::ranges::copy(frame.payload(), out.data);
  return frame.fd ? CANFD_MTU : CAN_MTU;
}

bool from_kernel(const canfd_frame& in, std::size_t bytes, Frame& frame) noexcept {
  const bool fd = bytes == CANFD_MTU;
  if (!fd && bytes != CAN_MTU) return false;
  if (in.len > (fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN)) return false;
  frame = Frame{};
  frame.fd = fd;
  frame.bit_rate_switch = fd && (in.flags & CANFD_BRS) != 0;
  frame.extended = (in.can_id & CAN_EFF_FLAG) != 0;
  frame.remote = (in.can_id & CAN_RTR_FLAG) != 0;
  frame.error = (in.can_id & CAN_ERR_FLAG) != 0;
  frame.error_state = fd && (in.flags & CANFD_ESI) != 0;
  frame.id = in.can_id & (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.length = in.len;
  std::copy_n(in.data, in.len, frame.data.begin());
  return true;
}

SocketCanBus::SocketCanBus(std::string_view interface) {
  const std::string name = "bus socketcan:" + std::string(interface);
  socket_ = Descriptor(::socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW));
  if (socket_.get() < 0) {
    if (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT)
      throw BusError(name +
                     ": this kernel has no SocketCAN (load the modules 'can' and 'can_raw', or use udp:GROUP:PORT)");
    throw BusError(name + ": no socket: " + std::strerror(errno));
  }
  const int fd = socket_.get();
  ifreq request{};
  if (interface.empty() || interface.size() >= sizeof request.ifr_name)
    throw BusError(name + ": an interface name has 1 to " + std::to_string(sizeof request.ifr_name - 1) +
                   " characters");
  interface.copy(request.ifr_name, sizeof request.ifr_name - 1);
  if (::ioctl(fd, SIOCGIFINDEX, &request) != 0)
    throw BusError(name + ": no such interface ('ip link show type can' lists them): " + std::strerror(errno));
  const int index = request.ifr_ifindex;
  if (::ioctl(fd, SIOCGIFMTU, &request) != 0 || request.ifr_mtu < static_cast<int>(CANFD_MTU))
    throw BusError(name + ": the interface does not carry CAN FD ('ip link set " + std::string(interface) +
                   " type can ... fd on')");
  const int on = 1;
  if (::setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) != 0)
    throw BusError(name + ": the kernel does not do CAN FD: " + std::strerror(errno));
  const can_err_mask_t errors = CAN_ERR_MASK;
  if (::setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) != 0)
    throw BusError(name + ": no error frames: " + std::strerror(errno));
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = index;
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    throw BusError(name + ": cannot bind: " + std::strerror(errno));
  for (std::size_t i = 0; i < kBatch; ++i) {
    parts_[i].iov_base = &buffers_[i];
    headers_[i].msg_hdr.msg_iov = &parts_[i];
    headers_[i].msg_hdr.msg_iovlen = 1;
  }
}

std::size_t SocketCanBus::send(std::span<const Frame> frames) noexcept {
  std::size_t taken = 0;
  while (taken < frames.size()) {
    const std::size_t n = std::min(frames.size() - taken, kBatch);
    for (std::size_t i = 0; i < n; ++i) parts_[i].iov_len = to_kernel(frames[taken + i], buffers_[i]);
    const int sent = ::sendmmsg(socket_.get(), headers_.data(), static_cast<unsigned>(n), MSG_DONTWAIT);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) break;
    taken += static_cast<std::size_t>(sent);
  }
  statistics_.sent += taken;
  statistics_.send_failed += frames.size() - taken;
  return taken;
}

std::size_t SocketCanBus::receive(std::span<Frame> frames) noexcept {
  std::size_t written = 0;
  while (written < frames.size()) {
    const std::size_t room = std::min(frames.size() - written, kBatch);
    for (std::size_t i = 0; i < room; ++i) parts_[i].iov_len = sizeof buffers_[i];
    const int n = ::recvmmsg(socket_.get(), headers_.data(), static_cast<unsigned>(room), MSG_DONTWAIT, nullptr);
    if (n <= 0) break;
    for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
      if (!from_kernel(buffers_[i], headers_[i].msg_len, frames[written]))
        ++statistics_.malformed;
      else if (frames[written].error)
        ++statistics_.error_frames;
      else
        ++written;
    }
    if (static_cast<std::size_t>(n) < room) break;
  }
  statistics_.received += written;
  return written;
}

}  // namespace crux
