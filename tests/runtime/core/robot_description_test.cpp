// Robot descriptions with one thing wrong each.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/robot_meaning.hpp"
#include "fixture.hpp"

namespace crux_test {
namespace {

std::string text_of(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

class RobotFiles : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "crux-robot-XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
    yaml_ = text_of(CRUX_ROBOT);
    urdf_ = text_of(std::filesystem::path(CRUX_ROBOT).parent_path() / "scaler.urdf");
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  static void replace(std::string& text, const std::string& from, const std::string& to) {
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
  }
  Result<RobotDescription> load() const {
    std::ofstream(folder_ / "robot.yaml", std::ios::binary) << yaml_;
    std::ofstream(folder_ / "scaler.urdf", std::ios::binary) << urdf_;
    return load_robot((folder_ / "robot.yaml").string());
  }
  void expect_said(const std::string& part) const {
    const Result<RobotDescription> loaded = load();
    EXPECT_FALSE(loaded);
    EXPECT_NE(loaded.reason().find(part), std::string::npos) << "said: " << loaded.reason();
  }

  std::filesystem::path folder_;
  std::string yaml_, urdf_;
};

TEST(RobotMeaning, IsTheGoldenOne) {
  const std::filesystem::path golden = std::filesystem::path(CRUX_GOLDEN) / "robot_meaning";
  EXPECT_EQ(robot_meaning(YAML::LoadFile(golden / "robot.yaml"), text_of(golden / "made-up.urdf")),
            text_of(golden / "meaning.txt"));
}

TEST_F(RobotFiles, TheHashIsOfWhatTheySayNotOfHow) {
  const std::string before = load().value().sha256;
  replace(yaml_, "  rate_Hz: 500\n", "\n    # cycles a second\n  rate_Hz: 5.0e+2\n");
  replace(urdf_, "<mass value=\"2.8\"/>", "<!-- weighed -->\n\n<mass   value='+2.800'></mass>");
  EXPECT_EQ(load().value().sha256, before);
  replace(urdf_, "+2.800", "2.8000000000000003");
  EXPECT_NE(load().value().sha256, before);
}

TEST_F(RobotFiles, AreKept) {
  const auto files = load().value().files;
  EXPECT_EQ(files[0], std::pair(std::string("robot.yaml"), yaml_));
  EXPECT_EQ(files[1], std::pair(std::string("scaler.urdf"), urdf_));
}

TEST(RobotDescription, HandCarriesTheFingers) {
  EXPECT_EQ(robot().name, "scaler");
  EXPECT_NEAR(robot().limbs[0].hand_mass_kg, 0.35, 1e-12);
  EXPECT_NEAR(robot().limbs[0].hand_com_G_m.z(), (0.25 * 0.06 + 0.1 * 0.02) / 0.35, 1e-12);
}

TEST(RobotDescription, AMissingFileIsNamed) {
  EXPECT_NE(load_robot("/nonexistent/robot.yaml").reason().find("/nonexistent/robot.yaml"), std::string::npos);
}

TEST_F(RobotFiles, AMissingKeyIsNamed) {
  replace(yaml_, "unload_force_N", "unload_force_Newton");
  expect_said("control: key 'unload_force_N' is missing");
}

TEST_F(RobotFiles, AWrongTypeIsNamed) {
  replace(yaml_, "damping_Ns_m: 400", "damping_Ns_m: much");
  expect_said("admittance: damping_Ns_m is 'much'; expected a number");
}

TEST_F(RobotFiles, ANumberOutOfRangeIsNamed) {
  replace(yaml_, "  mass_kg: 2.0", "  mass_kg: -2.0");
  expect_said("admittance: mass_kg is -2");
}

TEST_F(RobotFiles, GainsThatMaySwingAreRefusedWithThoseThatDoNot) {
  replace(yaml_, "  damping_Ns_m: 400", "  damping_Ns_m: 100");
  expect_said(
      "admittance: damping_Ns_m is 100; against 2 times environment_N_m, felt 0.016 s late, it is stable from 260.3 "
      "on");
  replace(yaml_, "  damping_Ns_m: 100", "  damping_Ns_m: 261");
  EXPECT_TRUE(load()) << load().reason();
  replace(yaml_, "rotational_damping_Nms_rad: 6", "rotational_damping_Nms_rad: 1.5");
  expect_said("rotational_damping_Nms_rad is 1.5; against 2 times environment_Nm_rad");
}

TEST_F(RobotFiles, ADelayLongerThanCanBeReckonedWithIsRefused) {
  replace(yaml_, "delay_s: 0.016", "delay_s: 0.16");
  expect_said("admittance: delay_s is 0.16");
}

TEST_F(RobotFiles, AnotherVersionIsNamed) {
  replace(yaml_, "version: 1", "version: 2");
  expect_said("version is 2; this program reads version 1");
}

TEST_F(RobotFiles, BrokenYamlIsNamed) {
  yaml_ += "\n  : [";
  expect_said("is not valid YAML");
}

TEST_F(RobotFiles, BrokenUrdfIsNamed) {
  replace(urdf_, "<robot name", "<automaton name");
  expect_said("scaler.urdf: is not a valid URDF");
}

TEST_F(RobotFiles, AMissingJointIsNamed) {
  replace(yaml_, "joints: [joint1,", "joints: [hip,");
  replace(yaml_, "nodes: {joint1: 1", "nodes: {hip: 1");
  expect_said("'LF_joint1'");
}

TEST_F(RobotFiles, AMissingGripperIsNamed) {
  replace(yaml_, "gripper_frame: gripper", "gripper_frame: hand");
  expect_said("has no link 'LF_hand'");
}

TEST_F(RobotFiles, EmptyLimitsAreNamed) {
  replace(urdf_, "lower=\"-1.9\" upper=\"1.9\"", "lower=\"1.9\" upper=\"-1.9\"");
  expect_said("limits of joint 'LF_joint1'");
}

}  // namespace
}  // namespace crux_test
