// A planar five-bar between two joints of a limb and what turns them: section five_bar of robot.yaml. The same as
// crux_contracts.five_bar, which says how angles count; msgs/golden/five_bars.json holds both to it.
#pragma once

#include <array>
#include <kdl/chain.hpp>
#include <optional>

#include "core/robot/geometry.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {

/// Ends of an angle.
struct Range {
  double low_rad = 0.0;
  double high_rad = 0.0;
};

/// What works on angles neither allocates nor gives what is no number.
class FiveBar {
 public:
  using Pair = Eigen::Vector2d;         ///< of the first joint and the next
  using Ranges = std::array<Range, 2>;  ///< likewise

  /// Speed of the crank by that of the first joint, and by that of the next.
  struct Slopes {
    double first = 0.0;
    double next = 1.0;
  };

  /// Greatest sizes of the slopes, and of what torques of the joints make of those of the first actuator and the crank.
  struct Steepest {
    Slopes speeds{0.0, 0.0};
    double first_by_next = 0.0;
    double crank_by_next = 0.0;
  };

  /// `middle_rad`: the joints' angles by which branches are told apart.
  FiveBar(const crux_msgs::robot::FiveBar& section, double link_m, double sense, const Pair& middle_rad) noexcept;

  /// Counts from 0.
  [[nodiscard]] int first() const noexcept { return static_cast<int>(section_.first_joint) - 1; }

  [[nodiscard]] double crank_rad(const Pair& joints_rad) const noexcept;
  [[nodiscard]] double next_rad(double first_rad, double crank_rad) const noexcept;
  [[nodiscard]] Slopes slopes(const Pair& joints_rad) const noexcept;
  [[nodiscard]] double sine(const Pair& joints_rad) const noexcept;
  [[nodiscard]] bool holds(const Pair& joints_rad, const Range& crank) const noexcept;
  [[nodiscard]] bool closes_in_the_middle() const noexcept { return sine(middle_rad_) >= section_.least_sine; }
  [[nodiscard]] Range crank_range(const Range& crank) const noexcept;

  /// Ranges of both joints, within `ranges`, in all of which it holds(); low above high where it does not in the
  /// middle.
  [[nodiscard]] Ranges box(const Ranges& ranges, const Range& crank) const;
  [[nodiscard]] Steepest steepest(const Ranges& ranges) const;

 private:
  /// The crank, from the next joint to the pin, from the first joint to the pin, and the rod in its lengths.
  struct Vectors {
    Pair crank, pin, from_first, rod;
  };

  [[nodiscard]] double own_crank_rad(const Pair& joints_rad) const noexcept;
  [[nodiscard]] Pair pin(const Pair& joints_rad) const noexcept;
  [[nodiscard]] Vectors vectors(const Pair& joints_rad) const noexcept;

  crux_msgs::robot::FiveBar section_;
  double link_m_, sense_;
  Pair middle_rad_;
  double bends_, arm_m_;
  double opens_ = 1.0;
  double middle_crank_rad_ = 0.0;
};

/// Two neighbouring joints about parallel axes.
struct ParallelJoints {
  double apart_m = 0.0;  ///< their axes
  double sense = 1.0;    ///< -1: one turns against the other
};

/// Of joint number `first` of a chain and the next; none where their axes are not parallel, or the same line.
std::optional<ParallelJoints> parallel_joints(const KDL::Chain& chain, int first);

}  // namespace crux
