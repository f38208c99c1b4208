// Slips of one gripper on its hold: when it is one, what is done about it, and when it is over.
#pragma once

#include <algorithm>

#include "core/estimate/stance_fit.hpp"
#include "core/robot/geometry.hpp"

namespace crux {

/// A gripper moves against the stance (one witness): it squeezes with all it has, which can be undone. Where its grip
/// bears as much of its squeeze as it ever did since contact, or more (two witnesses), it slips: its load goes to the
/// others and the plan waits until it stands.
class SlipWatch {
 public:
  explicit SlipWatch(const StanceParameters& parameters) : parameters_(parameters) {}

  /// Once a cycle. `used`: limit_surface_utilisation as felt; 0: not known yet; then only a way of max_slip_m
  /// counts.
  void update(int limb, const StanceFit& stance, bool holds, double used, double dt_s) noexcept;

  /// It is to bear next to nothing, as long as this is said in every cycle before update().
  void give_off_load() noexcept { gives_off_ = true; }

  /// Squeeze with all there is, until the gripper opens.
  bool squeezes() const { return squeezes_; }
  bool slips() const { return slips_; }
  /// It has slid too far in spite of that.
  bool out_of_hand() const { return out_of_hand_; }
  /// Slid since contact, from where its first slip began, a turn on the faces as the rim of a pad moves [m].
  double slid_m() const { return slid_m_; }
  /// Share of its load that it is to bear.
  double relief() const { return relief_; }
  /// The most that it was `used` since contact without a slip, the last moments left out: the grasp is as good as that.
  double borne() const { return most_used_; }
  /// `used` as it began to slip last, or the more that it has borne since: the grasp is no better than that, as far as
  /// is known. 0: it has not slipped since contact.
  double slipped_at() const { return slipped_at_ > 0.0 ? std::max(slipped_at_, most_used_) : 0.0; }

 private:
  void look_at_grip(double used) noexcept;
  int window_of_motion(int limb, const StanceFit& stance, bool witnessed) const noexcept;

  StanceParameters parameters_;
  bool squeezes_ = false, slips_ = false, out_of_hand_ = false, gives_off_ = false;
  double most_used_ = 0.0, lately_used_ = 0.0;  ///< since contact without, and with, the last moments
  double block_used_ = 0.0;
  double slipped_at_ = 0.0;
  int block_cycles_ = 0;
  int used_up_cycles_ago_ = 0;
  double witnessed_s_ = 0.0;
  double used_up_at_ = 0.0, slides_with_ = 0.0;  ///< `used` when it was used up last, and before its last slip was seen
  Vector3 from_m_ = Vector3::Zero();             ///< where its slip began (StanceFit::place_m)
  Vector3 last_m_ = Vector3::Zero(), rest_m_ = Vector3::Zero();
  double still_s_ = 0.0, slid_m_ = 0.0;
  double relief_ = 1.0;
};

}  // namespace crux
