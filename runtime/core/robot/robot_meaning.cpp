#include "core/robot/robot_meaning.hpp"

#include <tinyxml.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <map>
#include <optional>
#include <stdexcept>
#include <vector>

#include "core/robot/numbers.hpp"

namespace crux {
namespace {

constexpr const char* kFirstLine = "crux-robot-2\n";

std::string canonical_word(const std::string& word) {
  const std::optional<double> number = decimal(word);
  if (!number) return word;
  const double value = *number + 0.0;  // -0 is 0
  std::array<char, 18> hex{};
  std::snprintf(hex.data(), hex.size(), "#%016llx",
                static_cast<unsigned long long>(std::bit_cast<std::uint64_t>(value)));
  return hex.data();
}

std::string words(const std::string& text) {
  std::string all;
  for_each_word(text, [&](const std::string& word) {
    if (!all.empty()) all += ' ';
    all += canonical_word(word);
  });
  return all;
}

/// Without its namespace.
std::string local(const std::string& name) { return name.substr(name.find(':') + 1); }

class Lines {
 public:
  void add_yaml(const YAML::Node& node, const std::string& place) {
    if (node.IsMap()) {
      for (const auto& member : node)
        add_yaml(member.second, (place.empty() ? "" : place + ".") + member.first.Scalar());
    } else if (node.IsSequence()) {
      for (std::size_t i = 0; i < node.size(); ++i) add_yaml(node[i], place + "[" + std::to_string(i) + "]");
    } else {
      add("robot.yaml " + place, node.IsScalar() ? node.Scalar() : "");
    }
  }

  void add_xml(const TiXmlElement& element, const std::string& parent, int index) {
    const char* name = element.Attribute("name");
    const std::string place =
        parent + "/" + local(element.ValueStr()) + "[" + (name != nullptr ? name : std::to_string(index)) + "]";
    std::string text;
    std::map<std::string, int> count;
    for (const TiXmlNode* child = element.FirstChild(); child != nullptr; child = child->NextSibling()) {
      if (child->ToText() != nullptr) text += child->ValueStr() + " ";
      if (child->ToElement() != nullptr) add_xml(*child->ToElement(), place, count[local(child->ValueStr())]++);
    }
    add("urdf " + place, text);
    for (const TiXmlAttribute* a = element.FirstAttribute(); a != nullptr; a = a->Next())
      if (!std::string(a->Name()).starts_with("xmlns")) add("urdf " + place + "@" + local(a->Name()), a->ValueStr());
  }

  std::string text() {
    std::sort(lines_.begin(), lines_.end());
    std::string all = kFirstLine;
    for (const std::string& line : lines_) all += line;
    return all;
  }

 private:
  void add(const std::string& place, const std::string& value) { lines_.push_back(place + "\t" + words(value) + "\n"); }

  std::vector<std::string> lines_;
};

}  // namespace

std::string robot_meaning(const YAML::Node& yaml, const std::string& urdf) {
  TiXmlDocument document;
  document.Parse(urdf.c_str());
  if (document.RootElement() == nullptr) throw std::runtime_error("the URDF is no XML");
  Lines lines;
  lines.add_yaml(yaml, "");
  lines.add_xml(*document.RootElement(), "", 0);
  return lines.text();
}

}  // namespace crux
