#include "core/robot/five_bar.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace crux {
namespace {

namespace bounds = crux_msgs::robot;
using Pair = FiveBar::Pair;

constexpr int kSteps = bounds::kFiveBarSteps;

double cross(const Pair& one, const Pair& other) noexcept { return one.x() * other.y() - one.y() * other.x(); }

Pair along(double length_m, double angle_rad) noexcept {
  return {length_m * std::cos(angle_rad), length_m * std::sin(angle_rad)};
}

double length(const Pair& v) noexcept { return std::max(v.norm(), bounds::kShortM); }

double wrapped(double angle_rad) noexcept { return std::remainder(angle_rad, 2.0 * std::numbers::pi); }

/// Angle of a triangle between sides `one` and `other`, across from `far`.
double corner_rad(double one, double other, double far) noexcept {
  return std::acos(std::clamp((one * one + other * other - far * far) / (2.0 * one * other), -1.0, 1.0));
}

Pair at(const FiveBar::Ranges& ranges, int first, int next) noexcept {
  const auto one = [](const Range& range, int step) {
    return range.low_rad + step * ((range.high_rad - range.low_rad) / kSteps);
  };
  return {one(ranges[0], first), one(ranges[1], next)};
}

/// Where a linkage holds, by steps of both joints, with what is around.
class Held {
 public:
  Held(const FiveBar& bar, const FiveBar::Ranges& ranges, const Range& crank) : held_(kSide * kSide) {
    for (int i = 0; i <= kSteps; ++i)
      for (int k = 0; k <= kSteps; ++k) held_[index(i, k)] = bar.holds(at(ranges, i, k), crank);
  }

  [[nodiscard]] bool at_all_of(const std::array<std::array<int, 2>, 2>& box) const {
    for (int i = box[0][0]; i <= box[0][1]; ++i)
      for (int k = box[1][0]; k <= box[1][1]; ++k)
        if (!around(i, k)) return false;
    return true;
  }

 private:
  static constexpr std::size_t kSide = kSteps + 1;

  static std::size_t index(int i, int k) { return static_cast<std::size_t>(i) * kSide + static_cast<std::size_t>(k); }

  [[nodiscard]] bool around(int first, int next) const {
    for (int i = std::max(first - 1, 0); i <= std::min(first + 1, kSteps); ++i)
      for (int k = std::max(next - 1, 0); k <= std::min(next + 1, kSteps); ++k)
        if (!held_[index(i, k)]) return false;
    return true;
  }

  std::vector<bool> held_;
};

}  // namespace

FiveBar::FiveBar(const crux_msgs::robot::FiveBar& section, double link_m, double sense, const Pair& middle_rad) noexcept
    : section_(section),
      link_m_(link_m),
      sense_(sense),
      middle_rad_(middle_rad),
      bends_(std::copysign(1.0, section.bends)),
      arm_m_(std::hypot(section.pin_x_m, section.pin_y_m)) {
  middle_crank_rad_ = own_crank_rad(middle_rad);
  const Vectors middle = vectors(middle_rad);
  opens_ = std::copysign(1.0, cross(middle.pin, middle.rod));
}

double FiveBar::own_crank_rad(const Pair& joints_rad) const noexcept {
  const Pair away = pin(joints_rad) + along(link_m_, joints_rad[0]) - Pair(section_.crank_x_m, section_.crank_y_m);
  return std::atan2(away.y(), away.x()) + bends_ * corner_rad(section_.crank_m, length(away), section_.rod_m);
}

double FiveBar::crank_rad(const Pair& joints_rad) const noexcept {
  return middle_crank_rad_ + wrapped(own_crank_rad(joints_rad) - middle_crank_rad_);
}

double FiveBar::next_rad(double first_rad, double crank_rad) const noexcept {
  const Pair axis(section_.crank_x_m, section_.crank_y_m);
  const Pair away = axis + along(section_.crank_m, crank_rad) - along(link_m_, first_rad);
  const double pin_rad = std::atan2(away.y(), away.x()) + opens_ * corner_rad(arm_m_, length(away), section_.rod_m);
  const double angle_rad = sense_ * (pin_rad - std::atan2(section_.pin_y_m, section_.pin_x_m) - first_rad);
  return middle_rad_[1] + wrapped(angle_rad - middle_rad_[1]);
}

FiveBar::Slopes FiveBar::slopes(const Pair& joints_rad) const noexcept {
  // The rod keeps its length: along it, the pin is as fast as the crank's end.
  const Vectors v = vectors(joints_rad);
  double by_crank = cross(v.crank, v.rod), by_next = cross(v.pin, v.rod);
  const double crank_flat = bounds::kFlat * section_.crank_m, pin_flat = bounds::kFlat * arm_m_;
  if (!(std::abs(by_crank) >= crank_flat)) by_crank = -bends_ * crank_flat;
  if (!(std::abs(by_next) >= pin_flat)) by_next = opens_ * pin_flat;
  return {cross(v.from_first, v.rod) / by_crank, sense_ * by_next / by_crank};
}

