// Streams behind the generated CDR functions. XCDR1, little-endian: every primitive is aligned to its own size,
// counted from the end of the encapsulation header; a string carries its length with the closing zero; a sequence
// carries its length.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace crux_msgs::cdr {

static_assert(std::endian::native == std::endian::little, "the streams copy values as they lie in memory");

inline constexpr std::array<std::uint8_t, 4> kEncapsulation = {0x00, 0x01, 0x00, 0x00};

template <class Message, class Type>
concept Is = std::same_as<std::remove_const_t<Message>, Type>;

/// What the three streams share: `Derived::bytes(pointer, size, alignment)` moves or counts a run of equal primitives.
template <class Derived>
class Stream {
 public:
  template <class T>
  void value(T& x) {
    if constexpr (std::is_arithmetic_v<T>) {
      self().bytes(&x, sizeof(T), sizeof(T));
    } else if constexpr (Is<T, std::string>) {
      self().string(x);
    } else {
      visit(self(), x);
    }
  }

  template <class T, std::size_t N>
  void array(T (&xs)[N]) {
    elements(xs, N);
  }

  template <class T>
  void elements(T* xs, std::size_t count) {
    if constexpr (std::is_arithmetic_v<T>) {
      if (count > 0) self().bytes(xs, count * sizeof(T), sizeof(T));
    } else {
      for (std::size_t i = 0; i < count; ++i) value(xs[i]);
    }
  }

 protected:
  /// A zero at the end and nowhere else: LCM could not carry another one.
  static bool is_text(std::span<const std::uint8_t> bytes) {
    return std::ranges::find(bytes, std::uint8_t{0}) - bytes.begin() + 1 == std::ssize(bytes);
  }
  static std::size_t padding(std::size_t position, std::size_t alignment) {
    return (alignment - position % alignment) % alignment;
  }

 private:
  Derived& self() { return static_cast<Derived&>(*this); }
};

/// Counts the bytes of a message.
class Sizer : public Stream<Sizer> {
 public:
  void bytes(const void*, std::size_t size, std::size_t alignment) {
    position_ += padding(position_, alignment) + size;
  }
  void string(const std::string& text) {
    length();
    position_ += text.size() + 1;
  }
  template <class T, class Length>
  void sequence(const std::vector<T>& items, Length) {
    length();
    elements(items.data(), items.size());
  }
  [[nodiscard]] std::size_t finish() const { return position_ + kEncapsulation.size(); }

 private:
  void length() { position_ += padding(position_, 4) + 4; }
  std::size_t position_ = 0;
};

/// Writes a message into a buffer of the caller's.
class Writer : public Stream<Writer> {
 public:
  explicit Writer(std::span<std::uint8_t> out) : out_(out) {
    if (out_.size() < kEncapsulation.size()) {
      fits_ = false;
      return;
    }
    std::ranges::copy(kEncapsulation, out_.begin());
    out_ = out_.subspan(kEncapsulation.size());
  }
  void bytes(const void* from, std::size_t size, std::size_t alignment) {
    const std::size_t pad = padding(position_, alignment);
    if (!fits_ || out_.size() - position_ < pad + size) {
      fits_ = false;
      return;
    }
    std::memset(out_.data() + position_, 0, pad);
    std::memcpy(out_.data() + position_ + pad, from, size);
    position_ += pad + size;
  }
  void string(const std::string& text) {
    length(text.size() + 1);
    bytes(text.c_str(), text.size() + 1, 1);
  }
  template <class T, class Length>
  void sequence(const std::vector<T>& items, Length) {
    length(items.size());
    elements(items.data(), items.size());
  }
  [[nodiscard]] std::size_t finish() const { return fits_ ? position_ + kEncapsulation.size() : 0; }

 private:
  void length(std::size_t count) {
    const auto n = static_cast<std::uint32_t>(count);
    bytes(&n, 4, 4);
  }
  std::span<std::uint8_t> out_;
  std::size_t position_ = 0;
  bool fits_ = true;
};

