// The runtime's own key: it signs what it answers, and operators know it by the public half.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace crux {

class Identity {
 public:
  using Key = std::array<std::uint8_t, 32>;
  using Signature = std::array<std::uint8_t, 64>;

  /// A key for this run alone.
  Identity();

  /// The private key (Ed25519, PEM) of a file that nobody but its owner may read; made where there is none. What cannot
  /// be read or written keeps no runtime from starting: it then has a key for this run alone, and `trouble` says why.
  static Identity of_file(const std::string& path, std::string& trouble);

  /// `runtime.pem` in $STATE_DIRECTORY, $XDG_STATE_HOME/crux or ~/.local/state/crux; empty: nowhere.
  static std::string default_path();

  [[nodiscard]] Key key() const;
  [[nodiscard]] Signature sign(std::span<const std::uint8_t> bytes) const;

 private:
  struct Freed {
    void operator()(void* key) const noexcept;
  };
  explicit Identity(void* key) : key_(key) {}

  std::unique_ptr<void, Freed> key_;  // EVP_PKEY
};

/// SHA-256.
std::array<std::uint8_t, 32> digest_of(std::span<const std::uint8_t> bytes);

/// Lower-case hexadecimal digits.
std::string hex_of(std::span<const std::uint8_t> bytes);

}  // namespace crux
