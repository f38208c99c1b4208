// Calibration of the admittance's gains while the robot climbs, after the robot authors' own controller (arXiv
// 2207.01033): an unscented Kalman filter tunes M, D and K, shared by the limbs, towards wrench errors as small as is
// tolerated. Beside each admittance run twins with the gains of the sigma points. A twin feels what the real one
// feels, less what it would have yielded more: e − stiffness · (x_twin − x) of a moment ago.
#pragma once

#include <array>

#include "core/limb/gain_filter.hpp"
#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Translation or rotation of one admittance in a cycle.
struct Yielding {
  bool counts = false;  ///< it was stepped, and followed its equation
  Vector3 error = Vector3::Zero();
  Vector3 offset = Vector3::Zero();  ///< before
  Vector3 speed = Vector3::Zero();   ///< after
};

/// Of the three translations, or the three rotations.
class GainCalibration {
 public:
  struct Gains {
    double mass = 0.0, damping = 0.0, spring = 0.0;
  };
  struct Settings {
    double environment = 0.0;  ///< stiffness that gains must be stable against
    double delay_s = 0.0;
    double tolerated = 0.0;   ///< error that needs no better gains
    double max_change = 0.0;  ///< of a gain's logarithm, in a window
    int window_cycles = 0;
    int delay_cycles = 0;
  };

  GainCalibration(const Gains& loaded, const Settings& settings) noexcept;

  /// Back to the gains that were loaded.
  void restart() noexcept;

  /// One cycle. True where it has ended a window, so that gains() may be others.
  bool update(const PerLimb<Yielding>& limbs, double dt_s) noexcept;

  Gains gains() const noexcept;

 private:
  static constexpr int kPoints = GainFilter::kPoints;
  using Axes = Eigen::Matrix<double, 3, kPoints>;
  using Row = Eigen::Matrix<double, 1, kPoints>;

  /// Of one limb, a column a sigma point.
  struct Twins {
    Axes speed = Axes::Zero();
    Axes ahead = Axes::Zero();  ///< of the real offset
    std::array<Axes, kMostDelay_cycles> past{};
    bool runs = false;
    Row squares = Row::Zero();  ///< sum of squared errors
    int cycles = 0;             ///< of that
  };

  GainFilter first() const noexcept;
  void begin_window() noexcept;
  void begin(Twins& twins, const Yielding& real) const noexcept;
  void run(Twins& twins, const Yielding& real, double dt_s) const noexcept;
  void end_window() noexcept;
  GainFilter::Gains bounded(GainFilter::Gains logarithms) const noexcept;

  Settings settings_;
  GainFilter::Gains loaded_;
  GainFilter filter_;
  GainFilter::Points points_;
  Axes mass_, damping_, spring_;  ///< of the sigma points, the same for all axes
  PerLimb<Twins> twins_;
  int cycle_ = 0;  ///< of the window
};

/// Both, as the admittance has them.
class Calibration {
 public:
  explicit Calibration(const RobotDescription& robot) noexcept;

  void restart() noexcept { translation_.restart(), rotation_.restart(); }

  /// One cycle; translations and rotations. True where gains() have changed.
  bool update(const PerLimb<Yielding>& translations, const PerLimb<Yielding>& rotations, double dt_s) noexcept;

  AdmittanceParameters gains() const noexcept;

 private:
  AdmittanceParameters loaded_;
  GainCalibration translation_, rotation_;
};

}  // namespace crux
