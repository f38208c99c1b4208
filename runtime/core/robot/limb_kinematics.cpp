#include "core/robot/limb_kinematics.hpp"

#include <Eigen/Geometry>

namespace crux {
namespace {

Vector3 vector(const KDL::Vector& v) { return {v.x(), v.y(), v.z()}; }

Pose pose(const KDL::Frame& frame) {
  Pose p;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) p.rotation(row, column) = frame.M(row, column);
  }
  p.position_m = vector(frame.p);
  return p;
}

}  // namespace

LimbKinematics::LimbKinematics(const LimbDescription& limb)
    : chain_(limb.chain),
      driven_(limb.driven),
      turns_(limb.turns()),
      position_solver_(chain_),
      joints_(chain_.getNrOfJoints()),
      frames_(chain_.getNrOfSegments()) {
  int joint = -1;
  for (unsigned int i = 0; i < chain_.getNrOfSegments(); ++i) {
    const KDL::Segment& segment = chain_.getSegment(i);
    if (segment.getJoint().getType() != KDL::Joint::None) {
      segment_of_joint_[++joint] = i;
    }
    mass_kg_.push_back(segment.getInertia().getMass());
    com_m_.push_back(segment.getInertia().getCOG());
    last_joint_.push_back(joint);
  }
}

void LimbKinematics::evaluate(const JointVector& q_rad, Pose& gripper_B, LimbJacobian& jacobian_B) noexcept {
  joints_.data = q_rad.head(turns_);
  position_solver_.JntToCart(joints_, frames_);
  gripper_B = pose(frames_.back());
  // The solver for the Jacobian would go through the chain again, and move every column's point joint by joint.
  for (int j = 0; j < turns_; ++j) {
    const unsigned int i = segment_of_joint_[j];
    const KDL::Joint& joint = chain_.getSegment(i).getJoint();
    const KDL::Frame before = i > 0 ? frames_[i - 1] : KDL::Frame::Identity();
    const Vector3 axis_B = vector(before.M * joint.JointAxis());
    jacobian_B.col(j) << axis_B.cross(gripper_B.position_m - vector(before * joint.JointOrigin())), axis_B;
  }
  jacobian_B.rightCols(kJoints - turns_).setZero();
}

void LimbKinematics::evaluate(const JointVector& q_rad, LimbState& state) noexcept {
  evaluate(q_rad, state.gripper_B, state.jacobian_B);
  state.jacobian_B.rightCols(kJoints - driven_).setZero();
  double mass = 0.0;
  Vector3 moment = Vector3::Zero();
  int joint = kJoints - 1;
  // From the gripper inwards, so that the sums are at every joint what hangs on it.
  for (int i = static_cast<int>(frames_.size()) - 1; i >= 0; --i) {
    for (; joint > last_joint_[i]; --joint) {
      state.distal_mass_kg[joint] = mass;
      state.distal_moment_B_kgm[joint] = moment;
    }
    mass += mass_kg_[i];
    moment += mass_kg_[i] * vector(frames_[i] * com_m_[i]);
  }
  for (; joint >= 0; --joint) {
    state.distal_mass_kg[joint] = mass;
    state.distal_moment_B_kgm[joint] = moment;
  }
  state.mass_kg = mass;
  state.moment_B_kgm = moment;
}

}  // namespace crux
