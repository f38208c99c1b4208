// A value or the reason why there is none (C++20 has no std::expected).
#pragma once

#include <string>
#include <utility>
#include <variant>

namespace crux {

/// The reason of a refusal, one sentence for the user.
struct Refusal {
  std::string reason;
};

template <class T>
class Result {
 public:
  Result(T value) : content_(std::move(value)) {}            // NOLINT: converting on purpose
  Result(Refusal refusal) : content_(std::move(refusal)) {}  // NOLINT

  explicit operator bool() const { return std::holds_alternative<T>(content_); }
  T& value() { return std::get<T>(content_); }
  const T& value() const { return std::get<T>(content_); }
  /// Empty when there is a value.
  const std::string& reason() const {
    static const std::string kNone;
    const Refusal* refusal = std::get_if<Refusal>(&content_);
    return refusal ? refusal->reason : kNone;
  }

 private:
  std::variant<T, Refusal> content_;
};

}  // namespace crux
