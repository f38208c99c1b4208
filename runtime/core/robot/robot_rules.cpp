#include "core/robot/robot_rules.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <span>

#include "core/robot/description_problem.hpp"
#include "core/robot/geometry.hpp"
#include "core/robot/reason.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {
namespace {

namespace bounds = crux_msgs::robot;

bool same(double found, double wanted) { return std::abs(found - wanted) <= bounds::kAlike; }

bool same(const Vector3& found, const Vector3& wanted) {
  return same(found.x(), wanted.x()) && same(found.y(), wanted.y()) && same(found.z(), wanted.z());
}

std::string range(double low, double high) { return shown(low) + ".." + shown(high); }

template <class Names>
std::string listed(const Names& names) {
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
  return all;
}

class Rules {
 public:
  Rules(const Urdf& urdf, std::string path, std::string body_link)
      : urdf_(urdf), path_(std::move(path)), body_link_(std::move(body_link)) {}

  /// All links hang on the body link, each on one joint.
  void check_tree() const {
    if (urdf_.link(body_link_) == nullptr)
      refuse(path_, "link " + body_link_, "", "no such link (body_link of robot.yaml)");
    std::map<std::string, const UrdfJoint*> by_child;
    for (const UrdfJoint& joint : urdf_.joints) {
      if (joint.child == body_link_) refuse_joint(joint, joint.child, "expected no joint above robot.yaml's body_link");
      if (const auto [other, added] = by_child.emplace(joint.child, &joint); !added)
        refuse_joint(joint, joint.child, "this link hangs on joint " + other->second->name + " already");
    }
    for (const UrdfLink& link : urdf_.links) {
      std::string above = link.name;
      std::size_t steps = 0;
      for (auto j = by_child.find(above); j != by_child.end() && steps <= by_child.size(); j = by_child.find(above)) {
        above = j->second->parent;
        ++steps;
      }
      if (above != body_link_) refuse(path_, "link " + link.name, "", "expected it to hang on " + body_link_);
    }
  }

  /// The joints of a limb and the gripper's mount.
  std::vector<const UrdfJoint*> chain(const std::string& limb, const LimbNames& names) const {
    if (urdf_.link(names.gripper_link) == nullptr)
      refuse(path_, "link " + names.gripper_link, "", "no such link (gripper of limb " + limb + ")");
    std::vector<const UrdfJoint*> chain;
    for (std::string link = names.gripper_link; link != body_link_; link = chain.back()->parent)
      chain.push_back(urdf_.joint_above(link));
    std::ranges::reverse(chain);
    std::vector<std::string> moving;
    for (const UrdfJoint* joint : chain)
      if (joint->kind != "fixed") moving.push_back(joint->name);
    const std::size_t least = bounds::kLeastJoints,
                      count = std::min(std::max(moving.size(), least), names.joints.size());
    if (!std::ranges::equal(moving, std::span(names.joints).first(count)))
      refuse(path_, "limb " + limb, listed(moving),
             "expected the joints " + listed(names.joints) + " from the body outwards" +
                 (names.joints.size() > least ? ", or the first " + std::to_string(least) + " or more of them" : ""));
    if (chain.back()->kind != "fixed")
      refuse(path_, "limb " + limb, "",
             "expected " + std::to_string(moving.size()) + " joints and then the fixed mount of the gripper");
    for (const UrdfJoint* joint : chain)
      if (joint->kind != "fixed" && joint->kind != "revolute") refuse_joint(*joint, joint->kind, "expected revolute");
    return chain;
  }

