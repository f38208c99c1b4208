#include "core/robot/joint_loops.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <complex>
#include <kdl/chaindynparam.hpp>
#include <limits>
#include <numbers>
#include <optional>

#include "core/robot/description_problem.hpp"

namespace crux {
namespace {

namespace bounds = crux_msgs::robot;

constexpr double kStill_kg_m2 = 1e9;  // where there is no joint, nothing moves

using Eigenvalues = Eigen::Matrix<std::complex<double>, kJoints, 1>;

/// The largest first.
Eigenvalues eigenvalues(const JointMatrix& inertia, const JointLoops& loops, double omega_1_s) {
  using ComplexMatrix = Eigen::Matrix<std::complex<double>, kJoints, kJoints>;
  const std::complex<double> s(0.0, omega_1_s);
  ComplexMatrix plant = inertia.cast<std::complex<double>>() * s * s;
  plant.diagonal() += loops.damping_Nms_rad.cast<std::complex<double>>() * s;
  const JointVector& k_p = loops.position_gain_Nm_rad;
  const JointVector& k_d = loops.velocity_gain_Nms_rad;
  const ComplexMatrix gains =
      ((k_d.cast<std::complex<double>>() * s + k_p.cast<std::complex<double>>()) / (1.0 + loops.lag_s * s))
          .asDiagonal();
  const ComplexMatrix loop = plant.partialPivLu().solve(gains);
  Eigenvalues values = Eigen::ComplexEigenSolver<ComplexMatrix>(loop, false).eigenvalues();
  std::sort(values.data(), values.data() + kJoints,
            [](const auto& a, const auto& b) { return std::abs(a) > std::abs(b); });
  return values;
}

double least_margin_s(const std::vector<JointMatrix>& inertias, const JointLoops& loops, std::size_t& worst) {
  double least_s = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < inertias.size(); ++i) {
    if (const double margin_s = delay_margin_s(inertias[i], loops); margin_s < least_s) least_s = margin_s, worst = i;
  }
  return least_s;
}

/// The nearest gains that do in all postures, looked for in the `worst` one; position gains change as little as they
/// can.
std::optional<JointLoops> other_gains(const std::vector<JointMatrix>& inertias, std::size_t worst,
                                      const JointLoops& loops, double needed_s) {
  for (int p = 0; p < bounds::kLoopSteps; ++p) {
    for (int n = 0; n <= 2 * bounds::kLoopSteps; ++n) {
      const int v = n % 2 == 0 ? n / 2 : -(n + 1) / 2;  // 0, -1, 1, -2, 2 ...
      JointLoops other = loops;
      other.position_gain_Nm_rad *= std::pow(bounds::kLoopStep, p);
      other.velocity_gain_Nms_rad *= std::pow(bounds::kLoopStep, v);
      if (delay_margin_s(inertias[worst], other) < needed_s) continue;
      if (least_margin_s(inertias, other, worst) >= needed_s) return other;
    }
  }
  return std::nullopt;
}

std::string listed(const Eigen::Ref<const Eigen::VectorXd>& values) {
  std::string all;
  for (const double value : values) all += (all.empty() ? "[" : ", ") + shown(value, "%.3g");
  return all + "]";
}

}  // namespace

std::vector<JointMatrix> limb_inertias(const LimbDescription& limb, const JointVector& armature_kg_m2) {
  KDL::ChainDynParam dynamics(limb.chain, KDL::Vector::Zero());
  const auto turns = static_cast<unsigned>(limb.turns());
  KDL::JntArray q_rad(turns);
  KDL::JntSpaceInertiaMatrix inertia(turns);
  const auto at = [&](int joint, double share) {
    if (joint >= limb.driven) return;
    const JointLimits& limits = limb.joints[static_cast<std::size_t>(joint)];
    q_rad(static_cast<unsigned>(joint)) = limits.lower_rad + share * (limits.upper_rad - limits.lower_rad);
  };
  for (int j = 0; j < kJoints; ++j) at(j, 0.5);
  std::vector<JointMatrix> inertias;
  for (const double elbow : {0.0, 0.5, 1.0}) {
    for (const double pitch : {0.0, 0.5, 1.0}) {
      for (const double roll : {0.5, 1.0}) {
        at(2, elbow), at(3, pitch), at(4, roll);
        dynamics.JntToMass(q_rad, inertia);
        JointVector slots = JointVector::Zero();
        slots.head(turns) = q_rad.data;
        inertias.emplace_back(JointMatrix::Zero()).topLeftCorner(turns, turns) = inertia.data;
        inertias.back() = limb.transmission.at_actuators(inertias.back(), slots);
        inertias.back().diagonal() += armature_kg_m2;
        inertias.back().diagonal().tail(kJoints - limb.driven).setConstant(kStill_kg_m2);
      }
    }
  }
  return inertias;
}

double delay_margin_s(const JointMatrix& inertia, const JointLoops& loops) {
  double least_s = std::numeric_limits<double>::infinity();
  // The k-th largest eigenvalue passes 1 once: loops lose gain with frequency.
  for (int k = 0; k < kJoints; ++k) {
    double low = bounds::kLoopLowest1S, high = bounds::kLoopHighest1S;
    for (int i = 0; i < bounds::kLoopHalvings; ++i) {
      const double middle = std::sqrt(low * high);
      (std::abs(eigenvalues(inertia, loops, middle)[k]) >= 1.0 ? low : high) = middle;
    }
    const std::complex<double> value = eigenvalues(inertia, loops, low)[k];
    if (std::abs(value) >= 1.0) least_s = std::min(least_s, (std::numbers::pi + std::arg(value)) / low);
  }
  return least_s;
}

double checked_delay_margin_s(const LimbDescription& limb, const JointLoops& loops, const JointVector& armature_kg_m2,
                              double dead_time_s, const std::string& path) {
  const std::vector<JointMatrix> inertias = limb_inertias(limb, armature_kg_m2);
  const double needed_s = bounds::kDeadTimeMargin * dead_time_s;
  std::size_t worst = 0;
  const double margin_s = least_margin_s(inertias, loops, worst);
  if (margin_s >= needed_s) return margin_s;
  std::string why = "a delay margin of " + shown(margin_s, "%.2g") + " s in the worst posture, expected at least " +
                    shown(needed_s, "%.2g") + ": " + shown(bounds::kDeadTimeMargin) + " times dead_time_s";
  if (const std::optional<JointLoops> other = other_gains(inertias, worst, loops, needed_s)) {
    why += ", as with " + listed(other->velocity_gain_Nms_rad.head(limb.driven));
    if (other->position_gain_Nm_rad != loops.position_gain_Nm_rad)
      why += " and position_gain_Nm_rad " + listed(other->position_gain_Nm_rad.head(limb.driven));
  }
  refuse(path, "servo.velocity_gain_Nms_rad", listed(loops.velocity_gain_Nms_rad.head(limb.driven)), why);
}

}  // namespace crux
