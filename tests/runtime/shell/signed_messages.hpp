// Operators of tests: they sign by RFC 8032 written out over Monocypher's group operations, the gate reads by OpenSSL.
#pragma once

#include <algorithm>
#include <vector>

#include "crux_msgs/command_t.hpp"
#include "crux_msgs/plan_piece_t.hpp"
#include "crux_msgs/signed_t.hpp"
#include "lcm/command_gate.hpp"
#include "signed_image.hpp"

namespace crux {

using MessageBytes = std::vector<std::uint8_t>;

template <class Message>
MessageBytes lcm_bytes(const Message& message) {
  MessageBytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

inline MessageBytes command_bytes(std::int8_t command, std::int64_t request_id = 1) {
  crux_msgs::command_t message{};
  message.request_id = request_id;
  message.command = command;
  return lcm_bytes(message);
}

inline MessageBytes piece_bytes() {
  crux_msgs::plan_piece_t piece{};
  piece.plan_id = "plan";
  piece.data = {1, 2, 3};
  piece.n_bytes = 3;
  return lcm_bytes(piece);
}

struct TestOperator {
  firmware::signed_image::Signer signer;

  explicit TestOperator(std::uint8_t seed) : signer(seed) {}

  [[nodiscard]] AuthorizedKey authorized(Role role, const std::string& name) const {
    AuthorizedKey key{{}, role, name};
    std::ranges::copy(signer.key, key.key.begin());
    return key;
  }
  [[nodiscard]] MessageBytes sign(std::int64_t session, std::int64_t counter, std::int64_t lease,
                                  const MessageBytes& data) const {
    crux_msgs::signed_t message{};
    message.session = session;
    message.counter = counter;
    message.lease = lease;
    std::ranges::copy(signer.key, std::begin(message.key));
    message.n_bytes = static_cast<std::int32_t>(data.size());
    message.data = data;
    const MessageBytes unsigned_yet = lcm_bytes(message);
    MessageBytes bytes(unsigned_yet.begin(), unsigned_yet.end() - sizeof message.signature);
    const MessageBytes signature = signer.sign(bytes);
    bytes.insert(bytes.end(), signature.begin(), signature.end());
    return bytes;
  }
};

}  // namespace crux
