// One limb of the running robot: its measurements, its admittance and grasp, and the way from a wanted gripper pose to
// joint commands.
#pragma once

#include <crux_msgs/control_input_t.hpp>
#include <crux_msgs/control_output_t.hpp>
#include <crux_msgs/limb_telemetry_t.hpp>

#include "core/estimate/encoder_watch.hpp"
#include "core/estimate/oscillation_watch.hpp"
#include "core/estimate/wrench_estimator.hpp"
#include "core/limb/admittance.hpp"
#include "core/limb/calibration.hpp"
#include "core/limb/fingers.hpp"
#include "core/limb/joint_heat.hpp"
#include "core/loads/load_sharing.hpp"
#include "core/plan/plan_clock.hpp"
#include "core/plan/reference_player.hpp"
#include "core/robot/inverse_kinematics.hpp"
#include "core/robot/limb_kinematics.hpp"
#include "core/robot/node_protocol.hpp"

namespace crux {

class LimbController {
 public:
  LimbController(const RobotDescription& robot, int limb);
  LimbController(const LimbController&) = delete;
  LimbController& operator=(const LimbController&) = delete;

  /// Takes over what is fresh in `in`; the rest stays as it was. Forward kinematics.
  void sense(const crux_msgs::control_input_t& in) noexcept;
  /// The contact wrench, once the body pose is known.
  void sense_wrench(const Matrix3& rotation_WB, const Vector3& gravity_W_m_s2, double dt_s) noexcept;

  /// Control begins: whatever the gripper is off its reference becomes offset, so that the first command is the pose
  /// measured and the first torque the one measured. Unless the plan has `begun`, the gripper is on its hold only once
  /// its fingers press: somebody may hold the robot to the wall while they close.
  void engage(const LimbReference& reference, const Pose& body_W, bool begun) noexcept;

  /// What the run before knew of the limb: the bias of its force/torque sensor and, where it grips, where and how far
  /// its fingers are open there.
  void restore(const LimbReference& reference, bool grips, const Vector3& place_W_m, double opening_m,
               const Wrench& tare_G) noexcept;

  /// Another plan begins where the limb is: its command goes on from where it was for `before`. `engagement`: as at the
  /// last drive().
  void hand_over(const LimbReference& before, const LimbReference& now, double engagement) noexcept;

  /// The plan has where the limb holds on elsewhere from now on: what was found, and the command, stay what they are.
  void regrip(const LimbReference& before, const LimbReference& now) noexcept {
    grip_at(anchor_W_m(before), target_W(before), now);
  }

  /// Contact events as the plan's clock wants them.
  LimbEvents events(const LimbReference& reference, const Pose& body_W, double dt_s) noexcept;

  /// Where the limb grips, in W: the planned place and what it was found to be off at contact.
  Vector3 anchor_W_m(const LimbReference& reference) const {
    return reference.gripper_position_W_m + contact_offset_W_m_ + beside_W_m_;
  }

  /// The same with how its gripper was turned when that was found.
  Pose anchor_W(const LimbReference& reference) const { return {grip_rotation_W_, anchor_W_m(reference)}; }
  /// Whether it was.
  bool turn_found() const { return turn_found_; }

  /// The limb is on a hold or the ground.
  bool in_contact() const { return in_contact_; }
  /// It bears its load there, and where it grips is known: load takes up the play of its joints, so that the gripper
  /// seems to move until then.
  bool found() const { return found_; }

  /// Takes note of contact made and of the frame the limb aims from: the estimated body pose in the air, the commanded
  /// one on a hold, once its fingers press or it is pulled, and where it presses on the wall, for a limb that is held
  /// and aims from an estimate behind its own lag drives the body on. Commands are continuous over all. True in the
  /// cycle in which the limb's place is found.
  bool follow_contact(const LimbReference& reference, const Pose& body_estimate_W, const Pose& body_command_W,
                      bool pulled) noexcept;

  /// The limb is to grip `beside_W_m` off where it would otherwise.
  void aim_beside(const Vector3& beside_W_m, const LimbReference& reference) noexcept;

  /// The world the body's poses are counted in turns out to lie elsewhere by `motion`: where the limb holds moves
  /// along. With body poses moved likewise its commands stay what they are.
  void relocate(const Pose& motion, const LimbReference& reference) noexcept;

  /// What the limb can bear where it is, of a grip with `contact`.
  Capacity capacity(const Contact& contact, const Matrix3& rotation_WB, const Vector3& gravity_W_m_s2) const noexcept;

  /// Yields to the wrench error on a hold, as far as the limb's joints can (yielding_part.hpp), and to what it runs
  /// against in the air, where offsets fade; learns the F/T bias in free swing.
  void comply(const LimbReference& reference, const Wrench& all_W, const Matrix3& rotation_WB, double dt_s) noexcept;

