#include "screws.hpp"

#include <algorithm>

namespace crux::sim {
namespace {

// The stiffest friction MuJoCo makes: a standing finger creeps by micrometres a second at the most.
constexpr std::array<double, mjNIMP> kStiffImpedance{0.9999, 0.9999, 0.001, 0.5, 2.0};
constexpr double kStiffPeriods = 2;  // time constant in steps

}  // namespace

void Screws::drive(std::size_t limb) {
  driven_[limb] = any_ = true;
  for (std::size_t pad = 2 * limb; pad < 2 * limb + 2; ++pad) {
    const auto dof = static_cast<std::size_t>(map_.finger_dof[pad]);
    std::ranges::copy(kStiffImpedance, model_.dof_solimp + mjNIMP * dof);
    model_.dof_solref[mjNREF * dof] = kStiffPeriods * model_.opt.timestep;
    model_.dof_solref[mjNREF * dof + 1] = 1.0;
  }
}

double Screws::set(std::size_t pad, double squeeze_n) {
  if (!driven_[pad / 2]) return 0.0;
  model_.dof_frictionloss[map_.finger_dof[pad]] = half_width_ * squeeze_n;
  return middle_ * squeeze_n;
}

}  // namespace crux::sim
