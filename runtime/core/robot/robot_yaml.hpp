// robot.yaml, checked as crux_contracts checks it: every key without a default there, none that is unknown, every value
// in its range.
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>
#include <vector>

#include "core/robot/geometry.hpp"

namespace crux {

/// A mapping of a file that has been checked: what is asked for is there and of its kind.
class YamlSection {
 public:
  explicit YamlSection(const YAML::Node& node) : node_(node) {}

  bool has(const std::string& section, const std::string& key) const {
    const YAML::Node found = node_[section];
    return found && found[key];
  }
  YamlSection section(const std::string& key) const { return YamlSection(node_[key]); }
  std::string text(const std::string& key) const { return node_[key].Scalar(); }
  double number(const std::string& key) const { return value(node_[key]); }
  int integer(const std::string& key) const { return static_cast<int>(number(key)); }

  std::vector<double> numbers(const std::string& key) const {
    std::vector<double> values;
    for (const YAML::Node& each : node_[key]) values.push_back(value(each));
    return values;
  }

  std::vector<std::string> texts(const std::string& key) const {
    std::vector<std::string> values;
    for (const YAML::Node& each : node_[key]) values.push_back(each.Scalar());
    return values;
  }

  /// The mapping itself.
  const YAML::Node& node() const { return node_; }

 private:
  static double value(const YAML::Node& node);

  YAML::Node node_;
};

/// @throws std::runtime_error with the first problem: file, line, key, value and what would be right
YamlSection checked_robot_yaml(const std::string& bytes, const std::string& path);

}  // namespace crux
