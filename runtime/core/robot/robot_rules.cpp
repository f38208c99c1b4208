#include "core/robot/robot_rules.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

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

/// A joint of a limb, or the gripper's mount, placed in the frame of the joint before it.
struct Step {
  const UrdfJoint* joint;
  Vector3 xyz_m;
  Vector3 rpy_rad;
  bool against;  ///< the joint turns against the axis that the closed form has
};

/// Roll 0 where x points straight up or down.
Vector3 roll_pitch_yaw(const Matrix3& turn) {
  const double level = std::hypot(turn(2, 1), turn(2, 2)), pitch = std::atan2(-turn(2, 0), level);
  if (level < bounds::kAlike) return {0.0, pitch, std::atan2(-turn(0, 1), turn(1, 1))};
  return {std::atan2(turn(2, 1), turn(2, 2)), pitch, std::atan2(turn(1, 0), turn(0, 0))};
}

/// The joints that move, and all fixed ones behind the last of them as one; those in between move the next joint.
std::vector<Step> steps(const std::vector<const UrdfJoint*>& chain) {
  std::vector<Step> all;
  Vector3 place = Vector3::Zero();
  Matrix3 turn = Matrix3::Identity();
  bool fixed = false;
  for (const UrdfJoint* joint : chain) {
    place += turn * joint->xyz_m;
    turn = turn * rotation_from_rpy(joint->rpy_rad);
    const bool last = joint == chain.back();
    if (joint->kind == "fixed" && !last) {
      fixed = true;
      continue;
    }
    Step step{joint, fixed ? place : joint->xyz_m, fixed ? roll_pitch_yaw(turn) : joint->rpy_rad, false};
    if (!last && all.size() < std::size(bounds::kJointAxes)) {
      const auto& wanted = bounds::kJointAxes[all.size()];
      step.against = joint->axis.dot(Vector3(wanted[0], wanted[1], wanted[2])) < 0.0;
    }
    all.push_back(step);
    place.setZero();
    turn.setIdentity();
    fixed = false;
  }
  return all;
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

  /// The six joints of a limb and the gripper's mount, of the form that the planner's closed form needs.
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
    if (!std::ranges::equal(moving, names.joints))
      refuse(path_, "limb " + limb, listed(moving),
             "expected the joints " + listed(names.joints) + " from the body outwards");
    if (chain.back()->kind != "fixed")
      refuse(path_, "limb " + limb, "",
             "expected " + std::to_string(kJoints) + " joints and then the fixed mount of the gripper");
    const std::vector<Step> all = steps(chain);
    for (int j = 0; j < kJoints; ++j) {
      const auto& wanted = bounds::kJointAxes[j];
      const Vector3 axis(wanted[0], wanted[1], wanted[2]);
      const UrdfJoint& joint = *all[j].joint;
      if (joint.kind != "revolute" || !same(all[j].against ? Vector3(-joint.axis) : joint.axis, axis))
        refuse_joint(joint, joint.kind + " about " + shown(joint.axis),
                     "expected revolute about " + shown(axis) + ", or against it");
    }
    check_origins(all);
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

  /// All limbs are mirror images of the first, each in the quadrant that its name says.
  void check_mirrored(const PerLimb<LimbChain>& limbs) const {
    const std::vector<Step> first = steps(limbs[0].joints);
    for (int l = 0; l < kLimbs; ++l) {
      const std::string limb = kLimbNames[l];
      const double along = limb[1] == 'F' ? 1.0 : -1.0, aside = limb[0] == 'L' ? 1.0 : -1.0;
      const std::vector<Step> own = steps(limbs[l].joints);
      const Step& shoulder = own[0];
      if (shoulder.xyz_m.x() * along <= bounds::kAlike || shoulder.xyz_m.y() * aside <= bounds::kAlike)
        refuse_joint(*shoulder.joint, "xyz " + shown(shoulder.xyz_m),
                     std::string("expected x ") + side(along) + " 0 and y " + side(aside) + " 0 for limb " + limb);
      for (int j = 0; j <= kJoints; ++j) {
        const Step &one = first[j], &other = own[j];
        const Vector3 mirror = j == 0 ? Vector3(along, aside, 1.0) : Vector3(1.0, 1.0, 1.0);
        const Vector3 place = one.xyz_m.cwiseProduct(mirror);
        if (!same(other.xyz_m, place))
          refuse_unlike(*other.joint, "xyz " + shown(other.xyz_m), shown(place), *one.joint);
        const bool mirrored = along * aside < 0.0 && (j == 0 || j == 4 || j == 5);
        const bool turned = mirrored != (one.against != other.against);
        const double low = turned ? -one.joint->upper : one.joint->lower;
        const double high = turned ? -one.joint->lower : one.joint->upper;
        if (j < kJoints && (!same(other.joint->lower, low) || !same(other.joint->upper, high)))
          refuse_unlike(*other.joint, range(other.joint->lower, other.joint->upper), range(low, high), *one.joint);
      }
      const double x = along * std::cos(first[0].rpy_rad.z()), y = aside * std::sin(first[0].rpy_rad.z());
      const double yaw = shoulder.rpy_rad.z();
      if (std::hypot(std::cos(yaw) - x, std::sin(yaw) - y) > bounds::kSameDirectionRad)
        refuse_unlike(*shoulder.joint, "yaw " + shown(yaw, "%.4g"), shown(std::atan2(y, x), "%.4g"), *first[0].joint);
    }
  }

 private:
  [[noreturn]] void refuse_joint(const UrdfJoint& joint, const std::string& value, const std::string& expected) const {
    refuse(path_, "joint " + joint.name, value, expected);
  }

  [[noreturn]] void refuse_unlike(const UrdfJoint& joint, const std::string& value, const std::string& wanted,
                                  const UrdfJoint& first) const {
    refuse_joint(joint, value, "expected " + wanted + ", mirrored from " + first.name + ": all limbs are alike");
  }

  static const char* side(double sign) { return sign > 0.0 ? "above" : "below"; }

  /// Links along x, a wrist in one point, the gripper on the last axis.
  void check_origins(const std::vector<Step>& all) const {
    const std::string least = shown(bounds::kMinLinkM);
    for (int j = 0; j <= kJoints; ++j) {
      const Step& step = all[j];
      const UrdfJoint& joint = *step.joint;
      const std::string xyz = "xyz " + shown(step.xyz_m), rpy = "rpy " + shown(step.rpy_rad);
      const double x = step.xyz_m.x(), y = step.xyz_m.y(), z = step.xyz_m.z();
      if (j == 0 || j == kJoints) {
        if (!same(step.rpy_rad.x(), 0.0) || !same(step.rpy_rad.y(), 0.0))
          refuse_joint(joint, rpy, "expected a turn about z only");
        if (j == kJoints && !(same(x, 0.0) && same(y, 0.0) && z <= -bounds::kMinLinkM))
          refuse_joint(joint, xyz, "expected the gripper on the last axis: 0 0 z, z at most -" + least);
        continue;
      }
      if (j == 2 || j == 3) {
        if (!same(y, 0.0) || !same(z, 0.0) || x < bounds::kMinLinkM)
          refuse_joint(joint, xyz, "expected a link along x: x 0 0, x at least " + least);
      } else if (!same(step.xyz_m, Vector3::Zero())) {
        refuse_joint(joint, xyz, "expected 0 0 0: the axes meet in one point");
      }
      if (!same(step.rpy_rad, Vector3::Zero())) refuse_joint(joint, rpy, "expected 0 0 0");
    }
  }

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
  rules.check_mirrored(limbs);
  return limbs;
}

}  // namespace crux
