// The calibration of the admittance: bounds against a delayed loop that is played, the filter against Kalman's closed
// form, and the whole against the best gains that trying all of them finds.
#include "core/limb/calibration.hpp"

#include <Eigen/LU>
#include <vector>

#include "core/limb/admittance.hpp"
#include "core/robot/stability.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

constexpr double kDt_s = 0.002;

/// An admittance on a spring that is felt late: how large its force is in the last of `seconds`, once pushed.
double last_error(double mass, double damping, double spring, double stiffness, double delay_s, double seconds) {
  const double dt_s = 2e-5;
  std::vector<double> past(static_cast<std::size_t>(std::lround(delay_s / dt_s)), 1.0 / stiffness);
  double x = 1.0 / stiffness, v = 0.0, most = 0.0;
  const int steps = static_cast<int>(seconds / dt_s);
  for (int i = 0; i < steps; ++i) {
    double& late = past[static_cast<std::size_t>(i) % past.size()];
    const double error = -stiffness * late;
    late = x;
    v = (mass * v + dt_s * (error - spring * x)) / (mass + dt_s * damping);
    x += dt_s * v;
    if (i > steps * 9 / 10) most = std::max(most, std::abs(error));
  }
  return most;
}

TEST(Stability, LeastDampingIsWhereADelayedLoopBeginsToGrow) {
  for (const auto& [mass, spring, stiffness, delay_s] :
       {std::array{2.0, 20.0, 1e4, 0.012}, std::array{0.1, 0.0, 3e3, 0.02}, std::array{0.02, 0.5, 250.0, 0.012},
        std::array{8.0, 200.0, 1e3, 0.05}}) {
    const double least = least_damping(mass, spring, stiffness, delay_s);
    EXPECT_LT(last_error(mass, 1.03 * least, spring, kGainMargin * stiffness, delay_s, 4.0), 1.0) << least;
    EXPECT_GT(last_error(mass, 0.97 * least, spring, kGainMargin * stiffness, delay_s, 4.0), 1.0) << least;
  }
}

TEST(Stability, WithoutMassItIsAQuarterTurnOfDelay) {
  EXPECT_NEAR(least_damping(1e-6, 0.0, 1e4, 0.012), kGainMargin * 1e4 * 0.012 * 2.0 / M_PI, 0.1);
}

TEST(GainFilter, EqualsKalmansClosedFormWhereOutputsAreLinear) {
  Random random(5);
  const GainFilter::Gains first(1.0, -2.0, 0.5);
  const double first_sigma = 0.7, wander = 0.05, output = 0.3;
  GainFilter filter(first, {first_sigma, wander, output});
  Eigen::Matrix<double, 4, 3> slope;
  for (int i = 0; i < 4; ++i) slope.row(i) = random.vector(1.0).transpose();
  const GainFilter::Outputs offset(0.3, -0.1, 0.8, 0.2), wanted(0.0, 0.1, -0.2, 0.0);
  GainFilter::Gains gains = first;
  GainFilter::Covariance covariance = first_sigma * first_sigma * GainFilter::Covariance::Identity();
  for (int i = 0; i < 3; ++i) {
    const GainFilter::Points points = filter.points();
    filter.update(points, (slope * points).colwise() + offset, wanted);
    const Eigen::Matrix4d spread =
        slope * covariance * slope.transpose() + output * output * Eigen::Matrix4d::Identity();
    const Eigen::Matrix<double, 3, 4> gain = covariance * slope.transpose() * spread.inverse();
    gains += gain * (wanted - slope * gains - offset);
    covariance = (Matrix3::Identity() - gain * slope) * covariance + wander * wander * Matrix3::Identity();
    EXPECT_LT((filter.gains() - gains).norm(), 1e-12);
    EXPECT_LT((filter.covariance() - covariance).norm(), 1e-12);
  }
}

