#include "stage_system.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

// Columns are eliminated one by one. What is left is x[0] = 0, x[k + 1] = free x[k] - supply m[k] + offset, with m[k]
// the slope of all that comes after: a Riccati recursion.

namespace crux {
namespace {

constexpr std::size_t kLimbs = CRUX_STAGE_LIMBS;
constexpr std::size_t kStates = CRUX_STAGE_STATES;
constexpr std::size_t kColumn = CRUX_STAGE_COLUMN;
constexpr std::size_t kActing = CRUX_STAGE_ACTING;
constexpr std::size_t kSquare = kStates * kStates;
constexpr std::size_t kBoth = kStates * kColumn;

using State = std::array<double, kStates>;
using Square = std::array<double, kSquare>;

/// LU factors with row pivots; numbers that are not finite where the matrix is singular.
template <std::size_t n>
struct Lu {
  std::array<double, n * n> a;
  std::array<std::size_t, n> pivots;

  /// Of what is in `a`; false where a pivot is 0.
  bool factor() {
    bool regular = true;
    for (std::size_t j = 0; j < n; ++j) {
      std::size_t best = j;
      for (std::size_t i = j + 1; i < n; ++i) {
        best = std::abs(a[i * n + j]) > std::abs(a[best * n + j]) ? i : best;
      }
      pivots[j] = best;
      if (best != j) {
        std::swap_ranges(&a[j * n], &a[j * n] + n, &a[best * n]);
      }
      regular = regular && a[j * n + j] != 0.0;
      for (std::size_t i = j + 1; i < n; ++i) {
        const double share = a[i * n + j] /= a[j * n + j];
        for (std::size_t k = j + 1; k < n; ++k) {
          a[i * n + k] -= share * a[j * n + k];
        }
      }
    }
    return regular;
  }

  /// Solves for `columns` right sides (n, columns), in place.
  template <std::size_t columns>
  void solve(double* x) const {
    for (std::size_t j = 0; j < n; ++j) {
      if (pivots[j] != j) {
        std::swap_ranges(x + j * columns, x + (j + 1) * columns, x + pivots[j] * columns);
      }
    }
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t k = 0; k < i; ++k) {
        take(x + i * columns, a[i * n + k], x + k * columns, columns);
      }
    }
    for (std::size_t i = n; i-- > 0;) {
      for (std::size_t k = i + 1; k < n; ++k) {
        take(x + i * columns, a[i * n + k], x + k * columns, columns);
      }
      for (std::size_t c = 0; c < columns; ++c) {
        x[i * columns + c] /= a[i * n + i];
      }
    }
  }

 private:
  static void take(double* from, double share, const double* other, std::size_t count) {
    for (std::size_t c = 0; c < count; ++c) {
      from[c] -= share * other[c];
    }
  }
};

/// What is kept of a knot.
struct Knot {
  std::array<std::array<double, kColumn * kColumn>, kLimbs> inverse;
  std::array<std::array<double, kBoth>, kLimbs> cross_inverse, into_inverse;
  Lu<kStates> chain;  ///< of 1 + value supply
  Square value;       ///< of the state that the knot leads to
  Square gain, free, supply, closed;
};
static_assert(sizeof(Knot) % sizeof(double) == 0);

/// out (rows, columns) += sign a (rows, inner) b (inner, columns).
template <std::size_t rows, std::size_t inner, std::size_t columns>
void add(double* out, double sign, const double* a, std::size_t stride, const double* b) {
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t k = 0; k < inner; ++k) {
      const double share = sign * a[i * stride + k];
      for (std::size_t j = 0; j < columns; ++j) {
        out[i * columns + j] += share * b[k * columns + j];
      }
    }
  }
}

/// out (columns) += sign aᵀ (columns, rows) x (rows).
template <std::size_t rows, std::size_t columns>
void add_back(double* out, double sign, const double* a, const double* x) {
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      out[j] += sign * x[i] * a[i * columns + j];
    }
  }
}