  /// What comply() did last: its translation and its rotation.
  const Yielding& translation() const { return translation_; }
  const Yielding& rotation() const { return rotation_; }

  /// Gains of comply() from now on.
  void set_gains(const AdmittanceParameters& gains) noexcept { admittance_.set_parameters(gains); }

  /// Joint positions by inverse kinematics, and feed-forward torque from gravity and the wrench to bear. `engagement`
  /// 0..1 blends from what held the joints before control took over.
  void drive(const LimbReference& reference, const Wrench& wrench_W, const Vector3& gravity_W_m_s2,
             const Pose& body_estimate_W, double engagement, double dt_s) noexcept;

  /// Nodes hold by themselves: keep the commands at what is measured.
  void stand_by() noexcept { stay_at(q_rad_); }

  void write(NodeMode joint_mode, NodeMode gripper_mode, crux_msgs::control_output_t& out) const noexcept;
  void write(const Pose& body_W, const Wrench& wrench_reference_W, crux_msgs::limb_telemetry_t& out) const noexcept;

  /// An encoder that has frozen or jumped in this cycle, or none.
  const FaultEvent& encoder_fault() const { return encoders_.fault(); }
  /// A joint that oscillates, or none.
  const FaultEvent& oscillation() const { return shaking_.fault(); }
  /// An encoder has frozen since control took over. Its joint follows torques alone, so the limb's commands stand still
  /// and the others do without its word on where the body is.
  bool blind() const { return encoders_.frozen(); }

  /// Torque [Nm] of the joints that neither gravity nor the wrench felt nor gears that stick explain, and the most that
  /// it may be where the limb is planned to bear `planned_W`.
  double ft_residual_Nm() const noexcept;
  double ft_limit_Nm(const Wrench& planned_W, const Matrix3& rotation_WB) const noexcept;
  /// Change [Nm] of the joints' torques beyond gravity since the F/T sensor last gave other numbers.
  double ft_frozen_Nm() const { return (borne_Nm_ - borne_as_it_moved_Nm_).norm(); }

  Vector3 gripper_W_m(const Pose& body_W) const { return body_W * state_.gripper_B.position_m; }
  const LimbState& state() const { return state_; }
  const JointVector& torque_Nm() const { return torque_Nm_; }  ///< measured
  /// The greatest of its actuators, as a share of what that can give.
  double torque_share() const noexcept;
  const Wrench& wrench_W() const { return wrench_.wrench_W(); }
  /// Its joints bear what gravity does not explain: in the air it runs against something.
  bool runs_against() const { return borne_Nm_.norm() >= supervisor_.max_ft_residual_Nm; }
  const Wrench& tare_G() const { return wrench_.bias_G(); }
  /// In the air, something holds it: by this share of the torque and force that show it.
  bool caught(double share = 1.0) const {
    return borne_Nm_.norm() >= share * supervisor_.max_ft_residual_Nm &&
           wrench_W().force_N.norm() >= share * control_.unload_force_N;
  }
  bool force_torque_tared() const { return wrench_.tared(); }
  Fingers& fingers() { return fingers_; }
  const Fingers& fingers() const { return fingers_; }
  void trust_force_torque(bool trusts) noexcept { trusts_force_torque_ = trusts; }
  /// Whether a node of its joints, and that of its fingers, holds by itself. The commands of a limb with such a joint
  /// stand still until it follows again: what the limb cannot yield to must not add up in them.
  void stand(bool joint_stands, bool fingers_stand) noexcept {
    joint_stands_ = joint_stands;
    fingers_.stand(fingers_stand);
  }
  bool joint_stands() const noexcept { return joint_stands_; }
  /// Of one on a foothold: what its surface pushes it with, along the normal.
  double foot_force_N(const LimbReference& reference) const noexcept {
    return wrench_W().force_N.dot(reference.off_W());
  }
  /// It yields to no force: it is blind(), or a joint of it stands.
  bool rigid() const noexcept { return joint_stands_ || blind(); }
  /// Fingers::residual_N(), by what the F/T sensor feels.
  double finger_residual_N(const LimbReference& reference, bool begun) const noexcept {
    return fingers_.residual_N(reference, begun, wrench_W().force_N.norm() >= control_.unload_force_N);
  }
  /// Fingers::grip_opening_m(), as found where the limb is in contact.
  double grip_opening_m(const LimbReference& reference) const noexcept {
    return fingers_.grip_opening_m(reference, in_contact_);
  }
  /// Worst joint's distance from its command [rad] and its index.
  double tracking_error_rad(int& joint) const noexcept;
  double ik_error_m() const { return ik_.position_error_m; }
  /// What its joints' limits keep a gripping limb from: from where the gripper comes to where it should be.
  Vector3 missed_W_m(const LimbReference& reference) const noexcept;
  /// Distance [m] and angle [rad] of the gripper from `reference`.
  void pose_error(const LimbReference& reference, const Pose& body_W, double& distance_m,
                  double& angle_rad) const noexcept;

