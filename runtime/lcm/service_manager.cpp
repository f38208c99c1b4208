#include "lcm/service_manager.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <string_view>
#include <utility>

namespace crux {

ServiceManager::ServiceManager() {
  const char* named = std::getenv("NOTIFY_SOCKET");  // NOLINT(concurrency-mt-unsafe): before any other thread
  const std::string_view path = named == nullptr ? "" : named;
  sockaddr_un where{};
  where.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof where.sun_path) return;
  path.copy(&where.sun_path[0], path.size());
  if (path[0] == '@') where.sun_path[0] = '\0';  // an abstract name
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size());
  fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd_ < 0 || ::connect(fd_, reinterpret_cast<const sockaddr*>(&where), size) == 0) return;
  ::close(std::exchange(fd_, -1));
}

ServiceManager::~ServiceManager() {
  if (fd_ >= 0) ::close(fd_);
}

void ServiceManager::goes_on() noexcept {
  if (fd_ < 0) return;
  const std::string_view said = std::exchange(started_, true) ? "WATCHDOG=1" : "READY=1";
  // A manager that does not listen is its own matter.
  static_cast<void>(::send(fd_, said.data(), said.size(), MSG_NOSIGNAL));
}

}  // namespace crux
