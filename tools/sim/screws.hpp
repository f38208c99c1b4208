// Dry friction of the screws that drive the fingers, for grippers whose drive force comes before it.
//
// A finger under the squeeze S closes when the drive force exceeds S / eta and opens when it falls below -r S / eta; in
// between the screw stands, whatever the load. So the friction reaches from S (1/eta - 1) against closing to
// S (1 + r/eta) against opening: a constant part and a symmetric one, which MuJoCo's friction loss of the finger's
// joint solves with the contacts.
#pragma once

#include <array>
#include <cstddef>

#include "plant.h"

namespace crux::sim {

class Screws {
 public:
  /// @param middle, half_width of the friction, as shares of the squeeze
  Screws(mjModel& model, const crux_plant_map& map, double middle, double half_width)
      : model_(model), map_(map), middle_(middle), half_width_(half_width) {}

  /// Makes the friction of a limb's fingers stiff; it is zero until `set`.
  void drive(std::size_t limb);

  /// Some depend on how hard the pads press.
  [[nodiscard]] bool any() const noexcept { return any_; }

  /// From now on a limb's fingers stand whatever presses on them, those of a gripper without power; no matter where the
  /// friction is made above.
  void lock(std::size_t limb);

  /// The drive presses with this force: its fingers move again once that is as much as the squeeze, or opens.
  void press(std::size_t limb, double force_n, double squeeze_n);

  [[nodiscard]] bool locked(std::size_t limb) const noexcept { return locked_[limb]; }

  /// Friction under a pad's squeeze; returns the part that is a force, positive closes. Nothing for other limbs' pads.
  double set(std::size_t pad, double squeeze_n);

 private:
  mjModel& model_;
  const crux_plant_map& map_;
  double middle_, half_width_;
  void stiffen(std::size_t limb);

  std::array<bool, CRUX_SIM_LIMBS> driven_{}, locked_{};
  std::array<double, CRUX_SIM_PADS> unlocked_n_{};  ///< friction of a finger but for its lock
  bool any_ = false;
};

}  // namespace crux::sim
