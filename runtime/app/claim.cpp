#include "app/claim.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "core/robot/hash.hpp"

namespace crux {
namespace {

std::string environment(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): before any other thread
  return value == nullptr ? "" : value;
}

bool is_private(const std::string& folder) {
  struct stat found{};
  return ::lstat(folder.c_str(), &found) == 0 && S_ISDIR(found.st_mode) && found.st_uid == ::geteuid() &&
         (found.st_mode & 022U) == 0;
}

/// Of the address, without the options behind a '?', in this network namespace.
std::string lock_name(const std::string& address) {
  struct stat network{};
  const bool known = ::stat("/proc/self/ns/net", &network) == 0;
  const std::string whole = address.substr(0, address.find('?')) + " " + std::to_string(known ? network.st_ino : 0);
  return "runtime-" + short_hash(whole) + ".lock";
}

}  // namespace

std::string lock_folder(std::string& why) {
  std::string folder = environment("RUNTIME_DIRECTORY");
  if (folder.empty()) {
    const std::string of_user = environment("XDG_RUNTIME_DIR"), temporary = environment("TMPDIR");
    folder = !of_user.empty() && is_private(of_user)
                 ? of_user + "/crux"
                 : (temporary.empty() ? "/tmp" : temporary) + "/crux-" + std::to_string(::geteuid());
    if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) {
      why = folder + ": " + std::strerror(errno);
      return "";
    }
  }
  if (is_private(folder)) return folder;
  why = folder + ": is no folder that only user " + std::to_string(::geteuid()) + " can write to";
  return "";
}

Claim::Claim(const std::string& address) {
  if (const std::string why = lock(address); !why.empty())
    std::fprintf(stderr, "crux-runtime: '%s' is not locked, another crux-runtime on it would not be noticed: %s\n",
                 address.c_str(), why.c_str());
}

std::string Claim::lock(const std::string& address) {
  std::string why;
  const std::string folder = lock_folder(why);
  if (folder.empty()) return why;
  const std::string path = folder + "/" + lock_name(address);
  file_ = Descriptor(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (file_.get() >= 0 && ::flock(file_.get(), LOCK_EX | LOCK_NB) == 0) return "";
  if (file_.get() < 0 || errno != EWOULDBLOCK) return path + ": " + std::strerror(errno);
  throw ClaimError("'" + address + "': another crux-runtime has it; end that one (crux shutdown), or name another");
}

}  // namespace crux