/// Column number `j` of a matrix.
State column(const Square& a, std::size_t j) {
  State found;
  for (std::size_t i = 0; i < kStates; ++i) {
    found[i] = a[i * kStates + j];
  }
  return found;
}

/// The first numbers of the columns of a (12, 8), as rows (5, 12).
std::array<double, kActing * kStates> acting(const double* a) {
  std::array<double, kActing * kStates> found;
  for (std::size_t i = 0; i < kStates; ++i) {
    for (std::size_t j = 0; j < kActing; ++j) {
      found[j * kStates + i] = a[i * kColumn + j];
    }
  }
  return found;
}

/// Takes a knot's columns out of its state's Hessian and of what leads to the next state.
bool eliminate(const crux_stages& stages, std::size_t k, Knot& knot, Square& hessian) {
  std::copy_n(stages.state_map + k * kSquare, kSquare, knot.free.begin());
  knot.supply.fill(0.0);
  for (std::size_t limb = 0; limb < kLimbs; ++limb) {
    const std::size_t at = k * kLimbs + limb;
    const double* cross = stages.cross + at * kBoth;
    const double* into = stages.into_state + at * kBoth;
    Lu<kColumn> own;
    std::copy_n(stages.column_hessian + at * kColumn * kColumn, kColumn * kColumn, own.a.begin());
    auto& inverse = knot.inverse[limb];
    inverse.fill(0.0);
    for (std::size_t i = 0; i < kColumn; ++i) {
      inverse[i * kColumn + i] = 1.0;
    }
    if (!own.factor()) {
      return false;
    }
    own.solve<kColumn>(inverse.data());
    knot.cross_inverse[limb].fill(0.0);
    knot.into_inverse[limb].fill(0.0);
    add<kStates, kActing, kColumn>(knot.cross_inverse[limb].data(), 1.0, cross, kColumn, inverse.data());
    add<kStates, kActing, kColumn>(knot.into_inverse[limb].data(), 1.0, into, kColumn, inverse.data());
    const auto by_state = acting(cross);
    const auto by_next = acting(into);
    add<kStates, kActing, kStates>(hessian.data(), -1.0, knot.cross_inverse[limb].data(), kColumn, by_state.data());
    add<kStates, kActing, kStates>(knot.free.data(), -1.0, knot.into_inverse[limb].data(), kColumn, by_state.data());
    add<kStates, kActing, kStates>(knot.supply.data(), 1.0, knot.into_inverse[limb].data(), kColumn, by_next.data());
  }
  return true;
}

/// From the value of the state that a knot leads to, to that of its own.
void recede(Knot& knot, const Square& hessian, Square& value) {
  knot.value = value;
  knot.chain.a.fill(0.0);
  for (std::size_t i = 0; i < kStates; ++i) {
    knot.chain.a[i * kStates + i] = 1.0;
  }
  add<kStates, kStates, kStates>(knot.chain.a.data(), 1.0, value.data(), kStates, knot.supply.data());
  knot.chain.factor();
  knot.gain.fill(0.0);
  add<kStates, kStates, kStates>(knot.gain.data(), 1.0, value.data(), kStates, knot.free.data());
  knot.chain.solve<kStates>(knot.gain.data());
  Square own = hessian;
  for (std::size_t i = 0; i < kStates; ++i) {
    add_back<kStates, kStates>(&own[i * kStates], 1.0, knot.gain.data(), column(knot.free, i).data());
  }
  for (std::size_t i = 0; i < kStates; ++i) {
    for (std::size_t j = 0; j < kStates; ++j) {
      value[i * kStates + j] = (own[i * kStates + j] + own[j * kStates + i]) / 2;
    }
  }
  knot.closed = knot.free;
  add<kStates, kStates, kStates>(knot.closed.data(), -1.0, knot.supply.data(), kStates, knot.gain.data());
}

}  // namespace
}  // namespace crux

