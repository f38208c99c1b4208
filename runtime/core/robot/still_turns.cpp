#include "core/robot/still_turns.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>

#include "crux_msgs/robot.hpp"

namespace crux {
namespace {

constexpr double kFarthest_rad = 0.5;  // what the admittance may ask for and no joint does
const std::array<KDL::Vector, 3> kAxes = {KDL::Vector(1, 0, 0), KDL::Vector(0, 1, 0), KDL::Vector(0, 0, 1)};

/// Of turns about some of the gripper's axes (a bit each) and the joints' columns, in the body's axes.
double determinant(const KDL::Jacobian& joints, const KDL::Rotation& gripper_B, unsigned axes) {
  Matrix6 columns = Matrix6::Zero();
  Eigen::Index at = joints.data.cols();
  columns.leftCols(at) = joints.data;
  for (unsigned axis = 0; axis < kAxes.size(); ++axis) {
    if ((axes >> axis & 1U) == 0) continue;
    const KDL::Vector turn = gripper_B * kAxes[axis];
    columns.col(at++).tail<3>() << turn.x(), turn.y(), turn.z();
  }
  return std::abs(columns.determinant());
}

}  // namespace

bool add_still_turns(LimbDescription& limb) {
  constexpr JointLimits kFree{-kFarthest_rad, kFarthest_rad, crux_msgs::robot::kMaxSpeed, crux_msgs::robot::kMaxEffort};
  std::fill(limb.joints.begin() + limb.driven, limb.joints.end(), kFree);
  const int missing = kPlacing - limb.driven;
  if (missing <= 0) return true;
  KDL::JntArray middle_rad(static_cast<unsigned>(limb.driven));
  for (int j = 0; j < limb.driven; ++j) {
    const JointLimits& joint = limb.joints[static_cast<std::size_t>(j)];
    middle_rad(static_cast<unsigned>(j)) = (joint.lower_rad + joint.upper_rad) / 2.0;
  }
  KDL::Frame gripper_B;
  KDL::ChainFkSolverPos_recursive(limb.chain).JntToCart(middle_rad, gripper_B);
  KDL::Jacobian joints(static_cast<unsigned>(limb.driven));
  KDL::ChainJntToJacSolver(limb.chain).JntToJac(middle_rad, joints);
  unsigned best = 0;
  double largest_m3 = 0.0;
  for (const unsigned axes : {1U, 2U, 4U, 3U, 5U, 6U, 7U}) {  // x, y, z, then pairs in this order
    if (std::popcount(axes) != missing) continue;
    const double size_m3 = determinant(joints, gripper_B.M, axes);
    if (size_m3 > largest_m3) largest_m3 = size_m3, best = axes;
  }
  if (largest_m3 < crux_msgs::robot::kLeastPlacedM3) return false;
  for (unsigned axis = 0; axis < kAxes.size(); ++axis) {
    if ((best >> axis & 1U) == 0) continue;
    limb.chain.addSegment(KDL::Segment(KDL::Joint(KDL::Vector::Zero(), kAxes[axis], KDL::Joint::RotAxis)));
  }
  return true;
}

}  // namespace crux
