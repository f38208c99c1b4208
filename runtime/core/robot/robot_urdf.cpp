#include "core/robot/robot_urdf.hpp"

#include <tinyxml.h>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>

#include "core/robot/description_problem.hpp"
#include "core/robot/numbers.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {
namespace {

namespace bounds = crux_msgs::robot;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The largest absolute value that makes sense, and what to ask where a number is larger.
struct Most {
  double value;
  const char* unit;
  const char* hint;
};

constexpr Most kAny{kInfinity, "", ""};
constexpr Most kLength{bounds::kMaxLengthM, "m", ": are these millimetres?"};
constexpr Most kAngle{bounds::kMaxAngleRad, "rad", ": are these degrees?"};
constexpr Most kMass{bounds::kMaxMassKg, "kg", ": are these grams?"};

struct Shape {
  std::string_view tag;
  std::vector<std::pair<const char*, std::size_t>> sizes;
};

const std::array<Shape, 4> kShapes = {{{"box", {{"size", 3}}},
                                       {"sphere", {{"radius", 1}}},
                                       {"cylinder", {{"radius", 1}, {"length", 1}}},
                                       {"capsule", {{"radius", 1}, {"length", 1}}}}};

/// NaN for what is no decimal number.
std::vector<double> decimals(const std::string& text) {
  std::vector<double> values;
  for_each_word(text, [&](const std::string& word) { values.push_back(decimal(word).value_or(std::nan(""))); });
  return values;
}

class Reader {
 public:
  explicit Reader(std::string path) : path_(std::move(path)) {}