 private:
  /// A hold that was gripped: the plan's place for it, and where it was found.
  struct KnownHold {
    bool known = false;
    Vector3 planned_W_m = Vector3::Zero();
    Vector3 found_W_m = Vector3::Zero();

    Vector3 offset_m() const { return known ? Vector3(found_W_m - planned_W_m) : Vector3::Zero(); }
  };

  /// Once a cycle: its foot has pressed on its foothold for long enough.
  bool stands_on_foot(const LimbReference& reference, double dt_s) noexcept;
  bool presses() const noexcept { return fingers_.force_N() >= control_.min_grasp_force_N; }
  /// The commands are these angles, and do not move.
  void stay_at(const JointVector& q_rad) noexcept;
  Pose target_W(const LimbReference& reference) const noexcept;
  void aim_at(const Pose& target_W, const LimbReference& reference) noexcept;
  void find_turn(const Matrix3& rotation_W, const LimbReference& reference) noexcept;
  void grip_at(const Vector3& place_W_m, const Pose& target_W, const LimbReference& reference) noexcept;

  int limb_;
  ControlParameters control_;
  SupervisorParameters supervisor_;
  GripperDescription gripper_;
  ServoDescription servo_;
  Transmission transmission_;
  LimbLimits joints_, actuators_;
  int driven_;  ///< joints; slots behind them stand still

  LimbKinematics kinematics_;
  InverseKinematics inverse_;
  WrenchEstimator wrench_;
  EncoderWatch encoders_;
  OscillationWatch shaking_;
  JointHeat heat_;
  Admittance admittance_;
  Fingers fingers_;
  Yielding translation_, rotation_;

  // Measured.
  JointVector actuators_rad_ = JointVector::Zero(), actuators_Nm_ = JointVector::Zero();  ///< as their nodes tell
  JointVector q_rad_ = JointVector::Zero();
  JointVector torque_Nm_ = JointVector::Zero();
  bool trusts_force_torque_ = true;
  bool joint_stands_ = false;
  Wrench raw_G_;
  JointVector residual_Nm_ = JointVector::Zero();           ///< filtered as the wrench is
  JointVector borne_Nm_ = JointVector::Zero();              ///< torque beyond gravity, filtered likewise
  JointVector borne_as_it_moved_Nm_ = JointVector::Zero();  ///< that, as the F/T sensor last gave other numbers
  LimbState state_;

  // Commanded.
  Vector3 contact_offset_W_m_ = Vector3::Zero();
  Matrix3 grip_rotation_W_ = Matrix3::Identity();  ///< of the gripper on its hold,
  bool turn_found_ = false;                        ///< if it is known
  Vector3 beside_W_m_ = Vector3::Zero();           ///< aim_beside(), until contact
  /// At the beginning and at the end of the last swing; unknown before. So a limb that goes back,
  /// and forward again, finds its holds where they were.
  std::array<KnownHold, 2> known_;
  bool back_ = false;        ///< the swing is played in reverse
  Pose aim_W_;               ///< body pose the limb aims from
  bool in_contact_ = false;  ///< aims from the commanded body pose
  bool pulled_ = false;      ///< does so too, though the plan does not count it as in contact yet
  double late_s_ = 0.0;      ///< by which the cycle before began late, and asked the nodes for their readings
  double stood_s_ = 0.0;     ///< that its foot has pressed on its foothold
  bool blocked_ = false;     ///< something is in its way, and has not let it go since
  bool found_ = false;
  bool to_touch_ = false;  ///< not found before the fingers press
  Pose goal_B_;            ///< of the gripper, by the last command that moved
  IkResult ik_;            ///< its q is the command before the engagement blend
  JointVector command_q_rad_ = JointVector::Zero();
  JointVector command_dq_rad_s_ = JointVector::Zero();
  JointVector setpoint_lead_rad_ = JointVector::Zero();  ///< so that the nodes' filter comes out where the command is
  JointVector velocity_lead_rad_s_ = JointVector::Zero();
  JointVector command_torque_Nm_ = JointVector::Zero();
  JointVector held_offset_rad_ = JointVector::Zero();  ///< of the setpoint that held each joint from the joint itself
  JointVector held_torque_Nm_ = JointVector::Zero();
};

}  // namespace crux
