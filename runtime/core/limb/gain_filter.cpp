#include "core/limb/gain_filter.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace crux {
namespace {

// Weights of the scaled unscented transform with α 1, κ 0, β 2 (n + λ = n): the centre counts in spreads alone.
constexpr double kCentreSpread = 2.0;
constexpr double kWeight = 1.0 / (2.0 * GainFilter::kGains);

double spread_weight(int point) { return point == 0 ? kCentreSpread : kWeight; }

}  // namespace

GainFilter::GainFilter(const Gains& gains, const Deviations& deviations) noexcept
    : gains_(gains),
      covariance_(deviations.first * deviations.first * Covariance::Identity()),
      deviations_(deviations) {}

GainFilter::Points GainFilter::points() const noexcept {
  const Covariance root = covariance_.llt().matrixL();
  const double reach = std::sqrt(static_cast<double>(kGains));
  Points points;
  points.col(0) = gains_;
  for (int i = 0; i < kGains; ++i) {
    points.col(1 + i) = gains_ + reach * root.col(i);
    points.col(1 + kGains + i) = gains_ - reach * root.col(i);
  }
  return points;
}

void GainFilter::update(const Points& points, const PointOutputs& outputs, const Outputs& wanted) noexcept {
  const Outputs expected = kWeight * outputs.rightCols<kPoints - 1>().rowwise().sum();
  const Gains mean = kWeight * points.rightCols<kPoints - 1>().rowwise().sum();
  using Spread = Eigen::Matrix<double, kOutputs, kOutputs>;
  Spread spread = deviations_.output * deviations_.output * Spread::Identity();
  Eigen::Matrix<double, kGains, kOutputs> cross = Eigen::Matrix<double, kGains, kOutputs>::Zero();
  Covariance prior = Covariance::Zero();  // of the points as they lie: bounds may have moved them together
  for (int p = 0; p < kPoints; ++p) {
    const Outputs off = outputs.col(p) - expected;
    const Gains gains_off = points.col(p) - mean;
    spread.noalias() += spread_weight(p) * off * off.transpose();
    cross.noalias() += spread_weight(p) * gains_off * off.transpose();
    prior.noalias() += spread_weight(p) * gains_off * gains_off.transpose();
  }
  const Eigen::Matrix<double, kGains, kOutputs> gain = spread.ldlt().solve(cross.transpose()).transpose();
  gains_ += gain * (wanted - expected);
  covariance_ = prior - gain * spread * gain.transpose();
  // Gains that nothing excites would spread without end.
  covariance_.diagonal().array() += deviations_.wander * deviations_.wander;
  const double most = deviations_.first;
  const Gains shrink = (most / covariance_.diagonal().array().sqrt()).min(1.0).matrix();
  const Covariance symmetric = 0.5 * (covariance_ + covariance_.transpose());
  covariance_ = shrink.asDiagonal() * symmetric * shrink.asDiagonal();
}

}  // namespace crux
