// The part of URDF that crux reads, as crux_contracts.urdf has it: links with inertia and simple shapes, joints.
#pragma once

#include <Eigen/Core>

#include <string>
#include <vector>

#include "core/robot/geometry.hpp"

namespace crux {

struct UrdfLink {
  std::string name;
  double mass_kg = 0.0;
  Vector3 com_m = Vector3::Zero();
  Vector3 inertia_rpy_rad = Vector3::Zero();  ///< of the inertia's axes in the link's frame
  Matrix3 inertia_kg_m2 = Matrix3::Zero();    ///< about the centre of mass
};

struct UrdfJoint {
  std::string name;
  std::string kind;  ///< revolute, prismatic, continuous or fixed
  std::string parent;
  std::string child;
  Vector3 xyz_m = Vector3::Zero();
  Vector3 rpy_rad = Vector3::Zero();
  Vector3 axis = Vector3::UnitX();  ///< of length 1
  double lower = 0.0;               ///< rad or m, rad/s or m/s, Nm or N
  double upper = 0.0;
  double velocity = 0.0;
  double effort = 0.0;
};

struct Urdf {
  std::vector<UrdfLink> links;
  std::vector<UrdfJoint> joints;

  /// nullptr where there is none.
  const UrdfLink* link(const std::string& name) const;
  const UrdfJoint* joint(const std::string& name) const;
  /// The joint that a link hangs on, nullptr where there is none.
  const UrdfJoint* joint_above(const std::string& link) const;
};

/// @throws std::runtime_error naming file, link or joint, value and what would be right
Urdf parse_urdf(const std::string& xml, const std::string& path);

/// As a URDF writes it.
std::string shown(const Vector3& vector);

}  // namespace crux
