/// Where in a box conditions may hold: each is an affine form that must not be negative, or a point that is off a box.
#ifndef CRUX_PLANNER_RANGE_HPP
#define CRUX_PLANNER_RANGE_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "affine.hpp"
#include "taylor.hpp"
#include "vector.hpp"

namespace crux {

constexpr double kForgiven = 1e-9;  ///< more than what rounding makes of any condition
constexpr int kRounds = 2;          ///< of cuts by each condition
constexpr int kSums = 4;            ///< of conditions that cut a range
constexpr double kGain = 0.6;       ///< by which forms that lack more weigh more
constexpr int kCover = 1;           ///< steps of a direction's components
constexpr double kCovered = 0.886;  ///< cosine to the nearest direction of the cover, or less

/// A point is off the box |x| <= half by a distance; a half of 0 makes the box a point.
template <class T>
struct Apart {
  Vec<T> point;
  Vector half;
  double by_m;
};

/// The square of how far a point is off the box |x| <= half.
inline double squared_off(const Vector& point, const Vector& half) {
  double squared = 0.0;
  for (std::size_t a = 0; a < 3; ++a) {
    squared += square(std::max(std::abs(point[a]) - half[a], 0.0));
  }
  return squared;
}

/// The same or more.
template <std::size_t N>
Affine<N> squared_off(const Vec<Affine<N>>& point, const Vector& half) {
  Affine<N> squared;
  for (std::size_t a = 0; a < 3; ++a) {
    const Affine<N> beyond = std::copysign(1.0, point[a].middle) * point[a] - half[a];  // of the nearer face
    const double low = beyond.low();
    const double high = beyond.high();
    const double other = -2 * half[a] - low;
    if (low >= 0.0 || half[a] == 0.0) {
      squared = squared + square(beyond);
    } else if (other > 0.0) {
      squared = squared + square(std::max(high, other));
    } else if (high > 0.0) {
      squared = squared + high * high / (high - low) * (beyond - low);  // the chord of a convex function
    }
  }
  return squared;
}

/// Directions, of which one is near any other, as `kCovered` says, and beyond the same face, edge or corner of a box.
inline const std::vector<Vector>& cover() {
  static const std::vector<Vector> found = [] {
    std::vector<Vector> made;
    for (int x = -kCover; x <= kCover; ++x) {
      for (int y = -kCover; y <= kCover; ++y) {
        for (int z = -kCover; z <= kCover; ++z) {
          if (std::max({std::abs(x), std::abs(y), std::abs(z)}) == kCover) {
            const Vector way{static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
            made.push_back((1.0 / std::sqrt(dot(way, way))) * way);
          }
        }
      }
    }
    return made;
  }();
  return found;
}

/// What is left of -1..1 for each variable of affine forms.
template <std::size_t N>
struct Range {
  std::array<double, N> low, high;

  Range() {
    low.fill(-1.0);
    high.fill(1.0);
  }

  [[nodiscard]] double most(const Affine<N>& form) const {
    double sum = form.middle + form.rest;
    for (std::size_t i = 0; i < N; ++i) {
      sum += std::max(form.slope[i] * low[i], form.slope[i] * high[i]);
    }
    return sum;
  }

  /// To what is in this one or another.
  void widen(const Range& other) {
    for (std::size_t i = 0; i < N; ++i) {
      low[i] = std::min(low[i], other.low[i]);
      high[i] = std::max(high[i], other.high[i]);
    }
  }

  /// Whether it is all of another one, as far as the first `count` variables go.
  [[nodiscard]] bool covers(const Range& other, std::size_t count = N) const {
    for (std::size_t i = 0; i < count; ++i) {
      if (low[i] > other.low[i] || high[i] < other.high[i]) {
        return false;
      }
    }
    return true;
  }

  /// Cuts it to where a form may not be negative. False: nowhere.
  bool cut(const Affine<N>& form, double forgiven = kForgiven) {
    const double sum = most(form) + forgiven;
    if (sum < 0.0) {
      return false;
    }
    for (std::size_t i = 0; i < N; ++i) {
      const double slope = form.slope[i];
      if (std::abs(slope) * (high[i] - low[i]) > sum) {
        (slope > 0.0 ? low[i] : high[i]) = (slope > 0.0 ? high[i] : low[i]) - sum / slope;
      }
    }
    return true;
  }

  /// By all of some forms, and by sums of them, which tell more than each alone.
  bool cut(const std::vector<Affine<N>>& forms) {
    for (int i = 0; i < kRounds; ++i) {
      if (!std::all_of(forms.begin(), forms.end(), [this](const Affine<N>& each) { return cut(each); })) {
        return false;
      }
    }
    std::vector<double> weight(forms.size());
    std::transform(forms.begin(), forms.end(), weight.begin(), [](const auto& each) { return scale(each); });
    for (int i = 0; i < kSums; ++i) {
      Affine<N> sum;
      for (std::size_t k = 0; k < forms.size(); ++k) {
        sum = combined(1.0, sum, weight[k], forms[k]);
      }
      double total = 0.0;
      for (const double each : weight) {
        total += each;
      }
      if (!cut(sum, kForgiven * total)) {
        return false;
      }
      weigh_again(forms, sum, weight);
    }
    return true;
  }

  /// By all of some forms, and by a point that is off a box: so it is along one of the directions of `cover`.
  bool cut(const Apart<Affine<N>>& apart, std::vector<Affine<N>> forms) {
    std::optional<Range> left;
    forms.emplace_back();
    for (const Vector& way : cover()) {
      forms.back() = Affine<N>(-kCovered * apart.by_m);
      for (std::size_t a = 0; a < 3; ++a) {
        forms.back() = forms.back() + (way[a] * apart.point[a] - std::abs(way[a]) * apart.half[a]);
      }
      Range along = *this;
      if (most(forms.back()) >= -kForgiven && along.cut(forms)) {
        left.has_value() ? left->widen(along) : void(left = along);
        if (left->covers(*this)) {
          return true;
        }
      }
    }
    if (left.has_value()) {
      *this = *left;
    }
    return left.has_value();
  }

 private:
  static double scale(const Affine<N>& form) { return 1.0 / (form.radius() + kForgiven); }

  /// More to the forms that lack where a sum of them is greatest.
  void weigh_again(const std::vector<Affine<N>>& forms, const Affine<N>& sum, std::vector<double>& weight) const {
    for (std::size_t k = 0; k < forms.size(); ++k) {
      double there = forms[k].middle + forms[k].rest;
      for (std::size_t i = 0; i < N; ++i) {
        there += forms[k].slope[i] * (sum.slope[i] > 0.0 ? high[i] : low[i]);
      }
      weight[k] *= 1.0 - kGain * std::clamp(there * scale(forms[k]), -1.0, 1.0);
    }
  }
};

}  // namespace crux

#endif
