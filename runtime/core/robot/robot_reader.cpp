#include "core/robot/robot_reader.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "core/robot/description_problem.hpp"
#include "core/robot/hash.hpp"
#include "core/robot/joint_loops.hpp"
#include "core/robot/motor_checks.hpp"
#include "core/robot/reason.hpp"
#include "core/robot/robot_meaning.hpp"
#include "core/robot/robot_rules.hpp"
#include "core/robot/robot_urdf.hpp"
#include "core/robot/robot_yaml.hpp"
#include "core/robot/still_turns.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {
namespace {

std::string read_file(const std::string& path) {
  std::error_code unknown;
  if (!std::filesystem::is_regular_file(path, unknown))
    refuse(path, "", "",
           std::filesystem::is_directory(path, unknown) ? "is a folder, not a file"
           : std::filesystem::exists(path, unknown)     ? "is not a file"
                                                        : "no such file");
  if (const auto size = std::filesystem::file_size(path, unknown); size > crux_msgs::robot::kMaxBytes)
    refuse(path, "", std::to_string(size) + " bytes",
           "expected at most " + std::to_string(crux_msgs::robot::kMaxBytes) + " bytes");
  std::ifstream stream(path, std::ios::binary);
  if (!stream) refuse(path, "", "", "cannot be read");
  std::ostringstream bytes;
  bytes << stream.rdbuf();
  return bytes.str();
}

KDL::Vector kdl(const Vector3& v) { return {v.x(), v.y(), v.z()}; }

Vector3 vector(const KDL::Vector& v) { return {v.x(), v.y(), v.z()}; }

/// By way of a quaternion, as urdfdom has it: the same bits as in logs made with it.
KDL::Frame frame(const Vector3& xyz_m, const Vector3& rpy_rad) {
  const Vector3 c = (rpy_rad / 2.0).array().cos(), s = (rpy_rad / 2.0).array().sin();
  Eigen::Vector4d q(s.x() * c.y() * c.z() - c.x() * s.y() * s.z(), c.x() * s.y() * c.z() + s.x() * c.y() * s.z(),
                    c.x() * c.y() * s.z() - s.x() * s.y() * c.z(), c.x() * c.y() * c.z() + s.x() * s.y() * s.z());
  q /= std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  return {KDL::Rotation::Quaternion(q[0], q[1], q[2], q[3]), kdl(xyz_m)};
}

KDL::Frame frame(const UrdfJoint& joint) { return frame(joint.xyz_m, joint.rpy_rad); }

/// In the link's own frame.
KDL::RigidBodyInertia inertia_of(const UrdfLink& link) {
  const Matrix3& i = link.inertia_kg_m2;
  const KDL::RotationalInertia about_com(i(0, 0), i(1, 1), i(2, 2), i(0, 1), i(0, 2), i(1, 2));
  return frame(link.com_m, link.inertia_rpy_rad) * KDL::RigidBodyInertia(link.mass_kg, KDL::Vector::Zero(), about_com);
}

KDL::Segment segment(const UrdfJoint& joint, const KDL::RigidBodyInertia& inertia) {
  const KDL::Frame tip = frame(joint);
  if (joint.kind == "fixed") return KDL::Segment(joint.name, KDL::Joint(joint.name, KDL::Joint::None), tip, inertia);
  return KDL::Segment(joint.name, KDL::Joint(joint.name, tip.p, tip.M * kdl(joint.axis), KDL::Joint::RotAxis), tip,
                      inertia);
}

void read_limb(const Urdf& urdf, const LimbChain& chain, LimbDescription& limb) {
  KDL::RigidBodyInertia hand = inertia_of(*urdf.link(chain.joints.back()->child));
  // At zero opening: fingers move apart symmetrically, so that their common centre of mass stays where it is.
  for (const UrdfJoint* finger : chain.fingers) hand = hand + frame(*finger) * inertia_of(*urdf.link(finger->child));
  limb.hand_mass_kg = hand.getMass();
  limb.hand_com_G_m = vector(hand.getCOG());
  std::size_t moving = 0;
  for (const UrdfJoint* joint : chain.joints) {
    if (joint->kind != "fixed") limb.own[moving++] = {joint->lower, joint->upper, joint->velocity, joint->effort};
    const bool last = joint == chain.joints.back();
    limb.chain.addSegment(segment(*joint, last ? hand : inertia_of(*urdf.link(joint->child))));
  }
  limb.driven = static_cast<int>(moving);
}

/// Middles of the ranges of joint number `first` and the next.
FiveBar::Pair middles_rad(const LimbDescription& limb, int first) {
  const auto middle = [&](int j) { return (limb.own[j].lower_rad + limb.own[j].upper_rad) / 2.0; };
  return {middle(first), middle(first + 1)};
}

/// None where the robot has none.
std::optional<FiveBar> five_bar_of(const crux_msgs::robot::FiveBar& section, const std::string& path,
                                   const LimbDescription& limb) {
  const double number = section.first_joint;
  if (number == 0.0) return std::nullopt;
  if (number != std::floor(number) || number + 1 > limb.driven)
    refuse(path, "five_bar.first_joint", shown(number),
           "expected the number of a joint with another behind it, of " + std::to_string(limb.driven));
  const int first = static_cast<int>(number) - 1;
  const std::optional<ParallelJoints> joints = parallel_joints(limb.chain, first);
  if (!joints)
    refuse(path, "five_bar.first_joint", shown(number),
           "of limb " + limb.name + ", expected joints about parallel axes apart from each other");
  const FiveBar five_bar(section, joints->apart_m, joints->sense, middles_rad(limb, first));
  if (std::abs(section.bends) != 1.0) refuse(path, "five_bar.bends", shown(section.bends), "expected 1 or -1");
  return five_bar;
}

/// Narrows the joints' limits by the actuators'.
void add_transmission(const crux_msgs::robot::Sections& sections, const std::string& path, LimbDescription& limb) {
  const crux_msgs::robot::Transmissions& section = sections.transmissions;
  static_cast<void>(Transmission(section, limb.driven, path));  // what is wrong with it comes first
  const std::optional<FiveBar> five_bar = five_bar_of(sections.five_bar, path, limb);
  limb.transmission = Transmission(section, limb.driven, path, five_bar);
  if (five_bar && !five_bar->closes_in_the_middle()) {
    const double sine = five_bar->sine(middles_rad(limb, five_bar->first()));
    refuse(path, "five_bar.least_sine",
           sine > -1.0 ? shown(std::max(sine, 0.0), "%.2f") : "no angle: the rod does not reach",
           "in the middle of the ranges of limb " + limb.name + ", expected at least " +
               shown(sections.five_bar.least_sine) + ": other limits or lengths");
  }
  limb.joints = limb.transmission.within(limb.own, own_limits(section));
  for (int j = 0; j < limb.driven; ++j)
    if (limb.own[j].lower_rad < limb.own[j].upper_rad && !(limb.joints[j].lower_rad < limb.joints[j].upper_rad))
      refuse(path, "transmissions.low_rad", "",
             "expected limits of actuators between which joint " + std::to_string(j + 1) + " of limb " + limb.name +
                 " can turn");
  if (five_bar) limb.crank = limb.transmission.crank_limits(own_limits(section));
}

/// Fills the sections of a description from a checked file.
class ReadValue {
 public:
  explicit ReadValue(const YamlSection& file) : file_(file) {}

