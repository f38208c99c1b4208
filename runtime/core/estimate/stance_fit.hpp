// The rigid fit of the stance, limb by limb: grippers that hold the wall do not move against each other. What one of
// them moves, seen from the others, its hold, its grip or its encoders have done.
#pragma once

#include <array>

#include "core/robot/geometry.hpp"
#include "core/robot/limb_kinematics.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Motion of a gripper against the rest of the stance, axes of the gripper.
struct Misfit {
  Vector3 shift_G_m = Vector3::Zero();
  Vector3 turn_G_rad = Vector3::Zero();
};

/// What the fit takes of a limb in a cycle.
struct FittedLimb {
  const LimbState* state = nullptr;
  JointVector torque_Nm = JointVector::Zero();  ///< measured
  Vector3 force_B_N = Vector3::Zero();          ///< on the gripper
  bool holds = false;                           ///< the gripper is closed on its hold
};

/// Every gripper that holds gives the motion of the body by itself, position and orientation. A limb is fitted against
/// the others alone (leave one out). Positions without orientations could not tell which limb it is: four grips in a
/// plane share one way to warp. Only change counts, since contact or within a window of time, so what joints were homed
/// wrongly and holds that are not on their places show only as far as the body moves.
/// A joint whose torque was small in the window may have gone through its play, which its encoder, at the motor, takes
/// for motion of the gripper: what such joints can explain of it is no slip.
class StanceFit {
 public:
  static constexpr int kWindows = 3;
  static constexpr std::array<int, kWindows> kCycles = {25, 100, 500};  ///< of each window

  /// `pad_radius_m`: as far from the gripper's opening axis a turn about it slides the pads.
  StanceFit(const StanceParameters& parameters, double pad_radius_m)
      : parameters_(parameters), pad_radius_m_(pad_radius_m) {}

  /// Contact counts from now on, wherever the grippers are.
  void begin_anew() noexcept {
    for (Standing& limb : limbs_) limb.holds = false;
  }

  /// What was seen of play counts no longer: more of it is possible again.
  void forget_play() noexcept { begun_ = false; }

  /// Once a cycle.
  void update(const PerLimb<FittedLimb>& limbs, double dt_s) noexcept;

  /// Against the others since contact; zero where fewer than two others hold.
  const Misfit& since_contact(int limb) const { return since_contact_[limb]; }
  /// How far that is, a turn as a joint's arm makes of it, of the limb without which the others fit best; else 0 [m].
  double misfit_m(int limb) const noexcept;
  /// The same without what pads that slide along their faces, or turn on them, move.
  double misfit_off_faces_m(int limb) const noexcept;
  /// How far of that it is along its faces, beyond what play of its own joints explains and what the others, by theirs,
  /// leave in doubt; a turn on them as the rim of a pad moves [m].
  double slid_m(int limb) const noexcept;
  /// Where the pads are on their faces since contact: along y and z of the gripper, and their rim by a turn about x
  /// [m].
  Vector3 place_m(int limb) const noexcept { return on_faces(since_contact_[limb]); }
  /// The limb without which the others fit best, in the shortest window; -1 where fewer than three hold.
  int odd_limb() const { return moved_[0].limb; }

  /// What moved within a window.
  struct Moved {
    int limb = -1;                                    ///< the odd one; -1: fewer than three held all the time
    bool alone = false;                               ///< the others fit much better
    Eigen::Vector2d way_m = Eigen::Vector2d::Zero();  ///< along its faces, beyond what play explains
    bool turns_alone = false;                         ///< the others fit much better, by their turns
    double turn_m = 0.0;                              ///< of a pad's rim by a turn on its face, beyond play
  };
  const Moved& moved(int window) const { return moved_[window]; }

  /// What moved slowly, looked at every kSampled cycles over so many samples (at 500 Hz: 1, 3 and 8 s).
  static constexpr int kDrifts = 3, kSampled = 25, kQuarters = 4;
  static constexpr std::array<int, kDrifts> kSamples = {20, 60, 160};
  struct Drift {
    int limb = -1;        ///< the odd one; -1: fewer than three held all the time
    bool steady = false;  ///< the others fit much better, and it moved on in each quarter of the time: that is no play
    Vector3 shift_G_m = Vector3::Zero();
    int joint = -1;          ///< whose encoder explains it better than a hold that gives way; -1: none
    double joint_rad = 0.0;  ///< what that encoder has drifted
    double travel_m = 0.0;   ///< of the grippers against the body meanwhile: what was homed wrongly shows by it
    double load_N = 0.0;     ///< by which the forces on the grippers changed meanwhile: what is soft shows by it
  };
  const Drift& drift(int window) const { return drifts_[window]; }
  /// The window that was looked at in this cycle; -1: none.
  int looked() const { return looked_; }
  /// What moved slowly up to now counts no longer.
  void forget_drift() noexcept { far_known_ = 0; }
  /// How far play has made grippers seem to move, lately, and so a pad's rim by a turn.
  double play_m() const { return play_m_; }
  double play_of_rim_m() const noexcept;

