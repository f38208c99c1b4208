#include "lcm/this_machine.hpp"

#include <arpa/inet.h>
#include <dirent.h>
#include <linux/filter.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string_view>

namespace crux {
namespace {

constexpr std::string_view kUdp = "udpm://", kTtl = "ttl=";

bool parse(std::string_view text, std::uint16_t& number) {
  return std::from_chars(text.data(), text.data() + text.size(), number).ec == std::errc{};
}

/// Multicast group and port of a udpm URL whose messages stay on the machine (LCM's default); false for any other.
bool stays_here(std::string_view url, sockaddr_in& where) {
  if (!url.starts_with(kUdp)) return false;
  url.remove_prefix(kUdp.size());
  const std::string_view address = url.substr(0, url.find('?'));
  const std::size_t colon = address.find(':'), ttl = url.find(kTtl);
  std::uint16_t port = 0, hops = 0;
  if (colon == std::string_view::npos || !parse(address.substr(colon + 1), port)) return false;
  if (ttl != std::string_view::npos && !parse(url.substr(ttl + kTtl.size()), hops)) return false;
  where = {};
  where.sin_port = htons(port);
  return hops == 0 && ::inet_pton(AF_INET, std::string(address.substr(0, colon)).c_str(), &where.sin_addr) == 1;
}

bool is_bound_to(int fd, const sockaddr_in& where) {
  sockaddr_in own{};
  socklen_t size = sizeof own;
  return ::getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) == 0 && own.sin_family == AF_INET &&
         own.sin_port == where.sin_port && own.sin_addr.s_addr == where.sin_addr.s_addr;
}

/// Takes what the kernel has looped back of multicasts from here, and what comes in by the loopback interface.
bool filter(int fd) {
  constexpr auto kOf = [](int what) { return static_cast<std::uint32_t>(SKF_AD_OFF + what); };
  const std::uint32_t loopback = ::if_nametoindex("lo");
  std::array<sock_filter, 6> program = {{
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kOf(SKF_AD_PKTTYPE)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, PACKET_LOOPBACK, 2, 0),
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kOf(SKF_AD_IFINDEX)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, loopback, 0, 1),
      BPF_STMT(BPF_RET | BPF_K, UINT32_MAX),
      BPF_STMT(BPF_RET | BPF_K, 0),
  }};
  const sock_fprog all{.len = program.size(), .filter = program.data()};
  return ::setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &all, sizeof all) == 0;
}

struct Closed {
  void operator()(DIR* folder) const noexcept { ::closedir(folder); }
};

}  // namespace

std::string hear_only_this_machine(const std::string& url) {
  sockaddr_in where{};
  if (!stays_here(url, where)) return "";
  const std::unique_ptr<DIR, Closed> open_files(::opendir("/proc/self/fd"));
  bool any = false, all = true;
  while (const dirent* entry = open_files ? ::readdir(open_files.get()) : nullptr) {  // NOLINT(concurrency-mt-unsafe)
    std::uint16_t fd = 0;
    if (!parse(static_cast<const char*>(entry->d_name), fd) || !is_bound_to(fd, where)) continue;
    any = true;
    all = filter(fd) && all;
  }
  if (any && all) return "";
  return "LCM at '" + url +
         "' receives from other network interfaces, too: " + (any ? std::strerror(errno) : "no socket found");
}

}  // namespace crux
