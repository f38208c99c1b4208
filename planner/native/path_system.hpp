/// The Newton system of the program in path.h, reduced grip by grip to the balance of a node, node by node to its
/// place. The places form a chain of 3 x 3 blocks: the time grows linearly with the nodes.
#ifndef CRUX_PLANNER_PATH_SYSTEM_HPP
#define CRUX_PLANNER_PATH_SYSTEM_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "path_rows.hpp"

namespace crux {

inline constexpr double kRegularisation = 1e-8;  // of all variables, as crux_planner/solvers/qp.py has it
inline constexpr double kPivot = 1e-18;          // as a share of the largest pivot, what every one is at least

using Block = std::array<double, 9>;
using Square = std::array<double, kSize * kSize>;

/// Lower Cholesky factor in place; small pivots are replaced.
template <std::size_t n>
void factorise(double* a) {
  double largest = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    largest = std::max(largest, a[i * n + i]);
  }
  const double least = std::max(kPivot * largest, std::numeric_limits<double>::min());
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = j; i < n; ++i) {
      double sum = a[i * n + j];
      for (std::size_t k = 0; k < j; ++k) {
        sum -= a[i * n + k] * a[j * n + k];
      }
      a[i * n + j] = i == j ? std::sqrt(std::max(sum, least)) : sum / a[j * n + j];
    }
  }
}

/// x of (factor factor') x = right, in place.
template <std::size_t n>
void solve(const double* factor, double* x) {
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      x[i] -= factor[i * n + k] * x[k];
    }
    x[i] /= factor[i * n + i];
  }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t k = i + 1; k < n; ++k) {
      x[i] -= factor[k * n + i] * x[k];
    }
    x[i] /= factor[i * n + i];
  }
}

/// Factors of the system at one point.
class PathSystem {
 public:
  explicit PathSystem(const PathRows& rows)
      : rows_(rows),
        hessian_(rows.on()),
        inverse_map_(rows.on()),
        schur_(rows.nodes()),
        chain_(rows.nodes()),
        link_(rows.nodes()) {}

