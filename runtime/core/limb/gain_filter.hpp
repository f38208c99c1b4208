// An unscented Kalman filter over gains: it looks for those with which an objective comes out as wanted. The form of
// auto-calibration after arXiv 2207.01033: gains wander, θ' = θ + w, and what a run with them yields is measured,
// y = h(θ) + v; h is evaluated at the sigma points, by whoever calls, and the measurement is what is wanted.
#pragma once

#include <Eigen/Core>

namespace crux {

class GainFilter {
 public:
  static constexpr int kGains = 3, kOutputs = 4, kPoints = 2 * kGains + 1;
  using Gains = Eigen::Matrix<double, kGains, 1>;
  using Outputs = Eigen::Matrix<double, kOutputs, 1>;
  using Points = Eigen::Matrix<double, kGains, kPoints>;
  using PointOutputs = Eigen::Matrix<double, kOutputs, kPoints>;
  using Covariance = Eigen::Matrix<double, kGains, kGains>;

  /// Standard deviations: of the first estimate and, at most, of any later one; of the gains' wandering from one update
  /// to the next; of the outputs.
  struct Deviations {
    double first = 0.0, wander = 0.0, output = 0.0;
  };

  GainFilter(const Gains& gains, const Deviations& deviations) noexcept;

  /// The estimate, and what lies √3 deviations off it along each axis of its covariance. The caller may move points,
  /// as bounds want it.
  Points points() const noexcept;

  /// Takes in what h made of `points` against the outputs that are wanted.
  void update(const Points& points, const PointOutputs& outputs, const Outputs& wanted) noexcept;

  /// Bounds want the estimate here.
  void move_to(const Gains& gains) noexcept { gains_ = gains; }

  const Gains& gains() const { return gains_; }
  const Covariance& covariance() const { return covariance_; }

 private:
  Gains gains_;
  Covariance covariance_;
  Deviations deviations_;
};

}  // namespace crux