/// Reads a message from bytes that may be damaged.
class Reader : public Stream<Reader> {
 public:
  explicit Reader(std::span<const std::uint8_t> in) : in_(in) {
    good_ =
        in_.size() >= kEncapsulation.size() && std::equal(kEncapsulation.begin(), kEncapsulation.end(), in_.begin());
    if (good_) in_ = in_.subspan(kEncapsulation.size());
  }
  void bytes(void* to, std::size_t size, std::size_t alignment) {
    const std::size_t pad = padding(position_, alignment);
    if (!good_ || left() < pad + size) {
      good_ = false;
      return;
    }
    std::memcpy(to, in_.data() + position_ + pad, size);
    position_ += pad + size;
  }
  void string(std::string& text) {
    const std::size_t n = length();
    if (!good_ || left() < n || !is_text(in_.subspan(position_, n))) {
      good_ = false;
      return;
    }
    text.assign(reinterpret_cast<const char*>(in_.data()) + position_, n - 1);
    position_ += n;
  }
  template <class T, class Length>
  void sequence(std::vector<T>& items, Length expected) {
    const std::size_t n = length();
    if (!good_ || n > left() || !std::cmp_equal(n, expected)) {
      good_ = false;
      return;
    }
    items.clear();
    if constexpr (std::is_arithmetic_v<T>) {
      items.resize(n);
      elements(items.data(), n);
    } else {
      // One by one: memory grows no faster than bytes are used up.
      for (std::size_t i = 0; i < n && good_; ++i) value(items.emplace_back());
    }
  }
  [[nodiscard]] bool finish() const { return good_ && left() == 0; }

 private:
  [[nodiscard]] std::size_t left() const { return in_.size() - position_; }
  std::size_t length() {
    std::uint32_t n = 0;
    bytes(&n, 4, 4);
    return good_ ? n : 0;
  }
  std::span<const std::uint8_t> in_;
  std::size_t position_ = 0;
  bool good_ = true;
};

/// Reads an LCM message from bytes that may be hostile: big-endian, unaligned, the type's fingerprint first; a string
/// carries its length with the closing zero, a sequence has its length in a field of its own.
class LcmReader : public Stream<LcmReader> {
 public:
  LcmReader(std::span<const std::uint8_t> in, std::int64_t fingerprint) : in_(in) {
    std::int64_t found = 0;
    bytes(&found, sizeof found, sizeof found);
    good_ = good_ && found == fingerprint;
  }
  void bytes(void* to, std::size_t size, std::size_t element) {
    if (!good_ || in_.size() < size) {
      good_ = false;
      return;
    }
    auto* out = static_cast<std::uint8_t*>(to);
    for (std::size_t i = 0; i < size; i += element) std::reverse_copy(&in_[i], &in_[i] + element, out + i);
    in_ = in_.subspan(size);
  }
  void string(std::string& text) {
    std::int32_t n = 0;
    bytes(&n, sizeof n, sizeof n);
    if (!good_ || n < 1 || std::cmp_greater(n, in_.size()) || !is_text(in_.first(static_cast<std::size_t>(n)))) {
      good_ = false;
      return;
    }
    text.assign(reinterpret_cast<const char*>(in_.data()), static_cast<std::size_t>(n) - 1);
    in_ = in_.subspan(static_cast<std::size_t>(n));
  }
  template <class T, class Length>
  void sequence(std::vector<T>& items, Length n) {
    // An element takes a byte at least, and elements are read one by one: memory grows no faster than bytes are used
    // up.
    if (!good_ || std::cmp_less(n, 0) || std::cmp_greater(n, in_.size())) {
      good_ = false;
      return;
    }
    items.clear();
    if constexpr (std::is_arithmetic_v<T>) {
      items.resize(static_cast<std::size_t>(n));
      elements(items.data(), items.size());
    } else {
      for (Length i = 0; i < n && good_; ++i) value(items.emplace_back());
    }
  }
  [[nodiscard]] bool finish() const { return good_ && in_.empty(); }

 private:
  std::span<const std::uint8_t> in_;
  bool good_ = true;
};

}  // namespace crux_msgs::cdr
