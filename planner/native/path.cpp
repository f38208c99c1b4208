#include "path.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <vector>

#include "path_rows.hpp"
#include "path_system.hpp"

// A primal-dual interior-point method (Mehrotra's predictor and corrector; Nocedal and Wright, Numerical Optimization,
// 16.6).

namespace crux {
namespace {

constexpr int kIterations = 60;
constexpr double kToBoundary = 0.995;
constexpr double kShift = 0.1;  // of slacks and multipliers at first
constexpr double kPlaceError = 1e-7;
constexpr double kGap = 1e-7;            // sum of products of slack and multiplier, as a share of the cost
constexpr double kSlope = 1e-6;          // as a share of the largest multiplier
constexpr double kLeastCentring = 1e-6;  // of the mean product, what the next barrier is at least

class Path {
 public:
  Path(const crux_path_grip* grips, const crux_path_problem& problem)
      : rows_(grips, problem),
        system_(rows_),
        x_(rows_.nodes(), rows_.on()),
        step_(rows_.nodes(), rows_.on()),
        slope_(rows_.nodes(), rows_.on()),
        slack_(rows_.count(), 1.0),
        dual_(rows_.count()),
        slack_step_(rows_.count()),
        dual_step_(rows_.count()),
        value_(rows_.count()),
        value_step_(rows_.count()),
        lacking_(rows_.count()),
        weight_(rows_.count()) {
    x_.place = rows_.middle();
    begin();
  }

  bool run() {
    for (int iteration = 0; iteration < kIterations && rows_.consistent(); ++iteration) {
      residuals();
      if (!std::isfinite(worst_place_ + worst_slope_ + gap_)) {
        return false;
      }
      const double scale = std::max(1.0, largest_multiplier_);
      if (worst_place_ < kPlaceError && worst_slope_ < kSlope * scale && gap_ < kGap * (1.0 + std::abs(cost_))) {
        return true;
      }
      condense();
      const double mean = gap_ / std::max(rows_.active_count(), 1.0);
      newton(0.0, false);
      const double plain = longest();
      double promised = 0.0;
      for (std::size_t r = 0; r < rows_.count(); ++r) {
        promised += rows_.active(r) ? (slack_[r] + plain * slack_step_[r]) * (dual_[r] + plain * dual_step_[r]) : 0.0;
      }
      const double share = promised / std::max(gap_, std::numeric_limits<double>::min());
      newton(std::max(share * share * share, kLeastCentring) * mean, true);
      advance(std::min(1.0, kToBoundary * longest()));
    }
    return false;
  }

  void write(double* places, double* wrenches) const {
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      std::copy(x_.place[k].begin(), x_.place[k].end(), places + 3 * k);
    }
    for (std::size_t t = 0; t < rows_.on(); ++t) {
      wrenches = std::copy_n(x_.grip[t].begin(), kSize, wrenches);
    }
  }

 private:
  [[nodiscard]] const crux_path_problem& given() const { return rows_.given(); }

