#include "core/robot/robot_yaml.hpp"

#include <yaml-cpp/eventhandler.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <map>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "core/robot/description_problem.hpp"
#include "core/robot/reason.hpp"
#include "crux_msgs/robot.hpp"

namespace crux {
namespace {

namespace bounds = crux_msgs::robot;
using crux_msgs::robot::RobotKey;
using crux_msgs::robot::RobotKeyType;

constexpr std::size_t kShownText = 60;

int line_of(const YAML::Mark& mark) { return mark.line + 1; }

/// Refuses what crux's YAML leaves out: anchors, tags, several documents, deep nesting.
class PlainYaml : public YAML::EventHandler {
 public:
  explicit PlainYaml(std::string path) : path_(std::move(path)) {}

  void OnDocumentStart(const YAML::Mark& mark) override {
    if (std::exchange(begun_, true)) refuse_at(mark, "expected one document only, without a second `---`");
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { look_at(mark, "", anchor); }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override { look_at(mark, "", anchor); }
  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                const std::string& /*value*/) override {
    look_at(mark, tag, anchor);
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value /*style*/) override {
    look_at(mark, tag, anchor);
    ++depth_;
  }
  void OnSequenceEnd() override { --depth_; }
  void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value /*style*/) override {
    look_at(mark, tag, anchor);
    ++depth_;
  }
  void OnMapEnd() override { --depth_; }

 private:
  void look_at(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor) const {
    if (anchor != 0) refuse_at(mark, "anchors and aliases (& and *) are not allowed: write the value out");
    if (depth_ > bounds::kMaxDepth)
      refuse_at(mark, "nested deeper than " + std::to_string(bounds::kMaxDepth) + " levels");
    if (!tag.empty() && tag != "?" && tag != "!") refuse_at(mark, "tags (!) are not allowed");
  }

  [[noreturn]] void refuse_at(const YAML::Mark& mark, const std::string& expected) const {
    throw std::runtime_error(problem(path_, "", "", expected, line_of(mark)));
  }

  std::string path_;
  int depth_ = 0;
  bool begun_ = false;
};

enum class Kind { kNothing, kText, kInteger, kFloat, kOther };

template <std::size_t N>
bool is_one_of(std::string_view text, const std::array<std::string_view, N>& words) {
  return std::ranges::find(words, text) != words.end();
}

std::string_view without_sign(std::string_view text) {
  return text.starts_with('+') || text.starts_with('-') ? text.substr(1) : text;
}

/// How many digits it begins with.
std::size_t digits(std::string_view text) { return std::min(text.find_first_not_of("0123456789"), text.size()); }

/// Whether 64 bits hold it for sure.
bool is_integer(std::string_view text) {
  const std::string_view rest = without_sign(text);
  const std::size_t most = rest.size() == text.size() ? 18 : 17;
  return !rest.empty() && rest.size() <= most && digits(rest) == rest.size();
}

bool is_finite_number(std::string_view text) {
  std::string_view rest = without_sign(text);
  std::size_t count = digits(rest);
  rest.remove_prefix(count);
  if (rest.starts_with('.')) {
    const std::size_t behind = digits(rest.substr(1));
    rest.remove_prefix(1 + behind);
    count += behind;
  }
  if (count == 0 || rest.empty()) return count > 0;
  const std::string_view exponent = without_sign(rest.substr(1));
  return (rest[0] == 'e' || rest[0] == 'E') && !exponent.empty() && digits(exponent) == exponent.size();
}

/// Of a scalar by YAML 1.2's core schema; quoted scalars are texts.
Kind kind_of(const YAML::Node& node) {
  using namespace std::string_view_literals;
  const std::string_view text = node.Scalar();
  if (node.IsNull()) return Kind::kNothing;
  if (!node.IsScalar()) return Kind::kOther;
  if (node.Tag() == "!" || text.size() > kShownText) return Kind::kText;
  if (is_one_of(text, std::array{""sv, "~"sv, "null"sv, "Null"sv, "NULL"sv})) return Kind::kNothing;
  if (is_one_of(text, std::array{"true"sv, "True"sv, "TRUE"sv, "false"sv, "False"sv, "FALSE"sv})) return Kind::kOther;
  if (is_integer(text)) return Kind::kInteger;
  const bool float_word = is_one_of(without_sign(text), std::array{".inf"sv, ".Inf"sv, ".INF"sv}) ||
                          is_one_of(text, std::array{".nan"sv, ".NaN"sv, ".NAN"sv});
  return float_word || is_finite_number(text) ? Kind::kFloat : Kind::kText;
}

double value_of(const std::string& text) {
  if (text.find_first_of("nNiI") != std::string::npos) return std::nan("");  // .nan, .inf
  return std::strtod(text.c_str(), nullptr);
}

std::string shown(const YAML::Node& node) {
  if (node.IsMap()) return node.size() > 0 ? "a mapping" : "an empty mapping";
  if (node.IsSequence()) return "a list of " + std::to_string(node.size());
  const Kind kind = kind_of(node);
  if (kind == Kind::kNothing) return "nothing";
  std::string text = node.Scalar();
  if (text.size() > kShownText) text = text.substr(0, kShownText - 3) + "...";
  return kind == Kind::kText ? "\"" + text + "\"" : text;
}

/// Collects the problems of robot.yaml.
class Checker {
 public:
  explicit Checker(std::string path) : path_(std::move(path)) {}