  template <class Value>
  void operator()(const char* section, const char* key, Value& value) const {
    if (file_.has(section, key)) read(section, key, value);  // else it keeps its default
  }

 private:
  void read(const char* section, const char* key, double& value) const { value = file_.section(section).number(key); }
  void read(const char* section, const char* key, int& value) const { value = file_.section(section).integer(key); }
  /// A slot without a joint has what the last joint has.
  void read(const char* section, const char* key, std::array<double, kJoints>& values) const {
    const std::vector<double> given = file_.section(section).numbers(key);
    for (std::size_t j = 0; j < values.size(); ++j) values[j] = given[std::min(j, given.size() - 1)];
  }
  void read(const char* section, const char* key, crux_msgs::robot::Interval& value) const {
    const std::vector<double> ends = file_.section(section).numbers(key);
    value = {ends[0], ends[1]};
  }
  void read(const char* section, const char* key, crux_msgs::robot::Nodes& value) const {
    const YamlSection nodes = file_.section(section).section(key);
    const std::vector<std::string> joints = file_.section("limb").texts("joints");
    for (std::size_t j = 0; j < value.joints.size(); ++j)
      value.joints[j] = nodes.integer(joints[std::min(j, joints.size() - 1)]);
    value.gripper = nodes.integer("gripper");
  }

