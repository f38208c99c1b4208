#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "bus/frame.hpp"

namespace crux {

/// The wire format of python-can's `udp_multicast`: one msgpack map of eleven string keys a datagram.
inline constexpr std::size_t kMaxDatagram = 512;

/// Writes the datagram of a frame; returns its size. The time stamp is written as zero: receivers stamp frames
/// themselves.
std::size_t encode_datagram(const Frame& frame, std::span<std::uint8_t, kMaxDatagram> out) noexcept;

/// Reads a datagram; false when any of it is malformed: unknown key, wrong type, length above 64, trailing bytes.
bool decode_datagram(std::span<const std::uint8_t> datagram, Frame& frame) noexcept;

}  // namespace crux
