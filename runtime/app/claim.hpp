// One runtime an address: a name that the kernel holds for a process and frees with it, however it ends.
#pragma once

#include <stdexcept>
#include <string>

namespace crux {

/// Another runtime has the address; the message names both.
class ClaimError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class Claim {
 public:
  /// An abstract Unix socket named after `address`: it lives in the network namespace, as CAN interfaces and loopback
  /// do.
  /// @throws ClaimError
  explicit Claim(const std::string& address);
  ~Claim();
  Claim(Claim&& other) noexcept;
  Claim(const Claim&) = delete;
  Claim& operator=(const Claim&) = delete;

 private:
  int fd_ = -1;
};

}  // namespace crux
