// The plan's clock: driven by events, so plan time may stand still while real time runs (msgs/PLAN.md).
#pragma once

#include "core/reference_player.hpp"

namespace crux {

/// robot_state_t.waiting_for
enum class WaitingFor : int { kNothing = 0, kUnload = 1, kOpen = 2, kArrive = 3, kGrip = 4, kSettle = 5, kSlip = 6 };

/// What the clock needs to see of each limb before it goes on.
struct LimbEvents {
  bool unloaded = false;  ///< measured force below unload_force_N
  bool opened = false;    ///< fingers stand at their opening for the swing
  bool arrived = false;   ///< gripper stands at its new hold
  bool gripped = false;   ///< both fingers press with contact_force_N
};

class PlanClock {
 public:
  void reset() noexcept { *this = PlanClock(); }

  /// Moves on by `dt_s`, or up to the next event that is still missing.
  void advance(const PreparedPlan& plan, const PerLimb<LimbEvents>& events, double dt_s) noexcept;

  /// An operator has looked after what the clock was waiting for.
  void forget_wait() noexcept { waited_s_ = 0.0; }

  const PlanTime& now() const { return now_; }
  bool complete(const PreparedPlan& plan) const {
    return now_.interval + 1 == plan.intervals() && now_.elapsed_s >= plan.dt_s;
  }
  WaitingFor waiting_for() const { return waiting_for_; }
  int waiting_limb() const { return waiting_limb_; }
  double waited_s() const { return waited_s_; }

 private:
  /// True when `wanted` is seen on every limb that `concerns`; else remembers the first one that is missing.
  template <class Concerns>
  bool all_seen(WaitingFor what, bool LimbEvents::* wanted, const PerLimb<LimbEvents>& events,
                Concerns concerns) noexcept;
  void stop_at(double elapsed_s, double dt_s) noexcept;

  PlanTime now_;
  WaitingFor waiting_for_ = WaitingFor::kNothing;
  int waiting_limb_ = -1;
  double waited_s_ = 0.0;
};

}  // namespace crux
