#include "bus/socketcan_bus.hpp"

#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/errqueue.h>
#include <linux/net_tstamp.h>
#include <net/if.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

#include "bus/frame_kind.hpp"

namespace crux {
namespace {

constexpr unsigned kSendsBetweenTries = 50;  // to find an interface that is gone
constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

/// Exactly the identifiers of the CAN database, as standard data frames; the kernel looks each up in a table.
std::vector<can_filter> database_filters() {
  std::vector<can_filter> filters;
  for (std::uint32_t id = 0; id < kStandardIds; ++id) {
    if (kFrameMeanings[id].kind != FrameKind::kUnknown)
      filters.push_back({.can_id = id, .can_mask = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG});
  }
  return filters;
}

/// The hardware's stamp where there is one, else the kernel's; 0 without.
std::int64_t stamp_of(msghdr& header) noexcept {
  for (cmsghdr* part = CMSG_FIRSTHDR(&header); part != nullptr; part = CMSG_NXTHDR(&header, part)) {
    if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SO_TIMESTAMPING) continue;
    scm_timestamping stamps{};
    std::memcpy(&stamps, CMSG_DATA(part), sizeof stamps);
    const timespec& stamp = stamps.ts[2].tv_sec != 0 ? stamps.ts[2] : stamps.ts[0];
    return stamp.tv_sec * kNanosecondsPerSecond + stamp.tv_nsec;
  }
  return 0;
}

/// Frames the kernel has dropped for this socket since it was opened, if the message says so.
bool dropped_of(msghdr& header, std::uint32_t& dropped) noexcept {
  for (cmsghdr* part = CMSG_FIRSTHDR(&header); part != nullptr; part = CMSG_NXTHDR(&header, part)) {
    if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SO_RXQ_OVFL) continue;
    std::memcpy(&dropped, CMSG_DATA(part), sizeof dropped);
    return true;
  }
  return false;
}

bool means_down(int error) noexcept {
  return error == ENETDOWN || error == ENXIO || error == ENODEV || error == ENETUNREACH;
}

}  // namespace

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

SocketCanBus::SocketCanBus(std::string_view interface) : interface_(interface), filters_(database_filters()) {
  const std::string name = "bus socketcan:" + interface_;
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
  if (::ioctl(fd, SIOCGIFMTU, &request) != 0 || request.ifr_mtu < static_cast<int>(CANFD_MTU))
    throw BusError(name + ": the interface does not carry CAN FD ('ip link set " + interface_ +
                   " type can ... fd on')");
  const auto set = [&](int level, int option, const auto& value, const char* what) {
    if (::setsockopt(fd, level, option, &value, sizeof value) != 0)
      throw BusError(name + ": " + what + ": " + std::strerror(errno));
  };
  const int on = 1;
  const can_err_mask_t errors = CAN_ERR_MASK;
  const int stamps = SOF_TIMESTAMPING_RX_HARDWARE | SOF_TIMESTAMPING_RX_SOFTWARE | SOF_TIMESTAMPING_RAW_HARDWARE |
                     SOF_TIMESTAMPING_SOFTWARE;
  set(SOL_CAN_RAW, CAN_RAW_FD_FRAMES, on, "the kernel does not do CAN FD");
  set(SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors, "no error frames");
  set(SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, on, "no confirmation of sent frames");
  set(SOL_SOCKET, SO_TIMESTAMPING, stamps, "no time stamps");
  set(SOL_SOCKET, SO_RXQ_OVFL, on, "no count of dropped frames");
  take_receive_buffer(fd, name);
  if (!bind_to_interface()) throw BusError(name + ": cannot bind: " + std::strerror(errno));
  for (std::size_t i = 0; i < kBatch; ++i) {
    parts_[i].iov_base = &buffers_[i];
    headers_[i].msg_hdr.msg_iov = &parts_[i];
    headers_[i].msg_hdr.msg_iovlen = 1;
  }
}

