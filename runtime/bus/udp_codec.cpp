#include "bus/udp_codec.hpp"

#include <algorithm>
#include <cstring>
#include <optional>
#include <string_view>
#include <variant>

namespace crux {
namespace {

// Type bytes of the msgpack specification that this format uses.
constexpr std::uint8_t kFixMap = 0x80, kFixString = 0xa0, kNil = 0xc0, kFalse = 0xc2, kTrue = 0xc3, kBin8 = 0xc4;
constexpr std::uint8_t kFloat32 = 0xca, kFloat64 = 0xcb, kUint8 = 0xcc, kUint16 = 0xcd, kUint32 = 0xce, kUint64 = 0xcf;
constexpr std::uint8_t kInt8 = 0xd0, kInt64 = 0xd3, kString8 = 0xd9, kMap16 = 0xde;

constexpr std::uint8_t kKeys = 11;
constexpr std::uint32_t kMaxStandardId = 0x7ff, kMaxExtendedId = 0x1fffffff;
constexpr std::size_t kMaxClassicPayload = 8;

class Packer {
 public:
  explicit Packer(std::uint8_t* at) : at_(at) {}
  void byte(std::uint8_t value) { *at_++ = value; }
  void key(std::string_view name) {
    byte(static_cast<std::uint8_t>(kFixString | name.size()));
    bytes(name.data(), name.size());
  }
  void flag(std::string_view name, bool value) {
    key(name);
    byte(value ? kTrue : kFalse);
  }
  void bytes(const void* data, std::size_t n) {
    std::memcpy(at_, data, n);
    at_ += n;
  }
  [[nodiscard]] std::uint8_t* at() const { return at_; }

 private:
  std::uint8_t* at_;
};

using Bytes = std::span<const std::uint8_t>;

/// A msgpack scalar; nil, floats and negative numbers are monostate: fine for `timestamp` and `channel`, wrong
/// elsewhere.
using Scalar = std::variant<std::monostate, bool, std::uint64_t, std::string_view, Bytes>;

class Unpacker {
 public:
  explicit Unpacker(Bytes bytes) : rest_(bytes) {}
  [[nodiscard]] bool at_end() const { return rest_.empty(); }

  std::optional<std::uint64_t> big_endian(std::size_t n) {
    if (rest_.size() < n) return std::nullopt;
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < n; ++i) value = value << 8 | rest_[i];
    rest_ = rest_.subspan(n);
    return value;
  }

  std::optional<Bytes> take(std::size_t n) {
    if (rest_.size() < n) return std::nullopt;
    const auto taken = rest_.first(n);
    rest_ = rest_.subspan(n);
    return taken;
  }

  std::optional<std::size_t> map_size() {
    const auto type = big_endian(1);
    if (!type) return std::nullopt;
    if ((*type & 0xf0) == kFixMap) return *type & 0x0f;
    if (*type == kMap16) return big_endian(2);
    return std::nullopt;
  }

  std::optional<Scalar> scalar() {
    const auto type_byte = big_endian(1);
    if (!type_byte) return std::nullopt;
    const auto type = static_cast<std::uint8_t>(*type_byte);
    if (type < kFixMap) return Scalar(std::uint64_t{type});
    if ((type & 0xe0) == kFixString) return string(type & 0x1f);
    if (type >= 0xe0) return Scalar();  // negative fixint
    switch (type) {
      case kNil:
        return Scalar();
      case kFalse:
        return Scalar(false);
      case kTrue:
        return Scalar(true);
      case kUint8:
        return number(1);
      case kUint16:
        return number(2);
      case kUint32:
        return number(4);
      case kUint64:
        return number(8);
      case kFloat32:
        return skip(4);
      case kFloat64:
        return skip(8);
      case kString8: {
        const auto n = big_endian(1);
        return n ? string(*n) : std::nullopt;
      }
      case kBin8: {
        const auto n = big_endian(1);
        if (!n) return std::nullopt;
        const auto taken = take(*n);
        return taken ? std::optional(Scalar(*taken)) : std::nullopt;
      }
      default:
        if (type >= kInt8 && type <= kInt64) return skip(std::size_t{1} << (type - kInt8));
        return std::nullopt;
    }
  }

