// A pull on each grasp just made, towards the load to come, before another limb releases.
#pragma once

#include "core/loads/grasp_force.hpp"
#include "core/plan/reference_player.hpp"

namespace crux {

/// What the grasp that `limb` makes at `at` is to be pulled with: the heaviest load planned for it and a margin, as far
/// as the fingers hold it by the plan's friction.
Wrench test_load_W(const PreparedPlan& plan, const PlanTime& at, int limb, const Vector3& finger_axis_W,
                   const Contact& contact, const RobotDescription& robot) noexcept;

/// Most that the grasp of another limb may need while one is pulled [N]: what the plan loads its present grip with, and
/// the same margin.
double testable_N(const PreparedPlan& plan, const PlanTime& at, int limb, const Vector3& finger_axis_W,
                  const Contact& contact, const RobotDescription& robot) noexcept;

/// The pull on one grasp at a time: the load grows as far as the fingers press for it and the other limbs bear it,
/// stands, and goes while the grasp, once passed, takes up what the plan wants it to bear.
class GraspPull {
 public:
  enum class Result { kNone, kPassed, kFailed };

  /// One cycle as the pull sees it.
  struct Seen {
    Vector3 gripper_W_m = Vector3::Zero();  ///< of the grasp under test
    double slid_m = 0.0;                    ///< on its hold, beyond play
    double pressed = 1.0;                   ///< share of the load that the fingers press enough for
    PerLimb<double> needs_N{};  ///< grasp force; infinite where a joint gives all it should: ends the pull of any limb
    PerLimb<double> borne_N{};  ///< the most that each has borne: the load grows slowly where another limb needs more
  };

  // How far a grasp may give way beyond what play of the joints explains (StanceFit::slid_m): while the load grows, and
  // under the standing load; or in all, where too few limbs hold to tell. A gripper seems to move under a standing load
  // too, as long as other limbs go through their play.
  static constexpr double kMaxSlide_m = 0.01, kMaxCreep_m = 0.002, kMaxWay_m = 0.025;

  void reset() noexcept { *this = GraspPull(); }

  /// The limb grips anew: nothing is known of its grasp.
  void forget(int limb) noexcept { result_[limb] = Result::kNone; }

  /// Begins on `limb` with a pull up to `load_W`, or until another limb needs more than its share of `bearable_N`
  /// (testable_N); nothing where another is on its way.
  void begin(int limb, const Wrench& load_W, const PerLimb<double>& bearable_N) noexcept;

  /// One period. Where the fingers never seem to press enough the load grows all the same, `press_s` after the pull
  /// began: one sensor stops no climb.
  void advance(const Seen& seen, const GraspTestParameters& test, double dt_s) noexcept;

  int limb() const { return limb_; }                                       ///< under test; -1: none
  Wrench pull_W() const noexcept { return load_W_ * smoothstep(share_); }  ///< that it is to bear now
  const Wrench& load_W() const { return load_W_; }
  double gave_way_m() const { return gave_way_m_; }  ///< in the present or last test, of at most `limit_m`
  double limit_m() const { return limit_m_; }
  Result result(int limb) const { return result_[limb]; }
  /// Its grasp is under test or was tested since it gripped.
  bool begun(int limb) const { return limb == limb_ || result_[limb] != Result::kNone; }

 private:
  /// Whether no other limb needs more than `most_N` of it.
  bool others_within(const PerLimb<double>& needs_N, const PerLimb<double>& most_N) const noexcept;
  void load_more(double step, const Seen& seen, const GraspTestParameters& test) noexcept;

  int limb_ = -1;
  double time_s_ = 0.0;  ///< of loading, then of standing
  double share_ = 0.0;   ///< of the load
  bool standing_ = false;
  bool easing_ = false;
  bool failed_ = false;
  double gave_way_m_ = 0.0, limit_m_ = kMaxSlide_m;
  Wrench load_W_;
  PerLimb<double> bearable_N_{};
  double loaded_slid_m_ = 0.0;
  Vector3 unloaded_W_m_ = Vector3::Zero();
  PerLimb<Result> result_{};
};

}  // namespace crux
