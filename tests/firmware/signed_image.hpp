// Signed images, by RFC 8032 written out over Monocypher's group operations; tests/firmware/test_update.py signs them
// by another library.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <initializer_list>
#include <numeric>
#include <vector>

extern "C" {
#include "image.h"
#include "monocypher.h"
#include "sha512.h"
}

namespace crux::firmware::signed_image {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint32_t kJointKind = 1;

inline Bytes sha512(std::initializer_list<Bytes> parts) {
  crux_sha512 sha;
  Bytes digest(64);
  crux_sha512_init(&sha);
  for (const Bytes& part : parts) crux_sha512_add(&sha, part.data(), part.size());
  crux_sha512_end(&sha, digest.data());
  return digest;
}

struct Signer {
  Bytes secret;  // scalar, prefix
  Bytes key = Bytes(32);
  explicit Signer(std::uint8_t seed = 7) : secret(sha512({Bytes(32, seed)})) {
    crypto_eddsa_trim_scalar(secret.data(), Bytes(secret.begin(), secret.begin() + 32).data());
    crypto_eddsa_scalarbase(key.data(), secret.data());
  }
  [[nodiscard]] Bytes sign(const Bytes& message) const {
    Bytes signature(64);
    std::array<std::uint8_t, 32> nonce{};
    std::array<std::uint8_t, 32> challenge{};
    crypto_eddsa_reduce(nonce.data(), sha512({Bytes(secret.begin() + 32, secret.end()), message}).data());
    crypto_eddsa_scalarbase(signature.data(), nonce.data());
    const Bytes commitment(signature.begin(), signature.begin() + 32);
    crypto_eddsa_reduce(challenge.data(), sha512({commitment, key, message}).data());
    crypto_eddsa_mul_add(signature.data() + 32, challenge.data(), secret.data(), nonce.data());
    return signature;
  }
};

inline const Signer& signer() {
  static const Signer instance;
  return instance;
}

inline void put(Bytes& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
}

struct Image {
  Bytes header;
  Bytes payload;
  explicit Image(std::uint32_t version, std::uint32_t kind = kJointKind, std::size_t length = 2501)
      : header(CRUX_IMAGE_SIGNED), payload(length) {
    std::iota(payload.begin(), payload.end(), static_cast<std::uint8_t>(version));
    std::copy_n("CRUXIMG1", 8, header.begin());
    put(header, 8, kind);
    put(header, 12, version);
    put(header, 16, static_cast<std::uint32_t>(length));
    const Bytes digest = sha512({payload});
    std::copy(digest.begin(), digest.end(), header.begin() + 64);
    const Bytes signature = signer().sign(header);
    header.insert(header.end(), signature.begin(), signature.end());
  }
};

}  // namespace crux::firmware::signed_image