  void check(const YAML::Node& root) {
    std::vector<std::string> keys = keys_of("");
    const std::size_t own = keys.size();
    std::set<std::string> optional;
    for (const RobotKey& key : bounds::kKeys) {
      if (key.section.empty()) continue;
      if (keys.back() != key.section) optional.insert(keys.emplace_back(key.section));
      if (!key.optional) optional.erase(keys.back());
    }
    const YAML::Node found = members(root, "", keys, optional);
    check_values(found, "", "");
    for (auto section = keys.begin() + static_cast<std::ptrdiff_t>(own); section != keys.end(); ++section) {
      if (!found[*section]) continue;
      if (*section == "limbs")
        check_limbs(found[*section]);
      else
        check_section(found[*section], *section, *section);
    }
    const auto by_line = [](const auto& a, const auto& b) { return a.first < b.first; };
    std::ranges::stable_sort(problems_, by_line);
    if (!problems_.empty()) throw std::runtime_error(problems_.front().second);
  }

 private:
  static std::string path_to(const std::string& place, const std::string& key) {
    return place.empty() ? key : place + "." + key;
  }

  void note(const YAML::Node& node, const std::string& place, const std::string& expected) {
    note(node, place, shown(node), expected);
  }

  void note(const YAML::Node& node, const std::string& place, const std::string& value, const std::string& expected) {
    const auto empty = empty_.find(place);
    const int line = empty == empty_.end() ? line_of(node.Mark()) : empty->second;
    problems_.emplace_back(line, problem(path_, place, value, expected, line));
  }

  /// The mapping, or an empty one. A key that is unknown is noted, else one that is missing and not optional.
  YAML::Node members(const YAML::Node& node, const std::string& place, const std::vector<std::string>& keys,
                     const std::set<std::string>& optional = {}) {
    if (!node.IsMap()) {
      note(node, place, "expected a mapping with " + keys.front());
      return YAML::Node(YAML::NodeType::Map);
    }
    bool unknown = false;
    std::set<std::string> there;
    for (const auto& member : node) {
      const std::string& key = member.first.Scalar();
      if (member.second.IsNull()) empty_[path_to(place, key)] = line_of(member.first.Mark());
      if (!there.insert(key).second)
        note(member.first, path_to(place, key), "", "this key stands here twice");
      else if (std::ranges::find(keys, key) == keys.end())
        unknown = true, note(member.second, path_to(place, key), "", "unknown key");
    }
    for (const std::string& key : keys)
      if (!unknown && !there.contains(key) && !optional.contains(key))
        note(node, path_to(place, key), "", "is missing");
    return node;
  }

  void check_text(const YAML::Node& node, const std::string& place) {
    const Kind kind = kind_of(node);
    const std::string& text = node.Scalar();
    if (kind != Kind::kText) {
      note(node, place,
           node.IsScalar() && kind != Kind::kNothing ? "expected a text: \"" + text + "\"" : "expected a text");
      return;
    }
    const auto control = [](unsigned char c) { return c < 0x20 || c == 0x7f; };
    const auto length = std::ranges::count_if(text, [](unsigned char c) { return (c & 0xc0) != 0x80; });
    if (text.find_first_not_of(' ') == std::string::npos || length > bounds::kMaxText ||
        std::ranges::any_of(text, control))
      note(node, place, "expected a visible text of 1 to " + std::to_string(bounds::kMaxText) + " characters");
  }