/// By name and with the filters anew: an adapter that was unplugged comes back under another index, and the kernel has
/// dropped the filters.
bool SocketCanBus::bind_to_interface() noexcept {
  ifreq request{};
  interface_.copy(request.ifr_name, sizeof request.ifr_name - 1);
  if (::ioctl(socket_.get(), SIOCGIFINDEX, &request) != 0) return false;
  const auto bytes = static_cast<socklen_t>(filters_.size() * sizeof filters_[0]);
  if (::setsockopt(socket_.get(), SOL_CAN_RAW, CAN_RAW_FILTER, filters_.data(), bytes) != 0) return false;
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = request.ifr_ifindex;
  return ::bind(socket_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

void SocketCanBus::went_down() noexcept {
  if (down_) return;
  down_ = true;
  ++statistics_.interface_down;
  errors_.reset();
}

BusState SocketCanBus::state() const noexcept {
  if (down_) return BusState::kDown;
  if (errors_.state() == BusState::kOff) return BusState::kOff;
  return full_ ? BusState::kFull : errors_.state();
}

std::size_t SocketCanBus::send(std::span<const Frame> frames) noexcept {
  if (gone_ && ++sends_while_gone_ % kSendsBetweenTries == 0 && bind_to_interface()) gone_ = false;
  std::size_t taken = 0;
  int error = 0;
  while (taken < frames.size()) {
    const std::size_t n = std::min(frames.size() - taken, kBatch);
    for (std::size_t i = 0; i < n; ++i) {
      parts_[i].iov_len = to_kernel(frames[taken + i], buffers_[i]);
      headers_[i].msg_hdr.msg_control = nullptr;
      headers_[i].msg_hdr.msg_controllen = 0;
    }
    const int sent = ::sendmmsg(socket_.get(), headers_.data(), static_cast<unsigned>(n), MSG_DONTWAIT);
    if (sent < 0 && errno == EINTR) continue;
    error = sent < 0 ? errno : 0;
    if (sent <= 0) break;
    taken += static_cast<std::size_t>(sent);
  }
  if (means_down(error)) {
    went_down();
    gone_ = error != ENETDOWN;
  } else if (taken > 0) {
    down_ = gone_ = false;
  }
  full_ = error == ENOBUFS || error == EAGAIN;
  statistics_.queue_full += full_ ? 1 : 0;
  statistics_.sent += taken;
  statistics_.send_failed += frames.size() - taken;
  return taken;
}

/// Judges what was read into buffer `index`; true when it is a frame to hand on.
bool SocketCanBus::take(std::size_t index, Frame& frame) noexcept {
  msghdr& header = headers_[index].msg_hdr;
  std::uint32_t dropped = 0;
  if (dropped_of(header, dropped) && dropped != kernel_dropped_) {
    statistics_.receive_lost += dropped - kernel_dropped_;
    kernel_dropped_ = dropped;
  }
  if (!from_kernel(buffers_[index], headers_[index].msg_len, frame)) {
    ++statistics_.malformed;
    return false;
  }
  if (frame.error) {
    errors_.take(buffers_[index], statistics_);
    return false;
  }
  frame.own = (header.msg_flags & MSG_CONFIRM) != 0;
  frame.stamp_ns = stamp_of(header);
  if (!frame.own) errors_.heard();
  return true;
}

std::size_t SocketCanBus::receive(std::span<Frame> frames) noexcept {
  std::size_t written = 0;
  while (written < frames.size()) {
    const std::size_t room = std::min(frames.size() - written, kBatch);
    for (std::size_t i = 0; i < room; ++i) {
      parts_[i].iov_len = sizeof buffers_[i];
      headers_[i].msg_hdr.msg_control = controls_[i].data();
      headers_[i].msg_hdr.msg_controllen = kControlBytes;
    }
    const int n = ::recvmmsg(socket_.get(), headers_.data(), static_cast<unsigned>(room), MSG_DONTWAIT, nullptr);
    if (n < 0 && means_down(errno)) went_down();  // told once; frames that came before may still be waiting
    if (n <= 0) break;
    for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
      if (take(i, frames[written])) ++written;
    }
    if (static_cast<std::size_t>(n) < room) break;
  }
  statistics_.received += written;
  return written;
}

}  // namespace crux