  const YamlSection& file_;
};

/// A name of section limb for the limb with this prefix, which stands for {}; without {} it is PREFIX_name.
std::string full_name(const std::string& name, const std::string& prefix) {
  std::size_t at = name.find("{}");
  if (at == std::string::npos) return prefix + "_" + name;
  std::string full = name;
  for (; at != std::string::npos; at = full.find("{}", at + prefix.size())) full.replace(at, 2, prefix);
  return full;
}

LimbNames limb_names(const YamlSection& limb, const std::string& prefix) {
  const std::vector<std::string> fingers = limb.texts("finger_joints");
  LimbNames names{limb.texts("joints"), full_name(limb.text("gripper_frame"), prefix), {fingers[0], fingers[1]}};
  for (std::string& joint : names.joints) joint = full_name(joint, prefix);
  for (std::string& joint : names.finger_joints) joint = full_name(joint, prefix);
  return names;
}

double checked_joint_loops(const RobotDescription& robot, const std::string& path) {
  const auto each = [](const std::array<double, kJoints>& values) { return JointVector(values.data()); };
  const ServoDescription& servo = robot.servo;
  const JointLoops loops = {.position_gain_Nm_rad = each(servo.position_gain_Nm_rad),
                            .velocity_gain_Nms_rad = each(servo.velocity_gain_Nms_rad),
                            .damping_Nms_rad = each(servo.damping_Nms_rad),
                            .lag_s = servo.torque_time_constant_s};
  double least_s = std::numeric_limits<double>::infinity();
  for (const LimbDescription& limb : robot.limbs)
    least_s =
        std::min(least_s, checked_delay_margin_s(limb, loops, each(servo.armature_kg_m2), servo.dead_time_s, path));
  return least_s;
}

RobotDescription read_robot(const std::string& yaml_path) {
  const std::string yaml_bytes = read_file(yaml_path);
  const YamlSection file = checked_robot_yaml(yaml_bytes, yaml_path);
  const std::string urdf_path = (std::filesystem::path(yaml_path).parent_path() / file.text("urdf")).string();
  const std::string urdf_bytes = read_file(urdf_path);
  const Urdf urdf = parse_urdf(urdf_bytes, urdf_path);

  RobotDescription robot;
  robot.name = file.text("name");
  robot.sha256 = sha256_hex(robot_meaning(file.node(), urdf_bytes));
  robot.files = {{{"robot.yaml", yaml_bytes}, {file.text("urdf"), urdf_bytes}}};
  crux_msgs::robot::each_value(robot, ReadValue(file));
  PerLimb<LimbNames> names;
  for (int l = 0; l < kLimbs; ++l) {
    const YamlSection one = file.section("limbs").section(kLimbNames[l]);
    robot.limbs[l].name = kLimbNames[l];
    robot.limbs[l].bus = one.integer("bus");
    names[l] = limb_names(file.section("limb"), one.text("prefix"));
  }
  const std::string body_link = file.text("body_link");
  const PerLimb<LimbChain> chains =
      checked_limbs(urdf, urdf_path, body_link, names, {robot.gripper.opening_m.low, robot.gripper.opening_m.high});
  double fastest_rad_s = 0.0;
  for (int l = 0; l < kLimbs; ++l) {
    LimbDescription& limb = robot.limbs[l];
    read_limb(urdf, chains[l], limb);
    add_transmission(robot, yaml_path, limb);
    if (!add_still_turns(limb))
      refuse(urdf_path, "limb " + limb.name, "",
             "expected joints that move the gripper in all three directions from the middle of their ranges");
    // Slots that nothing fills are their own.
    limb.actuators = limb.transmission.reached(limb.joints, limb.own, own_limits(robot.transmissions));
    for (int j = 0; j < limb.driven; ++j) fastest_rad_s = std::max(fastest_rad_s, limb.actuators[j].velocity_rad_s);
  }
  const KDL::RigidBodyInertia body = inertia_of(*urdf.link(body_link));
  robot.body_mass_kg = body.getMass();
  robot.body_com_B_m = vector(body.getCOG());
  std::map<std::string, double> masses;  // summed by name, as in logs before
  for (const UrdfLink& link : urdf.links) masses[link.name] = link.mass_kg;
  for (const auto& [link, mass_kg] : masses) robot.total_mass_kg += mass_kg;
  check_motors(robot, yaml_path, fastest_rad_s);
  check_gains(robot, yaml_path);
  robot.delay_margin_s = checked_joint_loops(robot, yaml_path);
  return robot;
}

}  // namespace

Result<RobotDescription> load_robot(const std::string& yaml_path) {
  try {
    return read_robot(yaml_path);
  } catch (const std::runtime_error& error) {
    return Refusal{error.what()};
  }
}

}  // namespace crux