TEST(GainFilter, GainsThatNothingExcitesDoNotSpreadWithoutEnd) {
  GainFilter filter(GainFilter::Gains::Zero(), {0.3, 0.1, 0.5});
  for (int i = 0; i < 200; ++i) {
    const GainFilter::Points points = filter.points();
    GainFilter::PointOutputs outputs = GainFilter::PointOutputs::Zero();
    outputs.row(0) = points.row(1);
    filter.update(points, outputs, GainFilter::Outputs::Zero());
  }
  EXPECT_EQ(filter.gains()[0], 0.0);
  EXPECT_LE(filter.covariance().diagonal().maxCoeff(), 0.3 * 0.3 + 1e-12);
  EXPECT_GT(filter.covariance().determinant(), 0.0);
}

constexpr double kStiffness_N_m = 2000.0;
constexpr int kDelay_cycles = 6;

/// Four grippers on springs that are felt late, pressed by what a climb's moves might.
class Presses {
 public:
  explicit Presses(const AdmittanceParameters& gains)
      : limbs_{Admittance(gains), Admittance(gains), Admittance(gains), Admittance(gains)} {}

  PerLimb<Yielding> step(double size_N) {
    const double t = kDt_s * cycle_;
    PerLimb<Yielding> did;
    for (int l = 0; l < kLimbs; ++l) {
      Vector3& late = past_[cycle_ % kDelay_cycles][l];
      const Vector3 pressed = size_N * Vector3(std::sin(1.5 * t + l), std::sin(2.3 * t), std::cos(0.9 * t + 2.0 * l));
      did[l] = {true, pressed - kStiffness_N_m * late, limbs_[l].offset_m(), Vector3::Zero()};
      late = limbs_[l].offset_m();
      limbs_[l].step({did[l].error, Vector3::Zero()}, kDt_s);
      did[l].speed = limbs_[l].speed_m_s();
      squares_ += did[l].error.squaredNorm() / kLimbs;
    }
    ++cycle_;
    return did;
  }
  void set(const AdmittanceParameters& gains) {
    for (Admittance& limb : limbs_) limb.set_parameters(gains);
  }
  double rms_since_last() {
    const double rms = std::sqrt(squares_ / (cycle_ - since_));
    squares_ = 0.0, since_ = cycle_;
    return rms;
  }

 private:
  std::array<Admittance, kLimbs> limbs_;
  std::array<PerLimb<Vector3>, kDelay_cycles> past_ = nothing();
  double squares_ = 0.0;
  int cycle_ = 0, since_ = 0;

  static std::array<PerLimb<Vector3>, kDelay_cycles> nothing() {
    std::array<PerLimb<Vector3>, kDelay_cycles> past;
    for (PerLimb<Vector3>& limbs : past) limbs.fill(Vector3::Zero());
    return past;
  }
};

AdmittanceParameters with_damping(double factor) {
  AdmittanceParameters gains = robot().admittance;
  gains.mass_kg *= factor;
  gains.damping_Ns_m *= factor;
  gains.stiffness_N_m *= factor;
  return gains;
}

RobotDescription described(const AdmittanceParameters& gains) {
  RobotDescription described = robot();
  described.admittance = gains;
  return described;
}

double least(const AdmittanceParameters& gains) {
  return least_damping(gains.mass_kg, gains.stiffness_N_m, gains.environment_N_m, gains.delay_s);
}

/// RMS error of the last ten seconds of a minute; `calibration` may be none.
double settled_rms(Presses& presses, Calibration* calibration, double size_N) {
  const PerLimb<Yielding> still{};
  for (int i = 0; i < 30000; ++i) {
    if (i == 25000) presses.rms_since_last();
    const PerLimb<Yielding> did = presses.step(size_N);
    if (calibration == nullptr || !calibration->update(did, still, kDt_s)) continue;
    const AdmittanceParameters gains = calibration->gains();
    EXPECT_GE(gains.damping_Ns_m, (1.0 - 1e-9) * least(gains));
    presses.set(gains);
  }
  return presses.rms_since_last();
}

