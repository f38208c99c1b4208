// The fingers of one gripper: what is measured of them, their actuator's command, and what both say of a hold.
#pragma once

#include <algorithm>

#include "core/loads/grasp_force.hpp"
#include "core/plan/reference_player.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

class Fingers {
 public:
  explicit Fingers(const RobotDescription& robot);

  /// Measured opening, its speed, and squeeze of a finger.
  void see(double opening_m, double speed_m_s, double force_N) noexcept {
    opening_m_ = opening_m;
    speed_m_s_ = speed_m_s;
    force_N_ = force_N;
  }
  /// Whether the force measured is gone by.
  void trust(bool trusts) noexcept { trusts_force_ = trusts; }
  /// Whether their node holds by itself: then their command stays with them.
  void stand(bool stand) noexcept { stand_ = stand; }

  /// Control begins with the fingers where they are.
  void engage() noexcept;
  /// They grip a hold: they are as far open as it is wide.
  void grip() noexcept { gripped_opening_m_ = opening_m_; }
  /// The run before had them `opening_m` open on their hold.
  void restore(double opening_m) noexcept;

  /// Once a cycle: they have pressed on a hold for long enough.
  bool gripped(const LimbReference& reference, double dt_s) noexcept;
  bool opened(const LimbReference& reference) const noexcept {
    return opening_m_ >= wanted_opening_m(reference) - std::max(reference.may_lack_m, supervisor_.open_tolerance_m);
  }

  /// As far as they are told, all but what counts as closed.
  bool opened_wide(const LimbReference& reference) const noexcept {
    return opening_m_ > wanted_opening_m(reference) - kLeastClosed_m;
  }
  /// They have not moved for as long as a screw takes to turn through the squeeze that it had.
  bool stands() const noexcept { return stood_s_ >= kStands_s; }
  /// They close from here, for another try.
  void close_again() noexcept { opened_m_ = opening_m_; }

  /// Presses with `wanted_N` on a hold, opens in the air.
  void grasp(const LimbReference& reference, double wanted_N, double dt_s) noexcept;
  /// Enables or disables closing at full speed.
  void hurry(bool hurries) noexcept { grasp_.hurry(hurries); }

  /// Squeeze of a finger; what the actuator's command makes of its opening where the sensor is not trusted.
  double force_N() const noexcept { return trusts_force_ ? force_N_ : expected_force_N(); }
  double measured_force_N() const noexcept { return force_N_; }
  double expected_force_N() const noexcept { return grasp_.expected_force_N(opening_m_, speed_m_s_); }
  /// What the force measured lacks of the expected one [N], and all of it where the fingers are open in the air and the
  /// limb touches nothing. Fingers that move tell nothing, nor does a force that is more: a self-locking screw keeps
  /// its squeeze when it is told to loosen.
  double residual_N(const LimbReference& reference, bool begun, bool touches) const noexcept;
  /// Half of what they are to press with now [N].
  double least_force_N() const noexcept { return 0.5 * grasp_.force_reference_N(); }

  double opening_m() const noexcept { return opening_m_; }
  double gripped_opening_m() const noexcept { return gripped_opening_m_; }
  /// From a pad's face to the gripper's centre, of a grip: as found, else as planned.
  double grip_opening_m(const LimbReference& reference, bool in_contact) const noexcept;

  /// By force and opening: there is something between them.
  bool presses() const noexcept { return !closed() && force_N_ >= contact_force_N_; }
  /// On their way to a hold or, before the plan has begun, on one, they have come to their closed stop: nothing is
  /// between them.
  bool finds_no_hold(const LimbReference& reference, bool begun) const noexcept;
  /// They close further than the hold that they had gripped is wide, and press with less than that: opening and force
  /// are two sensors.
  bool closes_on_nothing() const noexcept;

  double opening_command_m() const noexcept { return grasp_.opening_command_m(); }
  double force_reference_N() const noexcept { return grasp_.force_reference_N(); }

 private:
  /// In the air: as planned, and on leaving a hold that is wider than planned so much further.
  double wanted_opening_m(const LimbReference& reference) const noexcept {
    const double found_m = reference.opens_m > 0.0 ? gripped_opening_m_ + reference.opens_m : 0.0;
    return std::min(std::max(reference.finger_opening_m, found_m), gripper_.opening_m.high);
  }
  /// They are at their closed stop.
  bool closed() const noexcept;

  static constexpr double kLeastClosed_m = 0.001;  ///< fingers that came down about a hold close so far, or are jammed
  static constexpr double kStands_s = 0.5;

  GripperDescription gripper_;
  SupervisorParameters supervisor_;
  double contact_force_N_;
  GraspController grasp_;
  double opening_m_ = 0.0, speed_m_s_ = 0.0, force_N_ = 0.0;  ///< measured
  bool trusts_force_ = true, stand_ = false;
  double opened_m_ = 0.0;                 ///< before they closed
  double stood_m_ = 0.0, stood_s_ = 0.0;  ///< where they stand, and for how long
  double gripped_opening_m_ = 0.0;        ///< at contact
  double gripped_time_s_ = 0.0;
};

}  // namespace crux