 private:
  std::optional<Scalar> number(std::size_t n) {
    const auto value = big_endian(n);
    return value ? std::optional(Scalar(*value)) : std::nullopt;
  }
  std::optional<Scalar> skip(std::size_t n) { return take(n) ? std::optional(Scalar()) : std::nullopt; }
  std::optional<Scalar> string(std::size_t n) {
    const auto taken = take(n);
    if (!taken) return std::nullopt;
    return Scalar(std::string_view(reinterpret_cast<const char*>(taken->data()), n));
  }

  Bytes rest_;
};

template <typename T, typename Target>
bool set(const Scalar& value, Target& target) {
  const T* given = std::get_if<T>(&value);
  if (given) target = *given;
  return given != nullptr;
}

struct Fields {
  std::optional<std::uint64_t> id, dlc;
  std::optional<Bytes> data;
};

bool read_field(std::string_view key, const Scalar& value, Fields& fields, Frame& frame) {
  const bool number = std::holds_alternative<std::uint64_t>(value) || std::holds_alternative<std::monostate>(value);
  if (key == "timestamp") return number;
  if (key == "channel") return number || std::holds_alternative<std::string_view>(value);
  if (key == "is_extended_id") return set<bool>(value, frame.extended);
  if (key == "is_remote_frame") return set<bool>(value, frame.remote);
  if (key == "is_error_frame") return set<bool>(value, frame.error);
  if (key == "is_fd") return set<bool>(value, frame.fd);
  if (key == "bitrate_switch") return set<bool>(value, frame.bit_rate_switch);
  if (key == "error_state_indicator") return set<bool>(value, frame.error_state);
  if (key == "arbitration_id") return set<std::uint64_t>(value, fields.id);
  if (key == "dlc") return set<std::uint64_t>(value, fields.dlc);
  if (key == "data") return set<Bytes>(value, fields.data);
  return false;
}

}  // namespace

std::size_t encode_datagram(const Frame& frame, std::span<std::uint8_t, kMaxDatagram> out) noexcept {
  Packer packer(out.data());
  packer.byte(kFixMap | kKeys);
  packer.key("timestamp");
  packer.byte(kFloat64);
  constexpr std::uint64_t kZero = 0;
  packer.bytes(&kZero, sizeof kZero);
  packer.key("arbitration_id");
  packer.byte(kUint32);
  for (int shift = 24; shift >= 0; shift -= 8) packer.byte(static_cast<std::uint8_t>(frame.id >> shift));
  packer.flag("is_extended_id", frame.extended);
  packer.flag("is_remote_frame", frame.remote);
  packer.flag("is_error_frame", frame.error);
  packer.key("channel");
  packer.byte(kNil);
  packer.key("dlc");
  packer.byte(frame.length);  // at most 64, a positive fixint
  packer.key("data");
  packer.byte(kBin8);
  packer.byte(frame.length);
  packer.bytes(frame.data.data(), frame.length);
  packer.flag("is_fd", frame.fd);
  packer.flag("bitrate_switch", frame.bit_rate_switch);
  packer.flag("error_state_indicator", frame.error_state);
  return static_cast<std::size_t>(packer.at() - out.data());
}

bool decode_datagram(std::span<const std::uint8_t> datagram, Frame& frame) noexcept {
  Unpacker unpacker(datagram);
  Frame read;
  read.extended = true;  // what python-can assumes of a missing key
  read.fd = read.bit_rate_switch = false;
  Fields fields;
  const auto n_keys = unpacker.map_size();
  if (!n_keys || *n_keys > kKeys) return false;
  for (std::size_t i = 0; i < *n_keys; ++i) {
    const auto key = unpacker.scalar();
    const auto* name = key ? std::get_if<std::string_view>(&*key) : nullptr;
    if (!name) return false;
    const auto value = unpacker.scalar();
    if (!value || !read_field(*name, *value, fields, read)) return false;
  }
  if (!unpacker.at_end() || !fields.id || !fields.data) return false;
  if (*fields.id > (read.extended ? kMaxExtendedId : kMaxStandardId)) return false;
  const std::size_t length = fields.data->size();
  if (length > (read.fd ? Frame::kMaxPayload : kMaxClassicPayload)) return false;
  if (fields.dlc && *fields.dlc != length && !read.remote) return false;
  read.id = static_cast<std::uint32_t>(*fields.id);
  read.length = static_cast<std::uint8_t>(length);
  std::ranges::copy(*fields.data, read.data.begin());
  frame = read;
  return true;
}

}  // namespace crux