  UrdfLink link(const TiXmlElement& element) const {
    UrdfLink link;
    link.name = name(&element, "name", "link");
    const std::string key = "link " + link.name;
    check_shapes(element, key);
    const TiXmlElement* inertial = element.FirstChildElement("inertial");
    if (inertial == nullptr) return link;
    link.mass_kg = number(inertial->FirstChildElement("mass"), "value", nullptr, key, kMass);
    if (link.mass_kg < 0.0) refuse(path_, key, shown(link.mass_kg), "expected a mass of 0 kg or more");
    const TiXmlElement* tensor = inertial->FirstChildElement("inertia");
    const TiXmlElement* origin = inertial->FirstChildElement("origin");
    constexpr std::array<const char*, 6> kMoments = {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"};
    std::array<double, 6> i{};
    for (std::size_t m = 0; m < i.size(); ++m) i[m] = number(tensor, kMoments[m], "0", key, kAny);
    link.com_m = vector(origin, "xyz", "0 0 0", key, kLength);
    link.inertia_rpy_rad = vector(origin, "rpy", "0 0 0", key, kAngle);
    link.inertia_kg_m2 << i[0], i[1], i[2], i[1], i[3], i[4], i[2], i[4], i[5];
    if (link.mass_kg > 0.0) check_inertia(link.inertia_kg_m2, link.mass_kg, key);
    return link;
  }

  UrdfJoint joint(const TiXmlElement& element) const {
    UrdfJoint joint;
    joint.name = name(&element, "name", "joint");
    const std::string key = "joint " + joint.name;
    joint.kind = name(&element, "type", key);
    if (joint.kind != "revolute" && joint.kind != "prismatic" && joint.kind != "continuous" && joint.kind != "fixed")
      refuse(path_, key, joint.kind, "expected revolute, prismatic, continuous or fixed");
    if (element.FirstChildElement("mimic") != nullptr)
      refuse(path_, key, "mimic", "expected a joint with a motor of its own");
    read_limits(element.FirstChildElement("limit"), key, joint);
    if (joint.kind != "fixed") joint.axis = axis(element.FirstChildElement("axis"), key);
    const TiXmlElement* origin = element.FirstChildElement("origin");
    joint.parent = name(element.FirstChildElement("parent"), "link", key);
    joint.child = name(element.FirstChildElement("child"), "link", key);
    joint.xyz_m = vector(origin, "xyz", "0 0 0", key, kLength);
    joint.rpy_rad = vector(origin, "rpy", "0 0 0", key, kAngle);
    return joint;
  }

  std::string name(const TiXmlElement* element, const char* attribute, const std::string& key) const {
    const char* text = element == nullptr ? nullptr : element->Attribute(attribute);
    if (text == nullptr || *text == '\0') refuse(path_, key, "", std::string("needs the attribute ") + attribute);
    return text;
  }

 private:
  std::vector<double> numbers(const TiXmlElement* element, const char* attribute, std::size_t count,
                              const char* otherwise, const std::string& key, const Most& most) const {
    const char* text = element == nullptr ? nullptr : element->Attribute(attribute);
    if (text == nullptr) text = otherwise;
    if (text == nullptr) refuse(path_, key, "", std::string("needs the attribute ") + attribute);
    const std::string value = std::string(attribute) + "=\"" + text + "\"";
    std::vector<double> values = decimals(text);
    if (values.size() != count || !std::ranges::all_of(values, [](double v) { return std::isfinite(v); }))
      refuse(path_, key, value, "expected " + std::to_string(count) + " finite number" + (count > 1 ? "s" : ""));
    if (std::ranges::any_of(values, [&](double v) { return std::abs(v) > most.value; }))
      refuse(path_, key, value, "expected at most " + shown(most.value) + " " + most.unit + most.hint);
    return values;
  }

  double number(const TiXmlElement* element, const char* attribute, const char* otherwise, const std::string& key,
                const Most& most) const {
    return numbers(element, attribute, 1, otherwise, key, most)[0];
  }

  Vector3 vector(const TiXmlElement* element, const char* attribute, const char* otherwise, const std::string& key,
                 const Most& most) const {
    const std::vector<double> v = numbers(element, attribute, 3, otherwise, key, most);
    return {v[0], v[1], v[2]};
  }

  Vector3 axis(const TiXmlElement* element, const std::string& key) const {
    const Vector3 axis = vector(element, "xyz", "1 0 0", key, kAny);
    const double length = axis.stableNorm();
    if (length < bounds::kAlike || length > 1.0 / bounds::kAlike)
      refuse(path_, key, "axis " + shown(axis), "expected a direction");
    return axis / length;
  }

  /// What collides: every <collision>, or every <visual> where there is none.
  void check_shapes(const TiXmlElement& link, const std::string& key) const {
    const char* kind = link.FirstChildElement("collision") != nullptr ? "collision" : "visual";
    for (const auto* shape = link.FirstChildElement(kind); shape != nullptr; shape = shape->NextSiblingElement(kind)) {
      const TiXmlElement* geometry = shape->FirstChildElement("geometry");
      const TiXmlElement* solid = geometry == nullptr ? nullptr : geometry->FirstChildElement();
      const auto* known = kShapes.end();
      if (solid != nullptr) known = std::ranges::find(kShapes, std::string_view(solid->Value()), &Shape::tag);
      if (known == kShapes.end()) {
        const char* file = solid == nullptr ? nullptr : solid->Attribute("filename");
        const std::string found =
            solid == nullptr ? "" : "<" + solid->ValueStr() + ">" + (file == nullptr ? "" : std::string(" ") + file);
        refuse(path_, key, found,
               "expected box, sphere, cylinder, capsule: what collides is a link's <collision>, its <visual> if it has "
               "none");
      }
      for (const auto& [attribute, count] : known->sizes) {
        const std::vector<double> values = numbers(solid, attribute, count, nullptr, key, kLength);
        if (std::ranges::any_of(values, [](double v) { return v <= 0.0; }))
          refuse(path_, key, std::string(attribute) + "=\"" + solid->Attribute(attribute) + "\"",
                 "expected lengths above 0");
      }
    }
  }

  /// Of a body that can exist, of sizes that a robot's links have.
  void check_inertia(const Matrix3& inertia, double mass, const std::string& key) const {
    const Vector3 p = Eigen::SelfAdjointEigenSolver<Matrix3>(inertia, Eigen::EigenvaluesOnly).eigenvalues();
    const std::string value = "principal moments of inertia " + shown(p[0], "%.3g") + ", " + shown(p[1], "%.3g") +
                              ", " + shown(p[2], "%.3g") + " kg m2";
    const double most = mass * bounds::kMaxGyrationM * bounds::kMaxGyrationM;
    if (!(p[0] >= mass * bounds::kMinGyrationM * bounds::kMinGyrationM))
      refuse(path_, key, value, "expected all of them above 0");
    if (p[0] + p[1] <= p[2] * (1.0 + bounds::kAlike))
      refuse(path_, key, value, "expected each below the sum of the two others");
    if (p[2] > most * (1.0 + bounds::kAlike))
      refuse(path_, key, value,
             "expected at most " + shown(most, "%.3g") + " for " + shown(mass) + " kg: are these kg mm2?");
  }

  void read_limits(const TiXmlElement* limit, const std::string& key, UrdfJoint& joint) const {
    if (joint.kind == "continuous" || joint.kind == "fixed") return;
    if (limit == nullptr) refuse(path_, key, "", "needs a limit");
    const bool turns = joint.kind == "revolute";
    joint.lower = number(limit, "lower", "0", key, turns ? kAngle : kLength);
    joint.upper = number(limit, "upper", "0", key, turns ? kAngle : kLength);
    joint.velocity = number(limit, "velocity", nullptr, key, {bounds::kMaxSpeed, turns ? "rad/s" : "m/s", ""});
    joint.effort = number(limit, "effort", nullptr, key, {bounds::kMaxEffort, turns ? "Nm" : "N", ""});
    if (!(joint.lower < joint.upper))
      refuse(path_, key, shown(joint.lower) + ".." + shown(joint.upper), "expected lower below upper");
    if (!(joint.velocity > 0.0) || !(joint.effort > 0.0))
      refuse(path_, key, "velocity " + shown(joint.velocity) + ", effort " + shown(joint.effort),
             "expected positive limits");
  }

  std::string path_;
};

template <class Named>
const Named* named(const std::vector<Named>& all, const std::string& name) {
  const auto found = std::ranges::find(all, name, &Named::name);
  return found == all.end() ? nullptr : &*found;
}

template <class Named>
void check_once(const std::vector<Named>& all, const std::string& kind, const std::string& path) {
  for (const Named& one : all)
    if (const Named* first = named(all, one.name); first < &one)
      refuse(path, kind + " " + one.name, "", "expected once");
}

}  // namespace

const UrdfLink* Urdf::link(const std::string& name) const { return named(links, name); }

const UrdfJoint* Urdf::joint(const std::string& name) const { return named(joints, name); }

const UrdfJoint* Urdf::joint_above(const std::string& link) const {
  const auto found = std::ranges::find(joints, link, &UrdfJoint::child);
  return found == joints.end() ? nullptr : &*found;
}

std::string shown(const Vector3& vector) {
  return shown(vector.x()) + " " + shown(vector.y()) + " " + shown(vector.z());
}

Urdf parse_urdf(const std::string& xml, const std::string& path) {
  if (xml.find("<!DOCTYPE") != std::string::npos || xml.find("<!ENTITY") != std::string::npos)
    refuse(path, "", "", "document types and entities are not allowed");
  TiXmlDocument document;
  document.Parse(xml.c_str(), nullptr, TIXML_ENCODING_UTF8);
  const TiXmlElement* root = document.RootElement();
  if (document.Error() || root == nullptr) refuse(path, "", "", std::string("is not XML: ") + document.ErrorDesc());
  if (root->ValueStr() != "robot") refuse(path, "", "<" + root->ValueStr() + ">", "expected a <robot>");
  const Reader reader(path);
  Urdf urdf;
  for (const auto* e = root->FirstChildElement("link"); e != nullptr; e = e->NextSiblingElement("link"))
    urdf.links.push_back(reader.link(*e));
  for (const auto* e = root->FirstChildElement("joint"); e != nullptr; e = e->NextSiblingElement("joint"))
    urdf.joints.push_back(reader.joint(*e));
  check_once(urdf.links, "link", path);
  check_once(urdf.joints, "joint", path);
  for (const UrdfJoint& joint : urdf.joints)
    for (const std::string& link : {joint.parent, joint.child})
      if (urdf.link(link) == nullptr) refuse(path, "joint " + joint.name, link, "no such link");
  reader.name(root, "name", "robot");
  return urdf;
}

}  // namespace crux
