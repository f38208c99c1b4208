#include "core/robot_description.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "core/description_problem.hpp"
#include "core/hash.hpp"
#include "core/joint_loops.hpp"
#include "core/motor_checks.hpp"
#include "core/reason.hpp"
#include "core/robot_meaning.hpp"
#include "core/robot_rules.hpp"
#include "core/robot_urdf.hpp"
#include "core/robot_yaml.hpp"
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
  for (int j = 0; j <= kJoints; ++j) {
    const UrdfJoint& joint = *chain.joints[j];
    if (j < kJoints) limb.joints[j] = {joint.lower, joint.upper, joint.velocity, joint.effort};
    limb.chain.addSegment(segment(joint, j == kJoints ? hand : inertia_of(*urdf.link(joint.child))));
  }
}

void read_parameters(const YamlSection& file, RobotDescription& robot) {
  const YamlSection can = file.section("can");
  robot.can.rate_Hz = can.number("rate_Hz");
  robot.can.watchdog_cycles = can.integer("watchdog_cycles");
  const std::array<std::string, kJoints> joints = file.section("limb").texts<kJoints>("joints");
  const YamlSection nodes = can.section("nodes");
  for (int j = 0; j < kJoints; ++j) robot.can.joint_nodes[j] = nodes.integer(joints[j]);
  robot.can.gripper_node = nodes.integer("gripper");

  const YamlSection servo = file.section("servo");
  robot.servo.position_gain_Nm_rad = servo.numbers<kJoints>("position_gain_Nm_rad");
  robot.servo.velocity_gain_Nms_rad = servo.numbers<kJoints>("velocity_gain_Nms_rad");
  robot.servo.damping_Nms_rad = servo.numbers<kJoints>("damping_Nms_rad");
  robot.servo.setpoint_time_constant_s = servo.number("setpoint_time_constant_s");
  robot.servo.torque_time_constant_s = servo.number("torque_time_constant_s");
  robot.servo.dead_time_s = servo.number("dead_time_s");

  const YamlSection gripper = file.section("gripper");
  const auto opening = gripper.numbers<2>("opening_m");
  robot.gripper = {.min_opening_m = opening[0],
                   .max_opening_m = opening[1],
                   .max_finger_force_N = gripper.number("max_finger_force_N"),
                   .max_finger_speed_m_s = gripper.number("max_finger_speed_m_s"),
                   .stiffness_N_m = gripper.number("stiffness_N_m"),
                   .damping_Ns_m = gripper.number("damping_Ns_m"),
                   .pad_radius_m = gripper.number("pad_radius_m")};

  const YamlSection ft = file.section("force_torque");
  robot.force_torque = {.range_N = ft.number("range_N"), .range_Nm = ft.number("range_Nm")};

  const YamlSection a = file.section("admittance");
  robot.admittance = {.mass_kg = a.number("mass_kg"),
                      .damping_Ns_m = a.number("damping_Ns_m"),
                      .stiffness_N_m = a.number("stiffness_N_m"),
                      .inertia_kg_m2 = a.number("inertia_kg_m2"),
                      .rotational_damping_Nms_rad = a.number("rotational_damping_Nms_rad"),
                      .rotational_stiffness_Nm_rad = a.number("rotational_stiffness_Nm_rad"),
                      .max_speed_m_s = a.number("max_speed_m_s"),
                      .max_rate_rad_s = a.number("max_rate_rad_s"),
                      .max_offset_m = a.number("max_offset_m"),
                      .max_rotation_rad = a.number("max_rotation_rad"),
                      .environment_N_m = a.number("environment_N_m"),
                      .environment_Nm_rad = a.number("environment_Nm_rad"),
                      .delay_s = a.number("delay_s")};

  const YamlSection k = file.section("calibration");
  robot.calibration = {.window_s = k.number("window_s"),
                       .tolerated_N = k.number("tolerated_N"),
                       .tolerated_Nm = k.number("tolerated_Nm"),
                       .max_change = k.number("max_change")};

  const YamlSection c = file.section("control");
  robot.control = {.force_filter_s = c.number("force_filter_s"),
                   .tare_time_constant_s = c.number("tare_time_constant_s"),
                   .contact_force_N = c.number("contact_force_N"),
                   .unload_force_N = c.number("unload_force_N"),
                   .grasp_force_factor = c.number("grasp_force_factor"),
                   .grasp_force_reserve_N = c.number("grasp_force_reserve_N"),
                   .trusted_friction = c.number("trusted_friction"),
                   .min_grasp_force_N = c.number("min_grasp_force_N"),
                   .grasp_damping_Ns_m = c.number("grasp_damping_Ns_m"),
                   .grasp_force_time_constant_s = c.number("grasp_force_time_constant_s"),
                   .grasp_force_lead_s = c.number("grasp_force_lead_s"),
                   .closing_speed_m_s = c.number("closing_speed_m_s"),
                   .body_gain_1_s = c.number("body_gain_1_s"),
                   .max_body_correction_m = c.number("max_body_correction_m"),
                   .max_body_rotation_rad = c.number("max_body_rotation_rad"),
                   .twist_length_m = c.number("twist_length_m"),
                   .moment_length_m = c.number("moment_length_m"),
                   .swing_decay_s = c.number("swing_decay_s"),
                   .engage_time_s = c.number("engage_time_s"),
                   .max_contact_offset_m = c.number("max_contact_offset_m")};

  const YamlSection m = file.section("localisation");
  robot.localisation = {.hold_sigma_m = m.number("hold_sigma_m"),
                        .grasp_sigma_m = m.number("grasp_sigma_m"),
                        .grasp_sigma_rad = m.number("grasp_sigma_rad"),
                        .tilt_sigma_rad = m.number("tilt_sigma_rad")};

  const YamlSection f = file.section("stance");
  robot.stance = {.shift_sigma_m = f.number("shift_sigma_m"),
                  .turn_sigma_rad = f.number("turn_sigma_rad"),
                  .idle_torque_Nm = f.number("idle_torque_Nm"),
                  .most_play_rad = f.number("most_play_rad"),
                  .play_memory_s = f.number("play_memory_s"),
                  .slip_m = f.number("slip_m"),
                  .max_slip_m = f.number("max_slip_m"),
                  .still_time_s = f.number("still_time_s"),
                  .relief_load = f.number("relief_load"),
                  .max_misfit_m = f.number("max_misfit_m"),
                  .balance_memory_s = f.number("balance_memory_s"),
                  .max_unbalanced_N = f.number("max_unbalanced_N"),
                  .unbalanced_time_s = f.number("unbalanced_time_s")};

  const YamlSection s = file.section("supervisor");
  robot.supervisor = {.start_tolerance_m = s.number("start_tolerance_m"),
                      .start_tolerance_rad = s.number("start_tolerance_rad"),
                      .settle_time_s = s.number("settle_time_s"),
                      .event_timeout_s = s.number("event_timeout_s"),
                      .arrive_tolerance_m = s.number("arrive_tolerance_m"),
                      .open_tolerance_m = s.number("open_tolerance_m"),
                      .silent_cycles = s.integer("silent_cycles"),
                      .max_body_error_m = s.number("max_body_error_m"),
                      .max_tracking_error_rad = s.number("max_tracking_error_rad"),
                      .min_stance_force_N = s.number("min_stance_force_N"),
                      .max_ik_error_m = s.number("max_ik_error_m"),
                      .oscillation_rad = s.number("oscillation_rad"),
                      .encoder_standstill_rad = s.number("encoder_standstill_rad"),
                      .max_ft_residual_Nm = s.number("max_ft_residual_Nm"),
                      .max_ft_residual_share = s.number("max_ft_residual_share"),
                      .max_finger_residual_N = s.number("max_finger_residual_N"),
                      .max_late_s = s.number("max_late_s"),
                      .persistence_s = s.number("persistence_s")};
}