  /// Where least squares of what rows lack leave the variables, slacks and multipliers moved to above 0.
  void begin() {
    residuals();
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      lacking_[r] -= rows_.active(r) ? slack_[r] : 0.0;
      dual_[r] = rows_.active(r) ? 1.0 : 0.0;
    }
    condense();
    newton(1.0, false);
    advance(1.0);
    rows_.at(x_, value_);
    double lacking = 0.0;
    double spare = 0.0;
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      if (rows_.active(r)) {
        lacking = std::max(lacking, value_[r] - rows_.right(r));
        spare = std::max(spare, rows_.right(r) - value_[r]);
      }
    }
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      if (rows_.active(r)) {
        slack_[r] = rows_.right(r) - value_[r] + lacking + kShift;
        dual_[r] = value_[r] - rows_.right(r) + spare + kShift;
      }
    }
  }

  /// Slope of the Lagrangian, what balance and rows lack, products of slack and multiplier.
  void residuals() {
    cost_ = 0.0;
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      Vector& slope = slope_.place[k];
      for (std::size_t a = 0; a < 3; ++a) {
        const double p = x_.place[k][a];
        const double away = p - given().target[a];
        slope[a] = 2 * given().pull[k] * away + kRegularisation * p;
        cost_ += given().pull[k] * away * away;
        if (k > 0) {
          const double moved = p - x_.place[k - 1][a];
          slope[a] += 2 * given().speed[k - 1] * moved;
          slope_.place[k - 1][a] -= 2 * given().speed[k - 1] * moved;
          cost_ += given().speed[k - 1] * moved * moved;
        }
      }
      balance_at(k);
    }
    rows_.add_transposed(dual_, slope_);
    rows_.at(x_, value_);
    gap_ = worst_place_ = largest_multiplier_ = worst_slope_ = 0.0;
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      lacking_[r] = rows_.active(r) ? value_[r] + slack_[r] - rows_.right(r) : 0.0;
      gap_ += rows_.active(r) ? slack_[r] * dual_[r] : 0.0;
      worst_place_ = std::max(worst_place_, std::abs(lacking_[r]));
      largest_multiplier_ = std::max(largest_multiplier_, dual_[r]);
    }
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      for (std::size_t a = 0; a < 3; ++a) {
        slope_.place[k][a] = rows_.fixed(k, a) ? 0.0 : slope_.place[k][a];
        worst_slope_ = std::max(worst_slope_, std::abs(slope_.place[k][a]));
      }
      for (std::size_t i = 0; i < kSize; ++i) {
        worst_place_ = std::max(worst_place_, std::abs(slope_.balance[k][i]));
        largest_multiplier_ = std::max(largest_multiplier_, std::abs(x_.balance[k][i]));
      }
    }
    for (const Column& slope : slope_.grip) {
      for (const double s : slope) {
        worst_slope_ = std::max(worst_slope_, std::abs(s));
      }
    }
  }

  /// The balance of a node, and its part of the grips' slopes.
  void balance_at(std::size_t k) {
    Column& lacks = slope_.balance[k];
    lacks.fill(0.0);
    if (!rows_.carries(k)) {
      return;
    }
    const double* body = given().body + 18 * k;
    const Column& y = x_.balance[k];
    for (std::size_t i = 0; i < kSize; ++i) {
      lacks[i] = -given().weight[kSize * k + i];
      for (std::size_t a = 0; a < 3; ++a) {
        lacks[i] += body[3 * i + a] * x_.place[k][a];
        slope_.place[k][a] += body[3 * i + a] * y[i];
      }
    }
    for (std::size_t t = rows_.first(k); t < rows_.first(k + 1); ++t) {
      slope_.grip[t].fill(0.0);
      for (std::size_t j = 0; j < kSize; ++j) {
        const double q = x_.grip[t][j];
        const double price = given().carried[k] * rows_.grip(t).effort[j];
        slope_.grip[t][j] = (2 * price + kRegularisation) * q;
        cost_ += price * q * q;
        for (std::size_t i = 0; i < kSize; ++i) {
          lacks[i] += rows_.grip(t).map[kSize * i + j] * q;
          slope_.grip[t][j] += rows_.grip(t).map[kSize * i + j] * y[i];
        }
      }
    }
  }

  void condense() {
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      weight_[r] = rows_.active(r) ? dual_[r] / slack_[r] : 0.0;
    }
    system_.factor(weight_);
  }

  /// A step towards products `barrier` of slack and multiplier; `corrected`: less what the last step makes of them.
  void newton(double barrier, bool corrected) {
    std::vector<double>& push = value_;
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      const double second = corrected ? slack_step_[r] * dual_step_[r] : 0.0;
      const double product = slack_[r] * dual_[r] + second - barrier;
      push[r] = rows_.active(r) ? (dual_[r] * lacking_[r] - product) / slack_[r] : 0.0;
    }
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      step_.place[k] = slope_.place[k];
      step_.balance[k] = slope_.balance[k];
    }
    step_.grip = slope_.grip;
    rows_.add_transposed(push, step_);
    for (Vector& place : step_.place) {
      std::transform(place.begin(), place.end(), place.begin(), std::negate<>());
    }
    for (Column& grip : step_.grip) {
      std::transform(grip.begin(), grip.end(), grip.begin(), std::negate<>());
    }
    system_.solve_for(step_);
    rows_.at(step_, value_step_);
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      if (!rows_.active(r)) {
        continue;
      }
      const double second = corrected ? slack_step_[r] * dual_step_[r] : 0.0;
      const double product = slack_[r] * dual_[r] + second - barrier;
      slack_step_[r] = -lacking_[r] - value_step_[r];
      dual_step_[r] = -(product + dual_[r] * slack_step_[r]) / slack_[r];
    }
  }

  /// The longest step, up to 1, that leaves slacks and multipliers positive.
  [[nodiscard]] double longest() const {
    double share = 1.0 / kToBoundary;
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      if (rows_.active(r) && slack_step_[r] < 0.0) {
        share = std::min(share, -slack_[r] / slack_step_[r]);
      }
      if (rows_.active(r) && dual_step_[r] < 0.0) {
        share = std::min(share, -dual_[r] / dual_step_[r]);
      }
    }
    return share;
  }

  void advance(double share) {
    for (std::size_t k = 0; k < rows_.nodes(); ++k) {
      for (std::size_t a = 0; a < 3; ++a) {
        x_.place[k][a] += share * step_.place[k][a];
      }
      for (std::size_t i = 0; i < kSize && rows_.carries(k); ++i) {
        x_.balance[k][i] += share * step_.balance[k][i];
      }
    }
    for (std::size_t t = 0; t < rows_.on(); ++t) {
      for (std::size_t i = 0; i < kSize; ++i) {
        x_.grip[t][i] += share * step_.grip[t][i];
      }
    }
    for (std::size_t r = 0; r < rows_.count(); ++r) {
      slack_[r] += rows_.active(r) ? share * slack_step_[r] : 0.0;
      dual_[r] += rows_.active(r) ? share * dual_step_[r] : 0.0;
    }
  }

  PathRows rows_;
  PathSystem system_;
  Variables x_, step_, slope_;
  std::vector<double> slack_, dual_, slack_step_, dual_step_, value_, value_step_, lacking_, weight_;
  double cost_ = 0.0, gap_ = 0.0, worst_place_ = 0.0, worst_slope_ = 0.0, largest_multiplier_ = 0.0;
};

}  // namespace
}  // namespace crux

int crux_path_solve(const crux_path_grip* grips, const crux_path_problem* problem, double* places, double* wrenches) {
  crux::Path path(grips, *problem);
  if (!path.run()) {
    return 0;
  }
  path.write(places, wrenches);
  return 1;
}
