#include "core/robot_description.hpp"

#include <urdf_model/model.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "core/hash.hpp"
#include "core/robot_meaning.hpp"
#include "core/stability.hpp"
#include "core/yaml_reader.hpp"

namespace crux {
namespace {

constexpr int kFormatVersion = 1;
constexpr std::array<const char*, kLimbs> kLimbNames = {"LF", "RF", "LR", "RR"};

std::string read_file(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw std::runtime_error(path + ": cannot be read");
  std::ostringstream bytes;
  bytes << stream.rdbuf();
  return bytes.str();
}

/// Body, limbs and masses from the URDF.
class UrdfReader {
 public:
  UrdfReader(const std::string& path, const std::string& xml) : path_(path), model_(urdf::parseURDF(xml)) {
    if (!model_) throw std::runtime_error(path_ + ": is not a valid URDF");
  }

  void read_body(const std::string& link_name, RobotDescription& robot) const {
    const KDL::RigidBodyInertia body = inertia_of(link_name);
    robot.body_mass_kg = body.getMass();
    robot.body_com_B_m = vector(body.getCOG());
    for (const auto& [name, link] : model_->links_) robot.total_mass_kg += link->inertial ? link->inertial->mass : 0.0;
  }

  void read_limb(const std::string& body_link, const std::string& prefix,
                 const std::array<std::string, kJoints>& joints, const std::string& gripper_frame,
                 const std::array<std::string, 2>& finger_joints, LimbDescription& limb) const {
    const std::string gripper_link = prefix + gripper_frame;
    const KDL::RigidBodyInertia hand = inertia_of(gripper_link) + finger_inertia(prefix + finger_joints[0]) +
                                       finger_inertia(prefix + finger_joints[1]);
    limb.hand_mass_kg = hand.getMass();
    limb.hand_com_G_m = vector(hand.getCOG());

    int moving = 0;
    for (const urdf::JointConstSharedPtr& link_joint : path_to(body_link, gripper_link)) {
      const bool fixed = link_joint->type == urdf::Joint::FIXED;
      if (!fixed) {
        if (moving == kJoints || link_joint->name != prefix + joints[moving]) {
          throw std::runtime_error(path_ + ": the way from '" + body_link + "' to '" + gripper_link +
                                   "' passes joint '" + link_joint->name +
                                   "', which robot.yaml does not name at that place");
        }
        limb.joints[moving++] = limits_of(*link_joint);
      }
      const std::string& child = link_joint->child_link_name;
      limb.chain.addSegment(segment(*link_joint, child == gripper_link ? hand : inertia_of(child)));
    }
    if (moving != kJoints) {
      throw std::runtime_error(path_ + ": the way to '" + gripper_link + "' has " + std::to_string(moving) +
                               " moving joints, expected " + std::to_string(kJoints));
    }
  }

 private:
  static Vector3 vector(const KDL::Vector& v) { return {v.x(), v.y(), v.z()}; }

  static KDL::Frame frame(const urdf::Pose& pose) {
    const urdf::Rotation& r = pose.rotation;
    return {KDL::Rotation::Quaternion(r.x, r.y, r.z, r.w), {pose.position.x, pose.position.y, pose.position.z}};
  }

  static KDL::Segment segment(const urdf::Joint& joint, const KDL::RigidBodyInertia& inertia) {
    const KDL::Frame tip = frame(joint.parent_to_joint_origin_transform);
    if (joint.type == urdf::Joint::FIXED) {
      return KDL::Segment(joint.name, KDL::Joint(joint.name, KDL::Joint::None), tip, inertia);
    }
    const KDL::Vector axis = tip.M * KDL::Vector(joint.axis.x, joint.axis.y, joint.axis.z);
    return KDL::Segment(joint.name, KDL::Joint(joint.name, tip.p, axis, KDL::Joint::RotAxis), tip, inertia);
  }

  /// Joints from `base` outwards to `tip`.
  std::vector<urdf::JointConstSharedPtr> path_to(const std::string& base, const std::string& tip) const {
    std::vector<urdf::JointConstSharedPtr> path;
    for (urdf::LinkConstSharedPtr link = link_named(tip); link->name != base;
         link = link_named(path.back()->parent_link_name)) {
      if (!link->parent_joint)
        throw std::runtime_error(path_ + ": no way from link '" + base + "' to link '" + tip + "'");
      path.push_back(link->parent_joint);
    }
    std::reverse(path.begin(), path.end());
    return path;
  }

