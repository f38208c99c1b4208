// Reading a YAML mapping with errors that name file, key, value and what would be right.
#pragma once

#include <yaml-cpp/yaml.h>

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace crux {

/// A mapping inside a YAML file. Throws std::runtime_error with the user's sentence.
class YamlReader {
 public:
  YamlReader(const YAML::Node& node, std::string where) : node_(node), where_(std::move(where)) {
    if (!node_ || !node_.IsMap()) throw std::runtime_error(where_ + ": expected a mapping");
  }

  YamlReader section(const std::string& key) const { return {child(key), where_ + ": " + key}; }

  /// Where `key` stands, as messages say it.
  std::string at(const std::string& key) const { return where_ + ": " + key; }

  std::string text(const std::string& key) const { return scalar<std::string>(key, "a text"); }
  int integer(const std::string& key) const { return scalar<int>(key, "a whole number"); }

  double number(const std::string& key) const { return finite(scalar<double>(key, "a number"), key); }

  double positive(const std::string& key) const {
    const double value = number(key);
    if (value <= 0.0) throw std::runtime_error(at(key) + " is " + std::to_string(value) + "; it must be above 0");
    return value;
  }

  double not_negative(const std::string& key) const {
    const double value = number(key);
    if (value < 0.0) throw std::runtime_error(at(key) + " is " + std::to_string(value) + "; it must not be negative");
    return value;
  }

  template <std::size_t N>
  std::array<double, N> numbers(const std::string& key) const {
    const YAML::Node list = child(key);
    if (!list.IsSequence() || list.size() != N) {
      throw std::runtime_error(at(key) + ": expected a list of " + std::to_string(N) + " numbers");
    }
    std::array<double, N> values{};
    for (std::size_t i = 0; i < N; ++i) values[i] = finite(convert<double>(list[i], key, "a list of numbers"), key);
    return values;
  }

  template <std::size_t N>
  std::array<std::string, N> texts(const std::string& key) const {
    const YAML::Node list = child(key);
    if (!list.IsSequence() || list.size() != N) {
      throw std::runtime_error(at(key) + ": expected a list of " + std::to_string(N) + " names");
    }
    std::array<std::string, N> values{};
    for (std::size_t i = 0; i < N; ++i) values[i] = convert<std::string>(list[i], key, "a list of names");
    return values;
  }

 private:
  YAML::Node child(const std::string& key) const {
    const YAML::Node found = node_[key];
    if (!found) throw std::runtime_error(where_ + ": key '" + key + "' is missing");
    return found;
  }

  template <class T>
  T scalar(const std::string& key, const char* wanted) const {
    return convert<T>(child(key), key, wanted);
  }

  template <class T>
  T convert(const YAML::Node& node, const std::string& key, const char* wanted) const {
    try {
      return node.as<T>();
    } catch (const YAML::Exception&) {
      const std::string value = node.IsScalar() ? "is '" + node.Scalar() + "'" : "is no scalar";
      throw std::runtime_error(at(key) + " " + value + "; expected " + wanted);
    }
  }

  double finite(double value, const std::string& key) const {
    if (!std::isfinite(value)) throw std::runtime_error(at(key) + " is not a finite number");
    return value;
  }

  YAML::Node node_;
  std::string where_;
};

}  // namespace crux
