// What is read from a robot description; those that are refused are in tests/cross/broken_robots.py.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/robot/robot_meaning.hpp"
#include "core/robot/robot_reader.hpp"
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

TEST_F(RobotFiles, KeysThatAreMissingHaveTheirDefaults) {
  replace(yaml_, "  rate_N_s: 200\n", "  rate_N_s: 45\n");
  replace(yaml_, "  stand_s: 0.2\n", "");
  EXPECT_EQ(load().value().grasp_test.rate_N_s, 45.0);
  EXPECT_EQ(load().value().grasp_test.stand_s, 0.3);
  const std::size_t from = yaml_.find("grasp_test:");
  yaml_.erase(from, yaml_.find("localisation:") - from);
  EXPECT_EQ(load().value().grasp_test.rate_N_s, 30.0);
}

TEST(RobotDescription, HandCarriesTheFingers) {
  EXPECT_EQ(robot().name, "scaler");
  EXPECT_NEAR(robot().limbs[0].hand_mass_kg, 0.35, 1e-12);
  EXPECT_NEAR(robot().limbs[0].hand_com_G_m.z(), (0.25 * 0.06 + 0.1 * 0.02) / 0.35, 1e-12);
}

/// Compares what was read with the file as yaml-cpp reads it.
struct AsInTheFile {
  YAML::Node file = YAML::LoadFile(CRUX_ROBOT);
  int* seen;

  YAML::Node at(const char* section, const char* key) const { return ++*seen, file[section][key]; }
  void operator()(const char* section, const char* key, double value) const {
    if (!file[section]) return;  // left out, as all its keys have defaults
    EXPECT_EQ(value, at(section, key).as<double>()) << section << '.' << key;
  }
  void operator()(const char* section, const char* key, int value) const {
    EXPECT_EQ(value, at(section, key).as<int>()) << section << '.' << key;
  }
  void operator()(const char* section, const char* key, const std::array<double, kJoints>& values) const {
    if (!file[section]) return;  // likewise
    const auto given = at(section, key).as<std::array<double, kPlacing>>();
    EXPECT_TRUE(std::equal(given.begin(), given.end(), values.begin())) << section << '.' << key;
    EXPECT_EQ(values.back(), given.back()) << section << '.' << key;
  }
  void operator()(const char* section, const char* key, const crux_msgs::robot::Interval& value) const {
    EXPECT_EQ((std::array{value.low, value.high}), (at(section, key).as<std::array<double, 2>>())) << key;
  }
  void operator()(const char* section, const char* key, const crux_msgs::robot::Nodes& value) const {
    const YAML::Node nodes = at(section, key);
    EXPECT_EQ(value.joints[2], nodes["joint3"].as<int>());
    EXPECT_EQ(value.gripper, nodes["gripper"].as<int>());
  }
};

TEST(RobotDescription, HasEveryNumberOfTheFile) {
  int seen = 0, there = 0;
  RobotDescription read = robot();
  crux_msgs::robot::each_value(read, AsInTheFile{.seen = &seen});
  for (const auto& section : YAML::LoadFile(CRUX_ROBOT))
    if (section.second.IsMap() && section.first.Scalar().find("limb") != 0)
      there += static_cast<int>(section.second.size());
  EXPECT_EQ(seen, there);
}

TEST(RobotDescription, AMissingFileIsNamed) {
  EXPECT_NE(load_robot("/nonexistent/robot.yaml").reason().find("/nonexistent/robot.yaml"), std::string::npos);
}

}  // namespace
}  // namespace crux_test