  urdf::LinkConstSharedPtr link_named(const std::string& name) const {
    urdf::LinkConstSharedPtr link = model_->getLink(name);
    if (!link) throw std::runtime_error(path_ + ": has no link '" + name + "'");
    return link;
  }

  /// In the link's own frame.
  KDL::RigidBodyInertia inertia_of(const std::string& link_name) const {
    const urdf::LinkConstSharedPtr link = link_named(link_name);
    if (!link->inertial) throw std::runtime_error(path_ + ": link '" + link_name + "' has no inertial");
    const urdf::Inertial& i = *link->inertial;
    const KDL::RotationalInertia about_com(i.ixx, i.iyy, i.izz, i.ixy, i.ixz, i.iyz);
    return frame(i.origin) * KDL::RigidBodyInertia(i.mass, KDL::Vector::Zero(), about_com);
  }

  /// Of a finger in the gripper frame, at zero opening: fingers move apart symmetrically, so that their common centre
  /// of mass stays where it is.
  KDL::RigidBodyInertia finger_inertia(const std::string& joint_name) const {
    const urdf::JointConstSharedPtr slide = model_->getJoint(joint_name);
    if (!slide) throw std::runtime_error(path_ + ": has no joint '" + joint_name + "'");
    return frame(slide->parent_to_joint_origin_transform) * inertia_of(slide->child_link_name);
  }

  JointLimits limits_of(const urdf::Joint& joint) const {
    if (!joint.limits) throw std::runtime_error(path_ + ": joint '" + joint.name + "' has no limit");
    const urdf::JointLimits& l = *joint.limits;
    if (!(l.lower < l.upper) || !(l.velocity > 0.0) || !(l.effort > 0.0)) {
      throw std::runtime_error(path_ + ": limits of joint '" + joint.name +
                               "' must have lower < upper, velocity > 0 and effort > 0");
    }
    return {l.lower, l.upper, l.velocity, l.effort};
  }