using crux::kBoth;
using crux::kColumn;
using crux::kLimbs;
using crux::Knot;
using crux::kStates;

int64_t crux_stage_factors(void) { return sizeof(Knot) / sizeof(double); }

int crux_stage_factor(const crux_stages* stages, double* factors) {
  auto* const knots = reinterpret_cast<Knot*>(factors);
  const auto n = static_cast<std::size_t>(stages->knots);
  crux::Square value;
  std::copy_n(stages->state_hessian + n * crux::kSquare, crux::kSquare, value.begin());
  for (std::size_t k = n; k-- > 0;) {
    crux::Square hessian;
    std::copy_n(stages->state_hessian + k * crux::kSquare, crux::kSquare, hessian.begin());
    if (!crux::eliminate(*stages, k, knots[k], hessian)) {
      return 0;
    }
    crux::recede(knots[k], hessian, value);
  }
  return 1;
}

void crux_stage_solve(const crux_stages* stages, const double* factors, const double* state_slope,
                      const double* column_slope, const double* defects, double* states, double* columns,
                      double* multipliers) {
  const auto* const knots = reinterpret_cast<const Knot*>(factors);
  const auto n = static_cast<std::size_t>(stages->knots);
  crux::State push;  // of all that comes after
  std::copy_n(state_slope + n * kStates, kStates, push.begin());
  for (std::size_t k = n; k-- > 0;) {  // multipliers: what they are at a state of 0; states: offsets
    const Knot& knot = knots[k];
    double* shift = multipliers + k * kStates;
    double* offset = states + (k + 1) * kStates;
    crux::State slope;
    std::copy_n(state_slope + k * kStates, kStates, slope.begin());
    std::copy_n(defects + k * kStates, kStates, offset);
    for (std::size_t limb = 0; limb < kLimbs; ++limb) {
      const double* own = column_slope + (k * kLimbs + limb) * kColumn;
      crux::add<kStates, kColumn, 1>(slope.data(), -1.0, knot.cross_inverse[limb].data(), kColumn, own);
      crux::add<kStates, kColumn, 1>(offset, -1.0, knot.into_inverse[limb].data(), kColumn, own);
    }
    std::copy_n(push.begin(), kStates, shift);
    crux::add<kStates, kStates, 1>(shift, 1.0, knot.value.data(), kStates, offset);
    knot.chain.solve<1>(shift);
    push = slope;
    crux::add_back<kStates, kStates>(push.data(), 1.0, knot.free.data(), shift);
    crux::add<kStates, kStates, 1>(offset, -1.0, knot.supply.data(), kStates, shift);
  }
  std::fill_n(states, kStates, 0.0);
  for (std::size_t k = 0; k < n; ++k) {
    const Knot& knot = knots[k];
    const double* state = states + k * kStates;
    double* multiplier = multipliers + k * kStates;
    crux::add<kStates, kStates, 1>(states + (k + 1) * kStates, 1.0, knot.closed.data(), kStates, state);
    crux::add<kStates, kStates, 1>(multiplier, 1.0, knot.gain.data(), kStates, state);
    for (std::size_t limb = 0; limb < kLimbs; ++limb) {
      const std::size_t at = k * kLimbs + limb;
      std::array<double, kColumn> slope;
      std::copy_n(column_slope + at * kColumn, kColumn, slope.begin());
      crux::add_back<kStates, kColumn>(slope.data(), 1.0, stages->cross + at * kBoth, state);
      crux::add_back<kStates, kColumn>(slope.data(), 1.0, stages->into_state + at * kBoth, multiplier);
      std::fill_n(columns + at * kColumn, kColumn, 0.0);
      crux::add<kColumn, kColumn, 1>(columns + at * kColumn, -1.0, knot.inverse[limb].data(), kColumn, slope.data());
    }
  }
}
