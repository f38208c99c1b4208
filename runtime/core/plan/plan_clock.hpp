// The plan's clock: driven by events, so plan time may stand still while real time runs (msgs/PLAN.md).
#pragma once

#include <crux_msgs/robot_state_t.hpp>

#include "core/plan/reference_player.hpp"

namespace crux {

/// robot_state_t.waiting_for
enum class WaitingFor : int {
  kNothing = 0,
  kUnload = 1,
  kOpen = 2,
  kArrive = 3,
  kGrip = 4,
  kSettle = 5,
  kSlip = 6,
  kStandUp = 7,
  kDrift = 8
};

/// Which way the clock runs, and how far.
enum class Motion : std::int8_t {
  kForward = crux_msgs::robot_state_t::FORWARD,  ///< to the plan's end
  kStep = crux_msgs::robot_state_t::STEP,        ///< to the next stance
  kReverse = crux_msgs::robot_state_t::REVERSE,  ///< back to the last verified stance
};

/// What the clock needs to see of each limb before it goes on.
struct LimbEvents {
  bool unloaded = false;  ///< measured force below unload_force_N
  bool opened = false;    ///< fingers stand at their opening for the swing
  bool arrived = false;   ///< gripper stands at its new hold
  bool gripped = false;   ///< both fingers press with contact_force_N
  bool blocked = false;   ///< on its way to its new hold it bears a load, or seeks the hold
};

class PlanClock {
 public:
  void reset() noexcept { *this = PlanClock(); }

  /// The clock of a run that has ended goes on here; it stands until it departs.
  void restore(PlanTime now, PlanTime verified) noexcept {
    reset();
    now_ = now;
    verified_ = verified;
  }

  /// From now on the clock runs as `motion` says; what it waited for is forgotten.
  void depart(const PreparedPlan& plan, Motion motion) noexcept;

  /// Limbs on their last way to a hold begin it again.
  void approach_anew(const PreparedPlan& plan) noexcept {
    now_.elapsed_s = now_.back ? plan.step_s[now_.interval] : 0.0;
    wait_anew();
  }

  /// Moves on by `scale`·`dt_s`, or up to the next event that is still missing.
  void advance(const PreparedPlan& plan, const PerLimb<LimbEvents>& events, double dt_s, double scale) noexcept;

  const PlanTime& now() const { return now_; }
  bool complete(const PreparedPlan& plan) const {
    return now_.interval + 1 == plan.intervals() && now_.elapsed_s >= plan.step_s[now_.interval];
  }
  /// It stands where its motion ends.
  bool arrived(const PreparedPlan& plan) const { return stops() ? arrived_ : complete(plan); }
  /// The last stance in which all limbs were seen to grip under load; an interval of -1 where there is none.
  const PlanTime& verified() const { return verified_; }
  /// A verified stance lies before now.
  bool can_reverse(const PreparedPlan& plan) const noexcept { return last_stance(plan).interval >= 0; }

  WaitingFor waiting_for() const { return waiting_for_; }
  int waiting_limb() const { return waiting_limb_; }
  double waited_s() const { return waited_s_; }
  void wait_anew() noexcept { waited_s_ = 0.0; }

 private:
  /// True when `wanted` is seen on every limb that `concerns`; else remembers the first one that is missing.
  template <class Concerns>
  bool all_seen(WaitingFor what, bool LimbEvents::* wanted, const PerLimb<LimbEvents>& events,
                Concerns concerns) noexcept;
  void stop_at(double elapsed_s, double dt_s, double pace = 0.0) noexcept;
  void verify(const PreparedPlan& plan, const PerLimb<LimbEvents>& events) noexcept;
  void cross_knot(const PreparedPlan& plan) noexcept;
  double left_s(const PreparedPlan& plan) const noexcept;
  PlanTime next_stance(const PreparedPlan& plan) const noexcept;
  PlanTime last_stance(const PreparedPlan& plan) const noexcept;
  bool stops() const { return stop_.interval >= 0; }

  PlanTime now_;
  PlanTime stop_{-1, 0.0};  ///< where the motion ends; none: at the plan's end
  bool arrived_ = false;    ///< at `stop_`
  PlanTime verified_{-1, 0.0};
  WaitingFor waiting_for_ = WaitingFor::kNothing;
  int waiting_limb_ = -1;
  double waited_s_ = 0.0;
  double pace_ = 1.0;  ///< share of its speed: less before and after a stop
};

}  // namespace crux
