// One runtime an address: a file that the kernel keeps locked for a process and unlocks with it, however it ends.
#pragma once

#include <stdexcept>
#include <string>

#include "bus/descriptor.hpp"

namespace crux {

/// Another runtime of this user has the address; the message names both.
class ClaimError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A folder for locks that only this user can write to: systemd's RuntimeDirectory, `crux` in the user's own
/// XDG_RUNTIME_DIR, else `crux-UID` in the temporary folder. It is made where it is missing.
/// @returns its path; empty where it cannot be had or is not this user's alone, with the reason in `why`
std::string lock_folder(std::string& why);

class Claim {
 public:
  /// Locks a file named after `address` and the network namespace, which CAN interfaces and loopback live in. Where no
  /// file can be locked, because somebody else owns the folder or the disk is full, that is said and the runtime goes
  /// on: this lock is against mistakes, and a robot on the wall needs its runtime.
  /// @throws ClaimError
  explicit Claim(const std::string& address);

 private:
  /// Why it could not; empty when it has.
  std::string lock(const std::string& address);

  Descriptor file_;
};

}  // namespace crux