  /// Finger 1 opens along the gripper's x, finger 2 against it, both as far as robot.yaml says.
  std::array<const UrdfJoint*, 2> fingers(const LimbNames& names, const std::array<double, 2>& opening_m) const {
    const std::array<Vector3, 2> axes = {Vector3::UnitX(), -Vector3::UnitX()};
    std::array<const UrdfJoint*, 2> fingers{};
    for (std::size_t f = 0; f < fingers.size(); ++f) {
      const UrdfJoint* joint = fingers[f] = urdf_.joint(names.finger_joints[f]);
      if (joint == nullptr || joint->parent != names.gripper_link)
        refuse(path_, "joint " + names.finger_joints[f], "", "expected a prismatic joint on " + names.gripper_link);
      if (joint->kind != "prismatic" || !same(joint->axis, axes[f]))
        refuse_joint(*joint, joint->kind + " along " + shown(joint->axis),
                     "expected prismatic along " + shown(axes[f]));
      if (!same(joint->xyz_m, Vector3::Zero()) || !same(joint->rpy_rad, Vector3::Zero()))
        refuse_joint(*joint, "xyz " + shown(joint->xyz_m) + ", rpy " + shown(joint->rpy_rad),
                     "expected 0 0 0 and 0 0 0: the opening counts from the gripper's origin");
      if (!same(joint->lower, opening_m[0]) || !same(joint->upper, opening_m[1]))
        refuse_joint(*joint, range(joint->lower, joint->upper),
                     "expected " + range(opening_m[0], opening_m[1]) + ", gripper.opening_m of robot.yaml");
    }
    return fingers;
  }

  /// What moves has a mass, and nothing else has one or moves.
  void check_bodies(const PerLimb<LimbChain>& limbs) const {
    std::set<std::string> joints, parts = {body_link_};
    const auto add = [&](const UrdfJoint* joint) {
      if (joint->kind != "fixed") joints.insert(joint->name), parts.insert(joint->child);
    };
    for (const LimbChain& limb : limbs) {
      parts.insert(limb.joints.back()->child);
      std::ranges::for_each(limb.joints, add);
      std::ranges::for_each(limb.fingers, add);
    }
    for (const UrdfJoint& joint : urdf_.joints)
      if (!joints.contains(joint.name) && joint.kind != "fixed")
        refuse_joint(joint, joint.kind, "expected fixed: no joint of a limb or finger");
    for (const UrdfLink& link : urdf_.links) {
      const std::string key = "link " + link.name, mass = "mass " + shown(link.mass_kg);
      if (!parts.contains(link.name) && link.mass_kg > 0.0)
        refuse(path_, key, mass, "expected 0: no body, limb or finger; add it to the link it is fixed to");
      if (parts.contains(link.name) && link.mass_kg < bounds::kMinMassKg)
        refuse(path_, key, mass, "expected at least " + shown(bounds::kMinMassKg) + " kg: this link moves");
    }
  }

  /// Each limb starts in the quadrant that its name says.
  static void check_side(const std::string& path, const std::string& limb, const LimbChain& chain) {
    Vector3 place = Vector3::Zero();
    Matrix3 turn = Matrix3::Identity();
    const UrdfJoint* first = chain.joints.front();
    for (const UrdfJoint* joint : chain.joints) {
      place += turn * joint->xyz_m;
      turn = turn * rotation_from_rpy(joint->rpy_rad);
      first = joint;
      if (joint->kind != "fixed") break;
    }
    const double along = limb[1] == 'F' ? 1.0 : -1.0, aside = limb[0] == 'L' ? 1.0 : -1.0;
    if (place.x() * along <= bounds::kAlike || place.y() * aside <= bounds::kAlike)
      refuse(path, "joint " + first->name, "xyz " + shown(place),
             std::string("expected x ") + side(along) + " 0 and y " + side(aside) + " 0 for limb " + limb);
  }

 private:
  [[noreturn]] void refuse_joint(const UrdfJoint& joint, const std::string& value, const std::string& expected) const {
    refuse(path_, "joint " + joint.name, value, expected);
  }

  static const char* side(double sign) { return sign > 0.0 ? "above" : "below"; }

  const Urdf& urdf_;
  std::string path_;
  std::string body_link_;
};

}  // namespace

PerLimb<LimbChain> checked_limbs(const Urdf& urdf, const std::string& path, const std::string& body_link,
                                 const PerLimb<LimbNames>& names, const std::array<double, 2>& opening_m) {
  const Rules rules(urdf, path, body_link);
  rules.check_tree();
  PerLimb<LimbChain> limbs;
  for (int l = 0; l < kLimbs; ++l) {
    limbs[l].joints = rules.chain(kLimbNames[l], names[l]);
    limbs[l].fingers = rules.fingers(names[l], opening_m);
  }
  rules.check_bodies(limbs);
  for (int l = 0; l < kLimbs; ++l) Rules::check_side(path, kLimbNames[l], limbs[l]);
  return limbs;
}

}  // namespace crux