  bool check_integer(const YAML::Node& node, const std::string& place, double low, double high) {
    const double value = kind_of(node) == Kind::kInteger ? value_of(node.Scalar()) : std::nan("");
    if (value >= low && value <= high) return true;
    note(node, place, "expected a whole number in " + shown_whole(low) + ".." + shown_whole(high));
    return false;
  }

  static std::string shown_whole(double value) { return std::to_string(static_cast<long>(value)); }

  bool check_number(const YAML::Node& node, const std::string& place, double low, double high, std::string_view unit) {
    const std::string in_unit = unit.empty() ? "" : " " + std::string(unit);
    const std::string expected = "expected a number in " + crux::shown(low) + ".." + crux::shown(high) + in_unit;
    const Kind kind = kind_of(node);
    if (kind != Kind::kInteger && kind != Kind::kFloat) return note(node, place, expected), false;
    const double value = value_of(node.Scalar());
    if (!std::isfinite(value)) return note(node, place, "is not a finite number; " + expected), false;
    if (value >= low && value <= high) return true;
    std::string hint;
    for (const auto& other : bounds::kOtherUnits)
      if (hint.empty() && other.unit == unit && value * other.factor >= low && value * other.factor <= high)
        hint = std::string("; looks like ") + other.name + ": " + crux::shown(value * other.factor) + "?";
    return note(node, place, expected + hint), false;
  }

  bool check_numbers(const YAML::Node& node, const std::string& place, const RobotKey& key, std::size_t count) {
    if (!node.IsSequence() || node.size() != count) {
      const std::string in_unit = key.unit.empty() ? "" : " in " + std::string(key.unit);
      note(node, place, "expected a list of " + std::to_string(count) + " numbers" + in_unit);
      return false;
    }
    for (std::size_t i = 0; i < count; ++i)
      if (!check_number(node[i], place + "[" + std::to_string(i) + "]", key.low, key.high, key.unit)) return false;
    return true;
  }

  void check_limbs(const YAML::Node& node) {
    const YAML::Node limbs = members(node, "limbs", {kLimbNames.begin(), kLimbNames.end()});
    for (const std::string limb : kLimbNames)
      if (limbs[limb]) check_section(limbs[limb], "limbs." + limb, "limbs");
  }

  /// Limbs share neither bus nor prefix.
  void check_own(const YAML::Node& node, const std::string& place, const RobotKey& key) {
    const std::string value = key.type == RobotKeyType::kInteger ? crux::shown(value_of(node.Scalar())) : node.Scalar();
    if (!taken_[key.key].insert(value).second)
      note(node, place, "expected a " + std::string(key.key) + " of its own for each limb");
  }

  static std::vector<std::string> keys_of(std::string_view section) {
    std::vector<std::string> keys;
    for (const RobotKey& key : bounds::kKeys)
      if (key.section == section) keys.emplace_back(key.key);
    return keys;
  }

  void check_section(const YAML::Node& node, const std::string& place, std::string_view section) {
    std::set<std::string> optional;
    for (const RobotKey& key : bounds::kKeys)
      if (key.section == section && key.optional) optional.emplace(key.key);
    check_values(members(node, place, keys_of(section), optional), place, section);
  }

  void check_values(const YAML::Node& found, const std::string& place, std::string_view section) {
    for (const RobotKey& key : bounds::kKeys) {
      const std::string name(key.key);
      if (key.section != section || !found[name]) continue;
      const std::size_t before = problems_.size();
      check_value(found[name], path_to(place, name), key);
      if (section == "limbs" && problems_.size() == before) check_own(found[name], path_to(place, name), key);
    }
  }

