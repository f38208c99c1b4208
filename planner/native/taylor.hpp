/// Taylor models of second order: numbers that depend on where in a box some variables are.
///
/// Berz and Hoffstaetter, "Computation and application of Taylor polynomials with interval remainder bounds", Reliable
/// Computing 4, 1998. The bounds leave rounding out: what uses them forgives more than that. Functions of plain numbers
/// beside those of models let one source compute both.
#ifndef CRUX_PLANNER_TAYLOR_HPP
#define CRUX_PLANNER_TAYLOR_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "affine.hpp"

namespace crux {

constexpr std::size_t kLanes = 4;  ///< sums that do not wait for each other

/// middle + sum of slope[i] e_i + sum of bend[i, j] e_i e_j over i <= j + something within +-rest, for e_i in -1..1.
template <std::size_t N>
struct Taylor {
  double middle = 0.0;
  std::array<double, N> slope{};
  std::array<double, N*(N + 1) / 2> bend{};
  double rest = 0.0;

  Taylor() = default;
  explicit Taylor(double number) : middle(number) {}

  static Taylor between(double low, double high) {
    Taylor made((low + high) / 2);
    made.rest = (high - low) / 2;
    return made;
  }

  [[nodiscard]] double sloped() const { return sum_of_sizes(slope); }
  [[nodiscard]] double bent() const { return sum_of_sizes(bend); }
  /// A bound of how far it is from a number.
  [[nodiscard]] double off(double number) const { return std::abs(middle - number) + sloped() + bent() + rest; }
  [[nodiscard]] double low() const { return middle - sloped() - bent() - rest; }
  [[nodiscard]] double high() const { return middle + sloped() + bent() + rest; }

  /// Adds what each variable makes of `bent`.
  void add_bent(std::array<double, N>& to) const {
    for (std::size_t i = 0, at = 0; i < N; at += N - i, ++i) {
      to[i] += std::abs(bend[at]);
      for (std::size_t j = i + 1; j < N; ++j) {
        const double both = std::abs(bend[at + j - i]);
        to[i] += both;
        to[j] += both;
      }
    }
  }

  /// As a form of more variables, of which these have `slots`: squares of variables are within 0..1.
  template <std::size_t M>
  [[nodiscard]] Affine<M> linear(const std::array<std::size_t, N>& slots) const {
    Affine<M> made(middle);
    made.rest = rest;
    std::size_t at = 0;
    for (std::size_t i = 0; i < N; ++i) {
      made.slope[slots[i]] = slope[i];
      made.middle += bend[at] / 2;
      made.rest += std::abs(bend[at]) / 2;
      for (std::size_t j = i + 1; j < N; ++j) {
        made.rest += std::abs(bend[at + j - i]);
      }
      at += N - i;
    }
    return made;
  }

