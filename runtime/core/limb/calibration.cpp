#include "core/limb/calibration.hpp"

#include <algorithm>
#include <cmath>

#include "core/robot/stability.hpp"

namespace crux {
namespace {

constexpr double kReach = 8.0;         // gains stay within so many times those loaded
constexpr double kLeastSpring = 1e-6;  // a spring of nothing has no logarithm
constexpr double kLeastShare = 0.5;    // of a window that a limb must bear load for
constexpr double kWorth = 0.1;         // share of squared errors that a sigma point must save, or all gains stay
// Deviations of logarithms; of the outputs, as a share of what is tolerated.
constexpr double kFirst = 0.3, kWander = 0.1, kOutput = 0.5;

GainFilter::Gains logarithms(const GainCalibration::Gains& gains) {
  return {std::log(gains.mass), std::log(gains.damping), std::log(std::max(gains.spring, kLeastSpring))};
}

GainCalibration::Settings settings_of(const RobotDescription& robot, double environment, double tolerated) {
  const double delay_s = robot.admittance.delay_s;
  return {.environment = environment,
          .delay_s = delay_s,
          .tolerated = tolerated,
          .max_change = robot.calibration.max_change,
          .window_cycles = static_cast<int>(std::lround(robot.calibration.window_s * robot.can.rate_Hz)),
          .delay_cycles = std::max(static_cast<int>(std::lround(delay_s * robot.can.rate_Hz)), 1)};
}

}  // namespace

GainCalibration::GainCalibration(const Gains& loaded, const Settings& settings) noexcept
    : settings_(settings), loaded_(logarithms(loaded)), filter_(first()) {
  begin_window();
}

GainFilter GainCalibration::first() const noexcept {
  return {loaded_, {.first = kFirst, .wander = kWander, .output = kOutput * settings_.tolerated}};
}

void GainCalibration::restart() noexcept {
  filter_ = first();
  begin_window();
}

GainCalibration::Gains GainCalibration::gains() const noexcept {
  const GainFilter::Gains gains = filter_.gains().array().exp();
  return {gains[0], gains[1], gains[2]};
}

GainFilter::Gains GainCalibration::bounded(GainFilter::Gains logarithms) const noexcept {
  const double reach = std::log(kReach);
  logarithms = logarithms.cwiseMax((loaded_.array() - reach).matrix()).cwiseMin((loaded_.array() + reach).matrix());
  const double least =
      least_damping(std::exp(logarithms[0]), std::exp(logarithms[2]), settings_.environment, settings_.delay_s);
  logarithms[1] = std::max(logarithms[1], std::log(least));
  return logarithms;
}

void GainCalibration::begin_window() noexcept {
  points_ = filter_.points();
  for (int p = 0; p < kPoints; ++p) points_.col(p) = bounded(points_.col(p));
  const GainFilter::Points gains = points_.array().exp();
  mass_ = gains.row(0).replicate<3, 1>();
  damping_ = gains.row(1).replicate<3, 1>();
  spring_ = gains.row(2).replicate<3, 1>();
  for (Twins& twins : twins_) {
    twins.runs = false;
    twins.squares.setZero();
    twins.cycles = 0;
  }
  cycle_ = 0;
}

void GainCalibration::begin(Twins& twins, const Yielding& real) const noexcept {
  twins.speed = real.speed.replicate<1, kPoints>();
  twins.ahead.setZero();
  for (int i = 0; i < settings_.delay_cycles; ++i) twins.past[i].setZero();
  twins.runs = true;
}

void GainCalibration::run(Twins& twins, const Yielding& real, double dt_s) const noexcept {
  Axes& past = twins.past[cycle_ % settings_.delay_cycles];
  const Axes error = real.error.replicate<1, kPoints>() - settings_.environment * past;
  past = twins.ahead;
  const Axes offset = real.offset.replicate<1, kPoints>() + twins.ahead;
  twins.speed = (mass_.array() * twins.speed.array() + dt_s * (error.array() - spring_.array() * offset.array())) /
                (mass_.array() + dt_s * damping_.array());
  twins.ahead += dt_s * (twins.speed - real.speed.replicate<1, kPoints>());
  twins.squares += error.colwise().squaredNorm();
  ++twins.cycles;
}

bool GainCalibration::update(const PerLimb<Yielding>& limbs, double dt_s) noexcept {
  for (int l = 0; l < kLimbs; ++l) {
    Twins& twins = twins_[l];
    if (limbs[l].counts && twins.runs) run(twins, limbs[l], dt_s);
    if (limbs[l].counts && !twins.runs) begin(twins, limbs[l]);
    twins.runs = limbs[l].counts;
  }
  if (++cycle_ < settings_.window_cycles) return false;
  end_window();
  begin_window();
  return true;
}

void GainCalibration::end_window() noexcept {
  GainFilter::PointOutputs outputs = GainFilter::PointOutputs::Zero();
  Row squares = Row::Zero();
  for (int l = 0; l < kLimbs; ++l) {
    const Twins& twins = twins_[l];
    if (twins.cycles < kLeastShare * settings_.window_cycles) continue;
    const Row mean = twins.squares / twins.cycles;
    squares += mean;
    outputs.row(l) = (mean.array().sqrt() - settings_.tolerated).max(0.0);
  }
  // The first point is the gains as they are: where these do, nothing is better, and unknown gains stay.
  if (outputs.col(0).isZero(0.0)) return;
  // Errors that no gains lessen tell nothing of gains: on them the estimate would wander.
  if (squares.minCoeff() > (1.0 - kWorth) * squares[0]) return;
  const GainFilter::Gains before = filter_.gains();
  filter_.update(points_, outputs, GainFilter::Outputs::Zero());
  const GainFilter::Gains most = GainFilter::Gains::Constant(settings_.max_change);
  filter_.move_to(bounded(before + (filter_.gains() - before).cwiseMax(-most).cwiseMin(most)));
}

Calibration::Calibration(const RobotDescription& robot) noexcept
    : loaded_(robot.admittance),
      translation_({loaded_.mass_kg, loaded_.damping_Ns_m, loaded_.stiffness_N_m},
                   settings_of(robot, loaded_.environment_N_m, robot.calibration.tolerated_N)),
      rotation_({loaded_.inertia_kg_m2, loaded_.rotational_damping_Nms_rad, loaded_.rotational_stiffness_Nm_rad},
                settings_of(robot, loaded_.environment_Nm_rad, robot.calibration.tolerated_Nm)) {}

bool Calibration::update(const PerLimb<Yielding>& translations, const PerLimb<Yielding>& rotations,
                         double dt_s) noexcept {
  const bool moved = translation_.update(translations, dt_s);
  return rotation_.update(rotations, dt_s) || moved;
}

AdmittanceParameters Calibration::gains() const noexcept {
  AdmittanceParameters gains = loaded_;
  const GainCalibration::Gains t = translation_.gains(), r = rotation_.gains();
  gains.mass_kg = t.mass;
  gains.damping_Ns_m = t.damping;
  gains.stiffness_N_m = t.spring;
  gains.inertia_kg_m2 = r.mass;
  gains.rotational_damping_Nms_rad = r.damping;
  gains.rotational_stiffness_Nm_rad = r.spring;
  return gains;
}

}  // namespace crux