 private:
  using Row = Vector6;  ///< shift and turn of a gripper, axes of the stance's frame
  static constexpr int kPast = kCycles.back() + 1;
  static constexpr int kFarPast = kSamples.back() + 1;
  struct Sample {
    Row path = Row::Zero();
    Vector3 gripper_B_m = Vector3::Zero(), force_B_N = Vector3::Zero();
  };
  struct Standing {
    bool holds = false;
    int cycles = 0;                 ///< since contact
    Pose anchor_S;                  ///< of the gripper at contact
    Row off = Row::Zero();          ///< from the anchor, with the body where all limbs fit best
    Row path = Row::Zero();         ///< the same without the jumps of other limbs that grip or release
    std::array<Row, kPast> past{};  ///< of `path`
    std::array<Sample, kFarPast> far_past{};
    Matrix6 map = Matrix6::Identity();             ///< motion of the body to motion of the gripper
    LimbJacobian joints_G = LimbJacobian::Zero();  ///< motion of joints to motion of the gripper, its own axes
    Matrix3 rotation_GS = Matrix3::Identity();
    JointVector torque_Nm = JointVector::Zero();  ///< of the last cycle
    std::array<int, kJoints> idle_cycles_ago{};   ///< since the joint's torque was small or changed its sign
  };
  /// What a limb that counts says of the motion of the body: the normal equations it adds to.
  struct Word {
    bool counts = false;
    Row off = Row::Zero();
    Matrix6 normal = Matrix6::Zero();
    Vector6 gradient = Vector6::Zero();
    double squares = 0.0;  ///< of `off`, by its deviations
  };
  struct Fit {
    Row left = Row::Zero();  ///< what the limb itself is off the others
    double rest = 0.0;       ///< what the others are off each other, squared, by their deviations
    double doubt_m = 0.0;    ///< deviation of where the others have the gripper, along its faces
    double doubt_rad = 0.0;  ///< and of how they have it turned on them
  };

  bool lay_body(const PerLimb<FittedLimb>& limbs) noexcept;
  void look(Standing& limb, const FittedLimb& seen) noexcept;
  Matrix6 information(const Standing& limb, int cycles) const noexcept;
  Word word(const Standing& limb, const Row& off, const Matrix6& information) const noexcept;
  Fit fit_without(int limb, const PerLimb<Word>& words) const noexcept;
  /// The limb without which the others fit best; -1: fewer than three count.
  int odd_one(const PerLimb<Word>& words, Fit& fit) const noexcept;
  Vector3 on_faces(const Misfit& misfit) const noexcept;
  Misfit in_gripper(const Standing& limb, const Row& off) const noexcept;
  Misfit beyond_play(const Standing& limb, const Misfit& off, int cycles) const noexcept;
  void look_back(int window, double dt_s) noexcept;
  void remember(const PerLimb<FittedLimb>& limbs) noexcept;
  void look_far_back(int window) noexcept;
  /// The same from `older` to `newer` samples ago.
  PerLimb<Word> far_words(int older, int newer, const PerLimb<bool>& counted) const noexcept;
  bool moved_on(int limb, int window, const Row& left, const PerLimb<bool>& counted) const noexcept;
  void explain(const Standing& limb, const Misfit& off, Drift& drift) const noexcept;

  StanceParameters parameters_;
  double pad_radius_m_;
  Pose body_S_;  ///< S: the frame in which the grips stand still
  PerLimb<Standing> limbs_;
  PerLimb<Misfit> since_contact_;
  std::array<Moved, kWindows> moved_;
  int misfit_limb_ = -1;
  PerLimb<double> doubt_m_{}, doubt_rad_{};  ///< of since_contact_, along the faces and turned on them
  std::array<Drift, kDrifts> drifts_;
  double play_m_ = 0.0;
  int now_ = 0;                   ///< in `past`
  int far_now_ = 0, cycles_ = 0;  ///< in `far_past`, and since then
  int far_known_ = 0;             ///< samples that count
  int looked_ = -1;
  bool begun_ = false;
};

}  // namespace crux