double FiveBar::sine(const Pair& joints_rad) const noexcept {
  const Vectors v = vectors(joints_rad);
  if (!(std::abs(length(v.rod) - 1.0) < bounds::kFlat)) return -1.0;
  return std::min(-bends_ * cross(v.crank, v.rod) / section_.crank_m, opens_ * cross(v.pin, v.rod) / arm_m_);
}

bool FiveBar::holds(const Pair& joints_rad, const Range& crank) const noexcept {
  const double angle_rad = crank_rad(joints_rad);
  const Range range = crank_range(crank);
  return angle_rad >= range.low_rad && angle_rad <= range.high_rad && sine(joints_rad) >= section_.least_sine;
}

Range FiveBar::crank_range(const Range& crank) const noexcept {
  return {std::max(crank.low_rad, middle_crank_rad_ - bounds::kCrankTurnRad),
          std::min(crank.high_rad, middle_crank_rad_ + bounds::kCrankTurnRad)};
}

FiveBar::Ranges FiveBar::box(const Ranges& ranges, const Range& crank) const {
  const Held held(*this, ranges, crank);
  std::array<std::array<int, 2>, 2> box{{{kSteps / 2, kSteps / 2}, {kSteps / 2, kSteps / 2}}};
  if (!held.at_all_of(box)) return {{{ranges[0].high_rad, ranges[0].low_rad}, {ranges[1].high_rad, ranges[1].low_rad}}};
  for (bool grows = true; grows;) {
    grows = false;
    for (std::size_t joint = 0; joint < 2; ++joint) {
      for (std::size_t end = 0; end < 2; ++end) {
        const int next = box[joint][end] + (end == 0 ? -1 : 1);
        auto edge = box;
        edge[joint] = {next, next};
        if (next < 0 || next > kSteps || !held.at_all_of(edge)) continue;
        box[joint][end] = next;
        grows = true;
      }
    }
  }
  const Pair low = at(ranges, box[0][0], box[1][0]), high = at(ranges, box[0][1], box[1][1]);
  return {{{low[0], high[0]}, {low[1], high[1]}}};
}

FiveBar::Steepest FiveBar::steepest(const Ranges& ranges) const {
  Steepest most;
  for (int i = 0; i <= kSteps; ++i) {
    for (int k = 0; k <= kSteps; ++k) {
      const Slopes slopes = this->slopes(at(ranges, i, k));
      most.speeds.first = std::max(most.speeds.first, std::abs(slopes.first));
      most.speeds.next = std::max(most.speeds.next, std::abs(slopes.next));
      most.first_by_next = std::max(most.first_by_next, std::abs(slopes.first / slopes.next));
      most.crank_by_next = std::max(most.crank_by_next, std::abs(1.0 / slopes.next));
    }
  }
  return most;
}

Pair FiveBar::pin(const Pair& joints_rad) const noexcept {
  const double angle_rad = joints_rad[0] + sense_ * joints_rad[1];
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  return {c * section_.pin_x_m - s * section_.pin_y_m, s * section_.pin_x_m + c * section_.pin_y_m};
}

FiveBar::Vectors FiveBar::vectors(const Pair& joints_rad) const noexcept {
  Vectors v;
  v.crank = along(section_.crank_m, own_crank_rad(joints_rad));
  v.pin = pin(joints_rad);
  v.from_first = along(link_m_, joints_rad[0]) + v.pin;
  v.rod = (v.from_first - Pair(section_.crank_x_m, section_.crank_y_m) - v.crank) / section_.rod_m;
  return v;
}

std::optional<ParallelJoints> parallel_joints(const KDL::Chain& chain, int first) {
  std::array<KDL::Vector, 2> axes, points;
  KDL::Frame before = KDL::Frame::Identity();
  int number = 0;
  for (const KDL::Segment& segment : chain.segments) {
    const KDL::Joint& joint = segment.getJoint();
    if (joint.getType() != KDL::Joint::None) {
      if (const int which = number++ - first; which == 0 || which == 1) {
        const auto at = static_cast<std::size_t>(which);
        axes[at] = before.M * joint.JointAxis();
        points[at] = before * joint.JointOrigin();
      }
    }
    before = before * segment.pose(0.0);
  }
  const KDL::Vector away = points[1] - points[0];
  const double apart_m = (away - KDL::dot(away, axes[0]) * axes[0]).Norm();
  if ((axes[0] * axes[1]).Norm() > bounds::kParallel || apart_m < bounds::kShortM) return std::nullopt;
  return ParallelJoints{apart_m, std::copysign(1.0, KDL::dot(axes[0], axes[1]))};
}

}  // namespace crux