  /// Factors of the Hessian with so much of each row's square in it.
  void factor(const std::vector<double>& weight) {
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      chain_[k].fill(0.0);
      link_[k].fill(0.0);
      for (std::size_t a = 0; a < 3; ++a) {
        chain_[k][4 * a] = 2 * given().pull[k] + kRegularisation;
      }
      for (std::size_t t = rows_.first(k); t < rows_.first(k + 1); ++t) {
        hessian_[t].fill(0.0);
        for (std::size_t i = 0; i < kSize; ++i) {
          hessian_[t][i * kSize + i] = 2 * given().carried[k] * rows_.grip(t).effort[i] + kRegularisation;
        }
      }
    }
    rows_.each_row(
        [&](std::size_t k, const double* d, std::size_t row) {
          const double w = weight[row] + weight[row + 1];
          for (std::size_t i = 0; i < 9; ++i) {
            chain_[k][i] += w * d[i / 3] * d[i % 3];
          }
        },
        [&](std::size_t k, std::size_t a, std::size_t row) {
          const double w = weight[row] + weight[row + 1] + 2 * given().speed[k];
          chain_[k][4 * a] += w;
          chain_[k + 1][4 * a] += w;
          link_[k][4 * a] = -w;  // between k and k + 1
        },
        [&](std::size_t t, const double* c, std::size_t row) {
          for (std::size_t i = 0; i < kSize; ++i) {
            const double scaled = weight[row] * c[i];
            for (std::size_t j = 0; j <= i; ++j) {
              hessian_[t][i * kSize + j] += scaled * c[j];
            }
          }
        },
        [&](std::size_t t, std::size_t i, std::size_t row) {
          hessian_[t][i * kSize + i] += weight[row] + weight[row + 1];
        });
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      if (rows_.carries(k)) {
        reduce(k);
      }
    }
    factor_chain();
  }

  /// Right sides of places and grips, and what balances lack, become steps and changes of the balances' multipliers.
  void solve_for(Variables& step) const {
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      for (std::size_t a = 0; a < 3; ++a) {
        step.place[k][a] = rows_.fixed(k, a) ? 0.0 : step.place[k][a];
      }
      if (rows_.carries(k)) {
        eliminate(k, step);
      }
    }
    solve_chain(step);
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      if (rows_.carries(k)) {
        substitute(k, step);
      }
    }
  }

 private:
  [[nodiscard]] const crux_path_problem& given() const { return rows_.given(); }

  /// The grips of a node out of its balance, and that out of its place.
  void reduce(std::size_t k) {
    Square& schur = schur_[k];
    schur.fill(0.0);
    for (std::size_t t = rows_.first(k); t < rows_.first(k + 1); ++t) {
      factorise<kSize>(hessian_[t].data());
      for (std::size_t i = 0; i < kSize; ++i) {
        double* column = inverse_map_[t].data() + kSize * i;  // H^-1 map' (., i)
        std::copy_n(rows_.grip(t).map + kSize * i, kSize, column);
        solve<kSize>(hessian_[t].data(), column);
        for (std::size_t j = 0; j < kSize; ++j) {
          double sum = 0.0;
          for (std::size_t l = 0; l < kSize; ++l) {
            sum += rows_.grip(t).map[kSize * j + l] * column[l];
          }
          schur[j * kSize + i] += sum;
        }
      }
    }
    factorise<kSize>(schur.data());
    const double* body = given().body + 18 * k;
    for (std::size_t a = 0; a < 3; ++a) {
      Column column{};
      for (std::size_t i = 0; i < kSize; ++i) {
        column[i] = body[3 * i + a];
      }
      solve<kSize>(schur.data(), column.data());
      for (std::size_t b = 0; b < 3; ++b) {
        for (std::size_t i = 0; i < kSize; ++i) {
          chain_[k][3 * b + a] += body[3 * i + b] * column[i];
        }
      }
    }
  }

  /// Factors of the places' chain: chain_[k] those of the blocks on its diagonal, link_[k] from k to k + 1.
  void factor_chain() {
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      for (std::size_t a = 0; a < 3; ++a) {
        if (!rows_.fixed(k, a)) {
          continue;
        }
        for (std::size_t b = 0; b < 3; ++b) {
          chain_[k][3 * a + b] = chain_[k][3 * b + a] = a == b ? 1.0 : 0.0;
        }
        link_[k][4 * a] = 0.0;
        if (k > 0) {
          link_[k - 1][4 * a] = 0.0;
        }
      }
    }
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      if (k > 0) {  // less link' chain^-1 link, link being diagonal
        for (std::size_t b = 0; b < 3; ++b) {
          Vector column{};
          column[b] = link_[k - 1][4 * b];
          solve<3>(chain_[k - 1].data(), column.data());
          for (std::size_t a = 0; a < 3; ++a) {
            chain_[k][3 * a + b] -= link_[k - 1][4 * a] * column[a];
          }
        }
      }
      factorise<3>(chain_[k].data());
    }
  }

  /// Grips' right sides become H^-1 of them, and the node's place takes its part.
  void eliminate(std::size_t k, Variables& step) const {
    Column& y = step.balance[k];
    for (std::size_t t = rows_.first(k); t < rows_.first(k + 1); ++t) {
      solve<kSize>(hessian_[t].data(), step.grip[t].data());
      for (std::size_t i = 0; i < kSize; ++i) {
        for (std::size_t j = 0; j < kSize; ++j) {
          y[i] += rows_.grip(t).map[kSize * i + j] * step.grip[t][j];
        }
      }
    }
    solve<kSize>(schur_[k].data(), y.data());
    const double* body = given().body + 18 * k;
    for (std::size_t a = 0; a < 3; ++a) {
      for (std::size_t i = 0; i < kSize && !rows_.fixed(k, a); ++i) {
        step.place[k][a] -= body[3 * i + a] * y[i];
      }
    }
  }

  void solve_chain(Variables& step) const {
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      if (k > 0) {
        Vector before = step.place[k - 1];
        solve<3>(chain_[k - 1].data(), before.data());
        for (std::size_t a = 0; a < 3; ++a) {
          step.place[k][a] -= link_[k - 1][4 * a] * before[a];
        }
      }
    }
    for (std::size_t k = rows_.nodes(); k-- > 0;) {
      for (std::size_t a = 0; a < 3 && k + 1 < rows_.nodes(); ++a) {
        step.place[k][a] -= link_[k][4 * a] * step.place[k + 1][a];
      }
      solve<3>(chain_[k].data(), step.place[k].data());
    }
  }

  /// The multipliers of a node's balance and its grips' steps, from its place's.
  void substitute(std::size_t k, Variables& step) const {
    const double* body = given().body + 18 * k;
    Column moved{};
    for (std::size_t i = 0; i < kSize; ++i) {
      for (std::size_t a = 0; a < 3; ++a) {
        moved[i] += body[3 * i + a] * step.place[k][a];
      }
    }
    solve<kSize>(schur_[k].data(), moved.data());
    for (std::size_t i = 0; i < kSize; ++i) {
      step.balance[k][i] += moved[i];
    }
    for (std::size_t t = rows_.first(k); t < rows_.first(k + 1); ++t) {
      for (std::size_t i = 0; i < kSize; ++i) {
        for (std::size_t j = 0; j < kSize; ++j) {
          step.grip[t][j] -= inverse_map_[t][kSize * i + j] * step.balance[k][i];
        }
      }
    }
  }

  const PathRows& rows_;
  std::vector<Square> hessian_, inverse_map_, schur_;
  std::vector<Block> chain_, link_;
};

}  // namespace crux

#endif
