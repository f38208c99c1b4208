#include "screws.hpp"

#include <algorithm>
#include <utility>

namespace crux::sim {
namespace {

// The stiffest friction MuJoCo makes: a standing finger creeps by micrometres a second at the most.
constexpr std::array<double, mjNIMP> kStiffImpedance{0.9999, 0.9999, 0.001, 0.5, 2.0};
constexpr double kStiffPeriods = 2;  // time constant in steps
constexpr double kLocked_N = 1e4;    // more than anything presses with

}  // namespace

void Screws::drive(std::size_t limb) {
  driven_[limb] = any_ = true;
  stiffen(limb);
}

void Screws::lock(std::size_t limb) {
  if (locked_[limb] || driven_[limb]) return;
  locked_[limb] = any_ = true;
  stiffen(limb);
  for (std::size_t pad = 2 * limb; pad < 2 * limb + 2; ++pad)
    unlocked_n_[pad] = std::exchange(model_.dof_frictionloss[map_.finger_dof[pad]], kLocked_N);
}

void Screws::press(std::size_t limb, double force_n, double squeeze_n) {
  if (!locked_[limb] || (force_n >= 0.0 && force_n < squeeze_n)) return;
  locked_[limb] = false;
  for (std::size_t pad = 2 * limb; pad < 2 * limb + 2; ++pad)
    model_.dof_frictionloss[map_.finger_dof[pad]] = unlocked_n_[pad];
}

void Screws::stiffen(std::size_t limb) {
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
