// Forward kinematics of one limb, with what gravity needs: Jacobian and mass distribution.
#pragma once

#include <array>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/jntarray.hpp>
#include <vector>

#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Where one limb is, seen from the body.
struct LimbState {
  Pose gripper_B;              ///< B <- G
  LimbJacobian jacobian_B;     ///< rows: velocity of the gripper centre, angular velocity; axes of B
  JointVector distal_mass_kg;  ///< mass moved by each joint
  std::array<Vector3, kJoints> distal_moment_B_kgm;  ///< Σ mᵢ·cᵢ of that mass about B's origin
  double mass_kg = 0.0;                              ///< of the whole limb
  Vector3 moment_B_kgm = Vector3::Zero();            ///< Σ mᵢ·cᵢ of the whole limb
};

/// One limb's chain with its solvers. Construct outside the real-time thread; the members below do not allocate.
class LimbKinematics {
 public:
  explicit LimbKinematics(const LimbDescription& limb);
  // The solvers refer to the chain of this very object.
  LimbKinematics(const LimbKinematics&) = delete;
  LimbKinematics& operator=(const LimbKinematics&) = delete;

  /// Pose, Jacobian and masses at q [rad]. Turns that the limb does not make have no column.
  void evaluate(const JointVector& q_rad, LimbState& state) noexcept;

  /// Gripper pose and Jacobian alone, for iterations, which may turn the gripper in all ways.
  void evaluate(const JointVector& q_rad, Pose& gripper_B, LimbJacobian& jacobian_B) noexcept;

 private:
  KDL::Chain chain_;
  int driven_, turns_;
  KDL::ChainFkSolverPos_recursive position_solver_;
  KDL::JntArray joints_;
  std::vector<KDL::Frame> frames_;  ///< tip of every segment
  std::array<unsigned int, kJoints> segment_of_joint_{};
  std::vector<double> mass_kg_;     ///< of every segment
  std::vector<KDL::Vector> com_m_;  ///< in its tip frame
  std::vector<int> last_joint_;     ///< index of the last joint that moves the segment
};

}  // namespace crux
