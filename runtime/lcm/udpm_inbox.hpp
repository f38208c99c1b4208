// What comes in over LCM's UDP multicast, read from a socket of our own: the library takes the memory that any
// fragment's header asks for, keeps thirty messages of a channel whoever sent them, and hears other computers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace crux {

class UdpmInbox {
 public:
  /// @param sender address and port
  using Handler = std::function<void(std::uint64_t sender, std::string_view channel, std::span<const std::uint8_t>)>;

  static bool serves(const std::string& url) { return url.starts_with("udpm://"); }

  /// Joins the group of a udpm:// URL. With ttl=0, LCM's default, the kernel lets through only what was sent on this
  /// machine (network namespace), and in any case no fragments: what operators send fits one datagram.
  /// @throws std::runtime_error
  explicit UdpmInbox(const std::string& url);
  ~UdpmInbox();
  UdpmInbox(const UdpmInbox&) = delete;
  UdpmInbox& operator=(const UdpmInbox&) = delete;

  [[nodiscard]] int fd() const noexcept { return fd_; }

  /// Hands on what has come, kMost datagrams at most; does not wait.
  void drain(const Handler& handler);

 private:
  static constexpr std::size_t kBatch = 16, kMost = 512, kDatagram = 65536;

  int fd_ = -1;
  std::unique_ptr<std::array<std::array<std::uint8_t, kDatagram>, kBatch>> buffers_;
};

}  // namespace crux