 private:
  template <std::size_t M>
  static double sum_of_sizes(const std::array<double, M>& of) {
    std::array<double, kLanes> sums{};
    for (std::size_t i = 0; i < M; ++i) {
      sums[i % kLanes] += std::abs(of[i]);
    }
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
  }
};

/// a * x + b * y
template <std::size_t N>
Taylor<N> combined(double a, const Taylor<N>& x, double b, const Taylor<N>& y) {
  Taylor<N> made(a * x.middle + b * y.middle);
  for (std::size_t i = 0; i < N; ++i) {
    made.slope[i] = a * x.slope[i] + b * y.slope[i];
  }
  for (std::size_t i = 0; i < x.bend.size(); ++i) {
    made.bend[i] = a * x.bend[i] + b * y.bend[i];
  }
  made.rest = std::abs(a) * x.rest + std::abs(b) * y.rest;
  return made;
}

/// offset + factor * x
template <std::size_t N>
Taylor<N> moved(Taylor<N> x, double factor, double offset) {
  x.middle = offset + factor * x.middle;
  for (double& each : x.slope) {
    each *= factor;
  }
  for (double& each : x.bend) {
    each *= factor;
  }
  x.rest *= std::abs(factor);
  return x;
}

template <std::size_t N>
Taylor<N> operator+(const Taylor<N>& x, const Taylor<N>& y) {
  return combined(1.0, x, 1.0, y);
}
template <std::size_t N>
Taylor<N> operator-(const Taylor<N>& x, const Taylor<N>& y) {
  return combined(1.0, x, -1.0, y);
}
template <std::size_t N>
Taylor<N> operator-(const Taylor<N>& x) {
  return moved(x, -1.0, 0.0);
}
template <std::size_t N>
Taylor<N> operator+(const Taylor<N>& x, double y) {
  return moved(x, 1.0, y);
}
template <std::size_t N>
Taylor<N> operator+(double x, const Taylor<N>& y) {
  return moved(y, 1.0, x);
}
template <std::size_t N>
Taylor<N> operator-(const Taylor<N>& x, double y) {
  return moved(x, 1.0, -y);
}
template <std::size_t N>
Taylor<N> operator-(double x, const Taylor<N>& y) {
  return moved(y, -1.0, x);
}
template <std::size_t N>
Taylor<N> operator*(double x, const Taylor<N>& y) {
  return moved(y, x, 0.0);
}
template <std::size_t N>
Taylor<N> operator/(const Taylor<N>& x, double y) {
  return moved(x, 1.0 / y, 0.0);
}
template <std::size_t N>
Taylor<N> operator*(const Taylor<N>& x, const Taylor<N>& y) {
  Taylor<N> made = combined(y.middle, x, x.middle, y);
  made.middle -= x.middle * y.middle;
  std::size_t at = 0;
  for (std::size_t i = 0; i < N; ++i) {
    made.bend[at] += x.slope[i] * y.slope[i];
    for (std::size_t j = i + 1; j < N; ++j) {
      made.bend[at + j - i] += x.slope[i] * y.slope[j] + x.slope[j] * y.slope[i];
    }
    at += N - i;
  }
  const double xs = x.sloped();
  const double ys = y.sloped();
  const double xb = x.bent();
  const double yb = y.bent();
  made.rest += xs * yb + xb * ys + xb * yb + x.rest * (ys + yb) + y.rest * (xs + xb) + x.rest * y.rest;
  return made;
}

inline double square(double x) { return x * x; }
template <std::size_t N>
Taylor<N> square(const Taylor<N>& x) {
  return x * x;
}

/// A function by its value, slope and second derivative at a number, and a bound of its third derivative.
template <std::size_t N>
Taylor<N> function_of(const Taylor<N>& x, double at, const std::array<double, 4>& derivatives) {
  const auto& [value, slope, bend, third] = derivatives;
  const Taylor<N> off = x - at;
  const double most = x.off(at);
  Taylor<N> made = combined(slope, off, bend / 2, off * off) + value;
  made.rest += third / 6 * most * most * most;
  return made;
}

/// x / y of a y that is at least a positive number wherever it matters, and counts as `floor` where it is less.
inline double quotient(double x, double y, double floor, double /*least*/) { return x / std::max(y, floor); }
template <std::size_t N>
Taylor<N> quotient(const Taylor<N>& x, const Taylor<N>& y, double floor, double least) {
  const double low = std::max({floor, least, y.low()});
  const double at = std::max(y.middle, low);
  const double one = 1.0 / at;
  const double most = 1.0 / low;
  return x * function_of(y, at, {one, -one * one, 2 * one * one * one, 6 * most * most * most * most});
}

constexpr double kNear = 1e-3;  ///< a share of a number below which a series about it does not lead

/// Square root of what is at least a number wherever it matters.
inline double root(double x, double /*least*/ = 0.0) { return std::sqrt(std::max(x, 0.0)); }
template <std::size_t N>
Taylor<N> root(const Taylor<N>& x, double least = 0.0) {
  const double low = std::max(x.low(), least);
  if (low <= kNear * std::abs(x.middle)) {
    return Taylor<N>::between(0.0, std::sqrt(std::max(x.high(), 0.0)));
  }
  const double at = std::max(x.middle, low);
  const double value = std::sqrt(at);
  return function_of(x, at, {value, 0.5 / value, -0.25 / (at * value), 0.375 / (low * low * std::sqrt(low))});
}

template <std::size_t N>
Taylor<N> cos(const Taylor<N>& x) {
  const double c = std::cos(x.middle);
  return function_of(x, x.middle, {c, -std::sin(x.middle), -c, 1.0});
}
template <std::size_t N>
Taylor<N> sin(const Taylor<N>& x) {
  const double s = std::sin(x.middle);
  return function_of(x, x.middle, {s, std::cos(x.middle), -s, 1.0});
}

/// Length of a vector, and its direction as a cosine and a sine.
template <class T>
struct Polar {
  T length, cosine, sine;
};
inline Polar<double> polar(double x, double y) {
  const double length = std::sqrt(x * x + y * y);
  return {length, x / std::max(length, 1e-9), y / std::max(length, 1e-9)};
}
/// By the tangent of the angle off the direction in the middle.
template <std::size_t N>
Polar<Taylor<N>> polar(const Taylor<N>& x, const Taylor<N>& y) {
  const Polar<double> middle = polar(x.middle, y.middle);
  const double c = middle.cosine;
  const double s = middle.sine;
  const Taylor<N> along = combined(c, x, s, y);
  const Taylor<N> across = combined(c, y, -s, x);
  if (along.low() > kNear * along.middle) {
    const Taylor<N> tangent = quotient(across, along, 0.0, 0.0);
    const Taylor<N> longer = root(1.0 + tangent * tangent, 1.0);
    const Taylor<N> cosine = quotient(Taylor<N>(1.0), longer, 1.0, 1.0);
    const Taylor<N> sine = tangent * cosine;
    if (std::max(cosine.off(0.0), sine.off(0.0)) < 2.0) {
      return {along * longer, combined(c, cosine, -s, sine), combined(s, cosine, c, sine)};
    }
  }
  const Taylor<N> any = Taylor<N>::between(-1.0, 1.0);
  return {Taylor<N>::between(0.0, std::hypot(x.off(0.0), y.off(0.0))), any, any};
}

}  // namespace crux

#endif