  void check_value(const YAML::Node& node, const std::string& place, const RobotKey& key) {
    switch (key.type) {
      case RobotKeyType::kNumber:
        check_number(node, place, key.low, key.high, key.unit);
        break;
      case RobotKeyType::kInteger:
        check_integer(node, place, key.low, key.high);
        break;
      case RobotKeyType::kPerJoint:
        check_numbers(node, place, key, !joints_.empty() ? joints_.size() : node.IsSequence() ? node.size() : kPlacing);
        break;
      case RobotKeyType::kInterval:
        check_interval(node, place, key);
        break;
      case RobotKeyType::kText:
        check_text(node, place);
        break;
      case RobotKeyType::kFile:
        check_text(node, place);
        check_file_name(node, place);
        break;
      case RobotKeyType::kNames:
        check_names(node, place, key);
        break;
      case RobotKeyType::kNodes:
        check_nodes(node, place);
    }
  }

  void check_interval(const YAML::Node& node, const std::string& place, const RobotKey& key) {
    if (!check_numbers(node, place, key, key.count)) return;
    const double low = value_of(node[0].Scalar()), high = value_of(node[1].Scalar());
    if (low >= high)
      note(node, place, "[" + crux::shown(low) + ", " + crux::shown(high) + "]",
           "expected [low, high] with low below high");
  }

  void check_file_name(const YAML::Node& node, const std::string& place) {
    const std::string& name = node.Scalar();
    if (kind_of(node) == Kind::kText && (name.find('/') != std::string::npos || name == "." || name == ".."))
      note(node, place, "expected a file name in the same folder");
  }

  void check_names(const YAML::Node& node, const std::string& place, const RobotKey& key) {
    const bool joints = key.key == "joints";
    const std::size_t least = joints ? bounds::kLeastJoints : key.count,
                      most = joints ? bounds::kMostJoints : key.count;
    if (!node.IsSequence() || node.size() < least || node.size() > most)
      return note(
          node, place,
          "expected a list of " + std::to_string(least) + (joints ? " to " + std::to_string(most) : "") + " names");
    const std::size_t before = problems_.size();
    for (std::size_t i = 0; i < node.size(); ++i) check_text(node[i], place + "[" + std::to_string(i) + "]");
    if (!joints || problems_.size() > before) return;
    for (const YAML::Node& name : node) joints_.push_back(name.Scalar());
  }

  /// Numbers on the bus, which the CAN database fixes: from the shoulder outwards; the gripper's is always one.
  void check_nodes(const YAML::Node& node, const std::string& place) {
    if (joints_.empty()) return;
    std::vector<std::string> names = joints_;
    names.emplace_back("gripper");
    const YAML::Node found = members(node, place, names);
    for (std::size_t i = 0; i < names.size(); ++i) {
      const YAML::Node one = found[names[i]];
      constexpr std::size_t gripper = bounds::kGripperNode;
      const std::size_t number = i + 1 == names.size() ? gripper : i + 1 < gripper ? i + 1 : i + 2;
      if (!one || (kind_of(one) == Kind::kInteger && value_of(one.Scalar()) == static_cast<double>(number))) continue;
      note(one, path_to(place, names[i]),
           "expected " + std::to_string(number) + ": nodes count from the shoulder outwards");
    }
  }

  std::string path_;
  std::vector<std::string> joints_;
  std::map<std::string_view, std::set<std::string>> taken_;  ///< values of the limbs' keys
  std::map<std::string, int> empty_;  ///< lines of keys without a value, which yaml-cpp places at what comes next
  std::vector<std::pair<int, std::string>> problems_;  ///< by line
};

}  // namespace

double YamlSection::value(const YAML::Node& node) { return value_of(node.Scalar()); }

YamlSection checked_robot_yaml(const std::string& bytes, const std::string& path) {
  try {
    std::istringstream stream(bytes);
    YAML::Parser parser(stream);
    PlainYaml plain(path);
    while (parser.HandleNextDocument(plain)) {
    }
    const YAML::Node root = YAML::Load(bytes);
    if (!root || root.IsNull()) refuse(path, "", "", "is empty");
    if (!root.IsMap())
      throw std::runtime_error(
          problem(path, "", shown(root), "expected a mapping of keys to values", line_of(root.Mark())));
    Checker(path).check(root);
    return YamlSection(root);
  } catch (const YAML::Exception& error) {
    throw std::runtime_error(problem(path, "", "", "is not YAML: " + error.msg, line_of(error.mark)));
  }
}

}  // namespace crux
