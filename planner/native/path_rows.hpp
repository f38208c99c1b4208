/// The rows of the program in path.h: what they are at, and their transpose.
#ifndef CRUX_PLANNER_PATH_ROWS_HPP
#define CRUX_PLANNER_PATH_ROWS_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "path.h"

namespace crux {

inline constexpr std::size_t kSize = CRUX_PATH_GRIP;  // numbers of a grip, and rows of a balance
inline constexpr double kFixed = 1e-9;                // ends of an interval this close fix what is in it

using Vector = std::array<double, 3>;
using Column = std::array<double, kSize>;

/// The variables: places (3) of nodes, numbers of grips; or what is like them.
struct Variables {
  std::vector<Vector> place;
  std::vector<Column> grip;
  std::vector<Column> balance;  ///< multipliers, or residuals, a node

  Variables(std::size_t nodes, std::size_t grips) : place(nodes), grip(grips), balance(nodes) {}
};

/// Rows @ variables <= right, of those that are active.
class PathRows {
 public:
  PathRows(const crux_path_grip* grips, const crux_path_problem& given)
      : grips_(grips),
        given_(given),
        nodes_(static_cast<std::size_t>(given.nodes)),
        on_(static_cast<std::size_t>(given.first[given.nodes])),
        fixed_(nodes_),
        middle_(nodes_) {
    set_ends();
  }

  [[nodiscard]] const crux_path_problem& given() const { return given_; }
  [[nodiscard]] std::size_t nodes() const { return nodes_; }
  [[nodiscard]] std::size_t on() const { return on_; }
  [[nodiscard]] std::size_t count() const { return right_.size(); }
  [[nodiscard]] double right(std::size_t row) const { return right_[row]; }
  [[nodiscard]] bool active(std::size_t row) const { return active_[row]; }
  [[nodiscard]] bool fixed(std::size_t k, std::size_t axis) const { return fixed_[k][axis]; }
  [[nodiscard]] bool consistent() const { return consistent_; }
  [[nodiscard]] const std::vector<Vector>& middle() const { return middle_; }
  [[nodiscard]] const crux_path_grip& grip(std::size_t t) const { return grips_[given_.on[t]]; }
  [[nodiscard]] std::size_t first(std::size_t k) const { return static_cast<std::size_t>(given_.first[k]); }
  [[nodiscard]] bool carries(std::size_t k) const { return first(k) < first(k + 1); }
  [[nodiscard]] double active_count() const {
    return static_cast<double>(std::count(active_.begin(), active_.end(), true));
  }

  /// Calls `place(k, direction (3), row)`, whose row + 1 is the other end, `edge(k, axis, row)` likewise,
  /// `limit(t, coefficients, row)` and `bound(t, i, row)` likewise, for all rows in order.
  template <class Place, class Edge, class Limit, class Bound>
  void each_row(Place place, Edge edge, Limit limit, Bound bound) const {
    std::size_t row = 0;
    for (std::size_t k = 0; k < nodes_; ++k) {
      for (std::size_t d = 0; d < directions(); ++d, row += 2) {
        place(k, given_.direction + 3 * d, row);
      }
      for (std::size_t a = 0; a < 3 && k + 1 < nodes_; ++a, row += 2) {
        edge(k, a, row);
      }
      for (std::size_t t = first(k); t < first(k + 1); ++t) {
        for (std::size_t i = 0; i < static_cast<std::size_t>(grip(t).rows); ++i, ++row) {
          limit(t, grip(t).limits + kSize * i, row);
        }
        for (std::size_t i = 0; i < kSize; ++i, row += 2) {
          bound(t, i, row);
        }
      }
    }
  }

  /// What rows are at.
  void at(const Variables& x, std::vector<double>& value) const {
    const auto both = [&value](std::size_t row, double v) {
      value[row] = v;
      value[row + 1] = -v;
    };
    each_row(
        [&](std::size_t k, const double* d, std::size_t row) {
          const Vector& p = x.place[k];
          both(row, d[0] * p[0] + d[1] * p[1] + d[2] * p[2]);
        },
        [&](std::size_t k, std::size_t a, std::size_t row) { both(row, x.place[k + 1][a] - x.place[k][a]); },
        [&](std::size_t t, const double* c, std::size_t row) {
          double sum = 0.0;
          for (std::size_t i = 0; i < kSize; ++i) {
            sum += c[i] * x.grip[t][i];
          }
          value[row] = sum;
        },
        [&](std::size_t t, std::size_t i, std::size_t row) { both(row, x.grip[t][i]); });
  }

  /// Adds rows' transpose @ v.
  void add_transposed(const std::vector<double>& v, Variables& to) const {
    each_row(
        [&](std::size_t k, const double* d, std::size_t row) {
          for (std::size_t a = 0; a < 3; ++a) {
            to.place[k][a] += d[a] * (v[row] - v[row + 1]);
          }
        },
        [&](std::size_t k, std::size_t a, std::size_t row) {
          to.place[k + 1][a] += v[row] - v[row + 1];
          to.place[k][a] -= v[row] - v[row + 1];
        },
        [&](std::size_t t, const double* c, std::size_t row) {
          for (std::size_t i = 0; i < kSize; ++i) {
            to.grip[t][i] += c[i] * v[row];
          }
        },
        [&](std::size_t t, std::size_t i, std::size_t row) { to.grip[t][i] += v[row] - v[row + 1]; });
  }

 private:
  [[nodiscard]] std::size_t directions() const { return static_cast<std::size_t>(given_.directions); }

  /// Ends of the rows, and which places are fixed along an axis, and their middles.
  void set_ends() {
    const auto push = [this](double most, bool active) {
      right_.push_back(most);
      active_.push_back(active && std::isfinite(most));
    };
    for (std::size_t k = 0; k < nodes_; ++k) {
      const double* low = given_.low + directions() * k;
      const double* high = given_.high + directions() * k;
      for (std::size_t d = 0; d < directions(); ++d) {
        const bool fixed = d < 3 && high[d] - low[d] < kFixed;
        if (fixed) {
          fixed_[k][d] = true;
        }
        if (d < 3) {
          middle_[k][d] = (low[d] + high[d]) / 2;
        }
        consistent_ = consistent_ && high[d] - low[d] > -kFixed;
        push(high[d], !fixed);
        push(-low[d], !fixed);
      }
      for (std::size_t a = 0; a < 3 && k + 1 < nodes_; ++a) {
        push(given_.step[k], true);
        push(given_.step[k], true);
      }
      for (std::size_t t = first(k); t < first(k + 1); ++t) {
        for (std::int64_t i = 0; i < grip(t).rows; ++i) {
          push(grip(t).right[i], true);
        }
        for (std::int64_t i = 0; i < static_cast<std::int64_t>(kSize); ++i) {
          push(grip(t).high[i], true);
          push(-grip(t).low[i], true);
        }
      }
    }
  }

  const crux_path_grip* grips_;
  const crux_path_problem& given_;
  std::size_t nodes_, on_;
  std::vector<std::array<bool, 3>> fixed_;
  std::vector<Vector> middle_;
  std::vector<double> right_;
  std::vector<bool> active_;
  bool consistent_ = true;
};

}  // namespace crux

#endif
