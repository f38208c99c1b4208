/// Affine forms: numbers that are linear in where in a box some variables are, but for a rest that is bounded.
#ifndef CRUX_PLANNER_AFFINE_HPP
#define CRUX_PLANNER_AFFINE_HPP

#include <array>
#include <cmath>
#include <cstddef>

namespace crux {

/// middle + sum of slope[i] e_i + something within +-rest, for all e_i in -1..1: the variables within their box.
template <std::size_t N>
struct Affine {
  double middle = 0.0;
  std::array<double, N> slope{};
  double rest = 0.0;

  Affine() = default;
  explicit Affine(double number) : middle(number) {}

  [[nodiscard]] double radius() const {
    double sum = rest;
    for (const double each : slope) {
      sum += std::abs(each);
    }
    return sum;
  }
  [[nodiscard]] double low() const { return middle - radius(); }
  [[nodiscard]] double high() const { return middle + radius(); }
};

/// a * x + b * y
template <std::size_t N>
Affine<N> combined(double a, const Affine<N>& x, double b, const Affine<N>& y) {
  Affine<N> made(a * x.middle + b * y.middle);
  for (std::size_t i = 0; i < N; ++i) {
    made.slope[i] = a * x.slope[i] + b * y.slope[i];
  }
  made.rest = std::abs(a) * x.rest + std::abs(b) * y.rest;
  return made;
}

/// offset + factor * x, and up to `more` beside it
template <std::size_t N>
Affine<N> moved(const Affine<N>& x, double factor, double offset, double more = 0.0) {
  Affine<N> made = combined(factor, x, 0.0, x);
  made.middle += offset;
  made.rest += more;
  return made;
}

template <std::size_t N>
Affine<N> operator+(const Affine<N>& x, const Affine<N>& y) {
  return combined(1.0, x, 1.0, y);
}
template <std::size_t N>
Affine<N> operator-(const Affine<N>& x, const Affine<N>& y) {
  return combined(1.0, x, -1.0, y);
}
template <std::size_t N>
Affine<N> operator+(const Affine<N>& x, double y) {
  return moved(x, 1.0, y);
}
template <std::size_t N>
Affine<N> operator-(const Affine<N>& x, double y) {
  return moved(x, 1.0, -y);
}
template <std::size_t N>
Affine<N> operator*(double x, const Affine<N>& y) {
  return moved(y, x, 0.0);
}

/// The square of what is off the middle is not negative.
template <std::size_t N>
Affine<N> square(const Affine<N>& x) {
  const double most = x.radius() * x.radius();
  return moved(x, 2 * x.middle, most / 2 - x.middle * x.middle, most / 2);
}

}  // namespace crux

#endif