  std::string path_;
  urdf::ModelInterfaceSharedPtr model_;
};

void read_parameters(const YamlReader& file, RobotDescription& robot) {
  const YamlReader can = file.section("can");
  robot.can.rate_Hz = can.positive("rate_Hz");
  robot.can.watchdog_cycles = can.integer("watchdog_cycles");
  const std::array<std::string, kJoints> joints = file.section("limb").texts<kJoints>("joints");
  const YamlReader nodes = can.section("nodes");
  for (int j = 0; j < kJoints; ++j) robot.can.joint_nodes[j] = nodes.integer(joints[j]);
  robot.can.gripper_node = nodes.integer("gripper");

  const YamlReader servo = file.section("servo");
  robot.servo.position_gain_Nm_rad = servo.numbers<kJoints>("position_gain_Nm_rad");
  robot.servo.velocity_gain_Nms_rad = servo.numbers<kJoints>("velocity_gain_Nms_rad");
  robot.servo.damping_Nms_rad = servo.numbers<kJoints>("damping_Nms_rad");
  robot.servo.setpoint_time_constant_s = servo.not_negative("setpoint_time_constant_s");

  const YamlReader gripper = file.section("gripper");
  const auto opening = gripper.numbers<2>("opening_m");
  robot.gripper = {.min_opening_m = opening[0],
                   .max_opening_m = opening[1],
                   .max_finger_force_N = gripper.positive("max_finger_force_N"),
                   .max_finger_speed_m_s = gripper.positive("max_finger_speed_m_s"),
                   .stiffness_N_m = gripper.positive("stiffness_N_m"),
                   .damping_Ns_m = gripper.not_negative("damping_Ns_m"),
                   .pad_radius_m = gripper.positive("pad_radius_m")};

  const YamlReader ft = file.section("force_torque");
  robot.force_torque = {.range_N = ft.positive("range_N"), .range_Nm = ft.positive("range_Nm")};

  const YamlReader a = file.section("admittance");
  robot.admittance = {.mass_kg = a.positive("mass_kg"),
                      .damping_Ns_m = a.positive("damping_Ns_m"),
                      .stiffness_N_m = a.not_negative("stiffness_N_m"),
                      .inertia_kg_m2 = a.positive("inertia_kg_m2"),
                      .rotational_damping_Nms_rad = a.positive("rotational_damping_Nms_rad"),
                      .rotational_stiffness_Nm_rad = a.not_negative("rotational_stiffness_Nm_rad"),
                      .max_speed_m_s = a.positive("max_speed_m_s"),
                      .max_rate_rad_s = a.positive("max_rate_rad_s"),
                      .max_offset_m = a.positive("max_offset_m"),
                      .max_rotation_rad = a.positive("max_rotation_rad"),
                      .environment_N_m = a.positive("environment_N_m"),
                      .environment_Nm_rad = a.positive("environment_Nm_rad"),
                      .delay_s = a.positive("delay_s")};

  const YamlReader k = file.section("calibration");
  robot.calibration = {.window_s = k.positive("window_s"),
                       .tolerated_N = k.positive("tolerated_N"),
                       .tolerated_Nm = k.positive("tolerated_Nm"),
                       .max_change = k.positive("max_change")};

  const YamlReader c = file.section("control");
  robot.control = {.force_filter_s = c.positive("force_filter_s"),
                   .tare_time_constant_s = c.positive("tare_time_constant_s"),
                   .contact_force_N = c.positive("contact_force_N"),
                   .unload_force_N = c.positive("unload_force_N"),
                   .grasp_force_factor = c.positive("grasp_force_factor"),
                   .grasp_force_reserve_N = c.not_negative("grasp_force_reserve_N"),
                   .trusted_friction = c.positive("trusted_friction"),
                   .min_grasp_force_N = c.positive("min_grasp_force_N"),
                   .grasp_damping_Ns_m = c.positive("grasp_damping_Ns_m"),
                   .grasp_force_time_constant_s = c.positive("grasp_force_time_constant_s"),
                   .grasp_force_lead_s = c.not_negative("grasp_force_lead_s"),
                   .closing_speed_m_s = c.positive("closing_speed_m_s"),
                   .body_gain_1_s = c.not_negative("body_gain_1_s"),
                   .max_body_correction_m = c.positive("max_body_correction_m"),
                   .max_body_rotation_rad = c.positive("max_body_rotation_rad"),
                   .twist_length_m = c.positive("twist_length_m"),
                   .moment_length_m = c.positive("moment_length_m"),
                   .swing_decay_s = c.positive("swing_decay_s"),
                   .engage_time_s = c.positive("engage_time_s"),
                   .max_contact_offset_m = c.positive("max_contact_offset_m")};

  const YamlReader m = file.section("localisation");
  robot.localisation = {.hold_sigma_m = m.positive("hold_sigma_m"),
                        .grasp_sigma_m = m.not_negative("grasp_sigma_m"),
                        .grasp_sigma_rad = m.not_negative("grasp_sigma_rad"),
                        .tilt_sigma_rad = m.positive("tilt_sigma_rad")};

  const YamlReader f = file.section("stance");
  robot.stance = {.shift_sigma_m = f.positive("shift_sigma_m"),
                  .turn_sigma_rad = f.positive("turn_sigma_rad"),
                  .idle_torque_Nm = f.not_negative("idle_torque_Nm"),
                  .most_play_rad = f.not_negative("most_play_rad"),
                  .play_memory_s = f.positive("play_memory_s"),
                  .slip_m = f.positive("slip_m"),
                  .max_slip_m = f.positive("max_slip_m"),
                  .still_time_s = f.positive("still_time_s"),
                  .relief_load = f.not_negative("relief_load"),
                  .max_misfit_m = f.positive("max_misfit_m"),
                  .balance_memory_s = f.positive("balance_memory_s"),
                  .max_unbalanced_N = f.positive("max_unbalanced_N"),
                  .unbalanced_time_s = f.positive("unbalanced_time_s")};

  const YamlReader s = file.section("supervisor");
  robot.supervisor = {.start_tolerance_m = s.positive("start_tolerance_m"),
                      .start_tolerance_rad = s.positive("start_tolerance_rad"),
                      .settle_time_s = s.positive("settle_time_s"),
                      .event_timeout_s = s.positive("event_timeout_s"),
                      .arrive_tolerance_m = s.positive("arrive_tolerance_m"),
                      .open_tolerance_m = s.positive("open_tolerance_m"),
                      .silent_cycles = s.integer("silent_cycles"),
                      .max_body_error_m = s.positive("max_body_error_m"),
                      .max_tracking_error_rad = s.positive("max_tracking_error_rad"),
                      .min_stance_force_N = s.positive("min_stance_force_N"),
                      .max_ik_error_m = s.positive("max_ik_error_m"),
                      .encoder_standstill_rad = s.positive("encoder_standstill_rad"),
                      .max_ft_residual_Nm = s.positive("max_ft_residual_Nm"),
                      .max_ft_residual_share = s.positive("max_ft_residual_share"),
                      .max_finger_residual_N = s.positive("max_finger_residual_N"),
                      .max_late_s = s.positive("max_late_s"),
                      .persistence_s = s.positive("persistence_s")};
}

void check_damping(const YamlReader& admittance, const std::string& key, double damping, double least,
                   const std::string& environment, double delay_s) {
  if (damping >= least) return;
  std::ostringstream reason;
  reason << admittance.at(key) << " is " << damping << "; against " << kGainMargin << " times " << environment
         << ", felt " << delay_s << " s late, it is stable from " << std::setprecision(4) << least << " on";
  throw std::runtime_error(reason.str());
}

void check_stability(const YamlReader& admittance, const RobotDescription& robot) {
  const AdmittanceParameters& a = robot.admittance;
  const double most_s = kMostDelay_cycles / robot.can.rate_Hz;
  if (a.delay_s > most_s)
    throw std::runtime_error(admittance.at("delay_s") + " is " + std::to_string(a.delay_s) + "; it must be at most " +
                             std::to_string(most_s));
  check_damping(admittance, "damping_Ns_m", a.damping_Ns_m,
                least_damping(a.mass_kg, a.stiffness_N_m, a.environment_N_m, a.delay_s), "environment_N_m", a.delay_s);
  check_damping(admittance, "rotational_damping_Nms_rad", a.rotational_damping_Nms_rad,
                least_damping(a.inertia_kg_m2, a.rotational_stiffness_Nm_rad, a.environment_Nm_rad, a.delay_s),
                "environment_Nm_rad", a.delay_s);
}

RobotDescription read_robot(const std::string& yaml_path) {
  const std::string yaml_bytes = read_file(yaml_path);
  YAML::Node root;
  try {
    root = YAML::Load(yaml_bytes);
  } catch (const YAML::Exception& error) {
    throw std::runtime_error(yaml_path + ": is not valid YAML: " + error.what());
  }
  const YamlReader file(root, yaml_path);
  if (const int version = file.integer("version"); version != kFormatVersion) {
    throw std::runtime_error(yaml_path + ": version is " + std::to_string(version) + "; this program reads version " +
                             std::to_string(kFormatVersion));
  }
  const std::string urdf_path = (std::filesystem::path(yaml_path).parent_path() / file.text("urdf")).string();
  const std::string urdf_bytes = read_file(urdf_path);

  RobotDescription robot;
  robot.name = file.text("name");
  read_parameters(file, robot);
  check_stability(file.section("admittance"), robot);

  const UrdfReader urdf(urdf_path, urdf_bytes);
  robot.sha256 = sha256_hex(robot_meaning(root, urdf_bytes));
  robot.files = {{{"robot.yaml", yaml_bytes}, {file.text("urdf"), urdf_bytes}}};
  const std::string body_link = file.text("body_link");
  urdf.read_body(body_link, robot);
  const YamlReader limb = file.section("limb");
  const YamlReader limbs = file.section("limbs");
  for (int l = 0; l < kLimbs; ++l) {
    const YamlReader one = limbs.section(kLimbNames[l]);
    robot.limbs[l].name = kLimbNames[l];
    robot.limbs[l].bus = one.integer("bus");
    urdf.read_limb(body_link, one.text("prefix") + "_", limb.texts<kJoints>("joints"), limb.text("gripper_frame"),
                   limb.texts<2>("finger_joints"), robot.limbs[l]);
  }
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