TEST(Calibration, FindsGainsAlmostAsGoodAsTheBestOfAll) {
  double best = 1e9;
  for (double factor = 1.0 / 16.0; factor <= 16.0; factor *= 1.1) {
    Presses presses(with_damping(factor));
    if (with_damping(factor).damping_Ns_m < least(with_damping(factor))) continue;
    best = std::min(best, settled_rms(presses, nullptr, 20.0));
  }
  for (const double wrong : {4.0, 2.0, 1.0}) {
    Presses fixed(with_damping(wrong)), calibrated(with_damping(wrong));
    Calibration calibration(described(with_damping(wrong)));
    const double before = settled_rms(fixed, nullptr, 20.0), after = settled_rms(calibrated, &calibration, 20.0);
    EXPECT_LT(after, 1.1 * best) << wrong;
    EXPECT_LT(after, (wrong == 4.0 ? 0.7 : 1.0) * before) << wrong;
  }
}

TEST(Calibration, LeavesGainsAloneWhoseErrorsAreTolerated) {
  const AdmittanceParameters gains = with_damping(4.0);
  Presses presses(gains);
  Calibration calibration(described(gains));
  EXPECT_LT(settled_rms(presses, &calibration, 0.4), robot().calibration.tolerated_N);
  EXPECT_NEAR(calibration.gains().damping_Ns_m, gains.damping_Ns_m, 1e-9 * gains.damping_Ns_m);
}

TEST(Calibration, LeavesGainsAloneWhereNoneLessenTheError) {
  Calibration calibration(described(with_damping(1.0)));
  const PerLimb<Yielding> still{};
  for (int i = 0; i < 30000; ++i) {
    PerLimb<Yielding> shaken;
    for (int l = 0; l < kLimbs; ++l)
      shaken[l] = {true, 5.0 * Vector3(std::sin(250.0 * kDt_s * i + l), std::cos(300.0 * kDt_s * i), 0.0),
                   Vector3::Zero(), Vector3::Zero()};
    calibration.update(shaken, still, kDt_s);
  }
  const AdmittanceParameters loaded = with_damping(1.0), now = calibration.gains();
  EXPECT_NEAR(now.mass_kg, loaded.mass_kg, 1e-9 * loaded.mass_kg);
  EXPECT_NEAR(now.damping_Ns_m, loaded.damping_Ns_m, 1e-9 * loaded.damping_Ns_m);
  EXPECT_NEAR(now.stiffness_N_m, loaded.stiffness_N_m, 1e-9 * loaded.stiffness_N_m);
}

TEST(Calibration, ChangesNoGainFasterThanAllowedAndStartsAgainFromThoseLoaded) {
  Presses presses(with_damping(4.0));
  Calibration calibration(described(with_damping(4.0)));
  double last = std::log(1600.0);
  bool moved = false;
  const PerLimb<Yielding> still{};
  for (int i = 0; i < 10000; ++i) {
    if (!calibration.update(presses.step(30.0), still, kDt_s)) continue;
    const double now = std::log(calibration.gains().damping_Ns_m);
    EXPECT_LE(std::abs(now - last), robot().calibration.max_change + 1e-12);
    moved = moved || now < last;
    last = now;
    presses.set(calibration.gains());
  }
  EXPECT_TRUE(moved);
  EXPECT_NEAR(calibration.gains().inertia_kg_m2, robot().admittance.inertia_kg_m2, 1e-15);
  calibration.restart();
  EXPECT_NEAR(calibration.gains().damping_Ns_m, 1600.0, 1e-9);
}

TEST(Calibration, LimbsInTheAirDoNotCount) {
  Calibration calibration(described(with_damping(4.0)));
  PerLimb<Yielding> swings{};
  for (Yielding& limb : swings) limb.error = Vector3(100.0, 0.0, 0.0);
  for (int i = 0; i < 5000; ++i) calibration.update(swings, swings, kDt_s);
  EXPECT_NEAR(calibration.gains().damping_Ns_m, 1600.0, 1e-9);
}

}  // namespace
}  // namespace crux_test
