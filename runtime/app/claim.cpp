#include "app/claim.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <utility>

namespace crux {

Claim::Claim(const std::string& address) : fd_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  // What follows a '?' are options of the same address; a leading zero byte makes the name an abstract one.
  const std::string name = "crux-runtime " + address.substr(0, address.find('?'));
  sockaddr_un where{};
  where.sun_family = AF_UNIX;
  const std::size_t length = std::min(name.size(), sizeof where.sun_path - 1);
  std::memcpy(&where.sun_path[1], name.data(), length);
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + length);
  if (::bind(fd_, reinterpret_cast<const sockaddr*>(&where), size) == 0) return;
  const std::string reason = errno == EADDRINUSE
                                 ? "another crux-runtime has it; end that one (crux shutdown), or name another"
                                 : std::strerror(errno);
  ::close(fd_);
  throw ClaimError("'" + address + "': " + reason);
}

Claim::~Claim() {
  if (fd_ >= 0) ::close(fd_);
}

Claim::Claim(Claim&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

}  // namespace crux