LimbNames limb_names(const YamlSection& limb, const std::string& prefix) {
  LimbNames names{limb.texts<kJoints>("joints"), prefix + limb.text("gripper_frame"), limb.texts<2>("finger_joints")};
  for (std::string& joint : names.joints) joint.insert(0, prefix);
  for (std::string& joint : names.finger_joints) joint.insert(0, prefix);
  return names;
}

void check_joint_loops(const YamlSection& file, const std::string& path, RobotDescription& robot) {
  const auto each = [](const std::array<double, kJoints>& values) { return JointVector(values.data()); };
  ServoDescription& servo = robot.servo;
  const JointLoops loops = {.position_gain_Nm_rad = each(servo.position_gain_Nm_rad),
                            .velocity_gain_Nms_rad = each(servo.velocity_gain_Nms_rad),
                            .damping_Nms_rad = each(servo.damping_Nms_rad),
                            .lag_s = servo.torque_time_constant_s};
  const JointVector armature_kg_m2 = each(file.section("servo").numbers<kJoints>("armature_kg_m2"));
  servo.delay_margin_s = checked_delay_margin_s(robot.limbs[0], loops, armature_kg_m2, servo.dead_time_s, path);
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
  read_parameters(file, robot);
  PerLimb<LimbNames> names;
  for (int l = 0; l < kLimbs; ++l) {
    const YamlSection one = file.section("limbs").section(kLimbNames[l]);
    robot.limbs[l].name = kLimbNames[l];
    robot.limbs[l].bus = one.integer("bus");
    names[l] = limb_names(file.section("limb"), one.text("prefix") + "_");
  }
  const std::string body_link = file.text("body_link");
  const PerLimb<LimbChain> chains =
      checked_limbs(urdf, urdf_path, body_link, names, {robot.gripper.min_opening_m, robot.gripper.max_opening_m});
  double fastest_rad_s = 0.0;
  for (int l = 0; l < kLimbs; ++l) {
    read_limb(urdf, chains[l], robot.limbs[l]);
    for (const JointLimits& joint : robot.limbs[l].joints)
      fastest_rad_s = std::max(fastest_rad_s, joint.velocity_rad_s);
  }
  const KDL::RigidBodyInertia body = inertia_of(*urdf.link(body_link));
  robot.body_mass_kg = body.getMass();
  robot.body_com_B_m = vector(body.getCOG());
  std::map<std::string, double> masses;  // summed by name, as in logs before
  for (const UrdfLink& link : urdf.links) masses[link.name] = link.mass_kg;
  for (const auto& [link, mass_kg] : masses) robot.total_mass_kg += mass_kg;
  check_motors(file, yaml_path, fastest_rad_s);
  check_gains(file, yaml_path);
  check_joint_loops(file, yaml_path, robot);
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
