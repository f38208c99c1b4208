// The grips of all limbs: what each is known to bear, whether it slips, the pull that tests a new one, and what is done
// where one fails or a hold is not where it should be.
#pragma once

#include <cstdint>

#include "core/estimate/compliance_estimator.hpp"
#include "core/estimate/drift_watch.hpp"
#include "core/estimate/slip_watch.hpp"
#include "core/estimate/stance_fit.hpp"
#include "core/grips/cycle_view.hpp"
#include "core/grips/grasp_pull.hpp"
#include "core/grips/grasp_retry.hpp"
#include "core/grips/hold_search.hpp"
#include "core/grips/wall_touch.hpp"
#include "core/loads/wrench_distribution.hpp"
#include "core/plan/plan_clock.hpp"

namespace crux {

class Grips {
 public:
  explicit Grips(const RobotDescription& robot);

  /// Another plan begins: pulls, tries and searches of the one before say nothing of it.
  void begin_plan() noexcept;
  /// Contact counts from now on, wherever the grippers are.
  void begin_contact() noexcept { stance_.begin_anew(); }
  /// The plan's clock starts: play that was seen does not show while nothing moves.
  void begin_climb() noexcept { stance_.forget_play(); }
  /// An operator has looked: pulls, tries and slips are forgotten.
  void forgive() noexcept;

  /// Once a cycle, with a plan: compares the grips with each other.
  /// `climbs`: the plan's clock runs, and may wait.
  void watch(const CycleView& now, bool climbs, double dt_s) noexcept;

  /// Keeps the fingers open of a limb that is to grip beside its first place, comes down beside it or touches the wall.
  void hold_open(PlanReference& reference) noexcept;

  /// Once a cycle: pulls the grasp under test, and sends a limb whose grasp failed, or that finds no hold, beside its
  /// place. `climbs`: otherwise no limb is sent anywhere, and one that touches the wall comes back.
  void pull_new_grasps(const CycleView& now, PerLimb<LimbController>& limbs, bool climbs, double dt_s) noexcept;

  /// Before the clock advances by `events`: a gripper has arrived only once its hold is found and, where the body's
  /// height is `unsure`, it has touched the wall; it has gripped only once its grasp has passed the pull.
  void judge(const CycleView& now, PlanClock& clock, PerLimb<LimbController>& limbs, bool unsure,
             PerLimb<LimbEvents>& events, double dt_s) noexcept;

  /// Of the limb that touched the wall in this cycle: how much higher it is than that makes it. Limb -1: none.
  struct Touched {
    int limb = -1;
    double high_m = 0.0;
  };
  const Touched& touched() const { return touched_; }
  bool touches_wall(int limb) const { return touches_[limb].busy(); }
  bool presses_wall(int limb) const { return touches_[limb].presses(); }

  /// In HOLDING, with a hold lost or giving way: runs the clock back, once, until a limb in the air grips. Where that
  /// limb comes down already, or its fingers close, the clock runs forward until it bears. `hold`: the operator
  /// commands HOLD.
  void find_hold_again(const CycleView& now, PlanClock& clock, PerLimb<LimbController>& limbs, bool hold,
                       double dt_s) noexcept;

  const GraspPull& pull() const { return pull_; }
  const StanceFit& stance() const { return stance_; }
  const SlipWatch& slip(int limb) const { return slips_[limb]; }
  double compliance_m_N(int limb) const { return compliances_[limb].compliance_m_N(); }
  /// A limb in the air is on its way back to a hold after another has lost its own.
  bool returns() const { return return_ == Return::kOnItsWay; }
  int slipping_limb() const noexcept;  ///< the first; -1: none
  /// The one that slips or seems to creep, for which the plan's clock waits; -1: none.
  int moving_limb() const noexcept;
  const DriftWatch::Told& drift() const { return drift_.told(); }
  /// The limb is neither pulled nor opening for another try.
  bool rests(int limb) const noexcept { return pull_.limb() != limb && retry_.limb() != limb; }

  /// Share of its load that a limb bears; nothing once it has lost its hold.
  double load(const CycleView& now, int limb, const LimbReference& reference) const noexcept;
  /// How far the foot of a limb has slid along its surface since it stood; nothing of what does not stand.
  double foot_slid_m(const CycleView& now, int limb) const noexcept;
  /// What each limb is to bear by plan or pull, and how much of it.
  PerLimb<Bearer> bearers(const CycleView& now, const PlanReference& reference) const noexcept;
  /// The contact with the friction that the grasp is known to have: the plan's until it slips.
  Contact known_contact(const CycleView& now, int limb) const noexcept;
  /// limb_telemetry_t.utilisation, by what sensor and fingers feel; by the planned wrench where no sensor is trusted.
  double utilisation(const CycleView& now, int limb) const noexcept;

 private:
  /// Of a limb in the air to the hold it left, or comes down on, when another has lost its own.
  enum class Return : std::uint8_t { kNone, kOnItsWay, kOver };

  /// Share of its load that a limb bears while it slips.
  double relief(const CycleView& now, int limb) const noexcept;
  /// What a foot is to bear of itself as it touches down, until its load takes over, so that it stays on its surface.
  Wrench touch_W(const CycleView& now, const LimbReference& reference) const noexcept;
  /// Share of the pull's load that the fingers of the limb under test press enough for.
  double pressed_share(const CycleView& now, int limb) const noexcept;
  void begin_pull(const CycleView& now, const PlanTime& at, int limb) noexcept;
  /// Sends a limb whose finger stands on its hold over to the side where the hold is.
  void search_hold(const CycleView& now, PlanClock& clock, LimbController& limb, int l, LimbEvents& events,
                   double dt_s) noexcept;
  /// Sends a limb that has arrived down to the wall, and back.
  void touch_wall(const CycleView& now, PlanClock& clock, LimbController& limb, int l, bool unsure, LimbEvents& events,
                  double dt_s) noexcept;

  StanceParameters parameters_;
  StanceFit stance_;
  PerLimb<SlipWatch> slips_;
  DriftWatch drift_;
  PerLimb<ComplianceEstimator> compliances_;
  GraspPull pull_;
  GraspRetry retry_;
  PerLimb<HoldSearch> searches_;
  PerLimb<WallTouch> touches_;
  Touched touched_;
  PerLimb<bool> rubs_{};                            ///< a finger, on the hold that its limb lifts from
  PerLimb<double> foot_trust_{1.0, 1.0, 1.0, 1.0};  ///< share of friction that a foot is asked for: less once it slides
  PerLimb<double> borne_N_{};  ///< grasp force for the most that each grip has borne; none once it slipped
  Return return_ = Return::kNone;
};

/// What a limb on a foothold may be asked to bear: within friction by as much as grasps are.
FootCone foot_cone(const CycleView& now, const LimbReference& reference) noexcept;

/// The contact of a limb's grip as planned, opened as it was found.
Contact contact(const CycleView& now, int limb, const LimbReference& reference) noexcept;

}  // namespace crux
