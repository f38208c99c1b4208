#include "lcm/authorized_keys.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <sstream>

#include "bus/descriptor.hpp"

namespace crux {
namespace {

constexpr std::size_t kMaxName = 64;
constexpr const char* kRightLine = "right is KEY ROLE NAME, as `crux key show` prints it";

bool is_name(const std::string& text) {
  return text.size() <= kMaxName && std::ranges::all_of(text, [](char c) { return c > ' ' && c <= '~'; });
}

bool read_hex(std::string_view text, std::array<std::uint8_t, 32>& bytes) {
  if (text.size() != 2 * bytes.size()) return false;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const char* begin = text.data() + 2 * i;
    if (std::from_chars(begin, begin + 2, bytes[i], 16).ptr != begin + 2) return false;
  }
  return true;
}

AuthorizedKey read_line(const std::string& line, const std::string& place) {
  std::istringstream words(line);
  std::string key, role, more;
  AuthorizedKey read;
  words >> key >> role >> read.name;
  if (read.name.empty() || words >> more) throw KeysError(place + ": '" + line + "': " + kRightLine);
  if (!read_hex(key, read.key))
    throw KeysError(place + ": key '" + key + "': right are 64 hexadecimal digits; " + kRightLine);
  if (role != "operate" && role != "watch") throw KeysError(place + ": role '" + role + "': right is operate or watch");
  if (!is_name(read.name)) throw KeysError(place + ": name: right are at most 64 characters of ASCII");
  read.role = role == "operate" ? Role::kOperate : Role::kWatch;
  return read;
}

std::string read_all(int file, const std::string& path) {
  std::string text;
  std::array<char, 4096> block{};
  for (;;) {
    const ssize_t got = ::read(file, block.data(), block.size());
    if (got < 0) throw KeysError("--keys " + path + ": " + std::strerror(errno));
    if (got == 0) return text;
    text.append(block.data(), static_cast<std::size_t>(got));
  }
}

}  // namespace

std::vector<AuthorizedKey> parse_keys(std::string_view text, const std::string& where) {
  std::vector<AuthorizedKey> keys;
  std::istringstream lines{std::string(text)};
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    const std::string place = where + ":" + std::to_string(number);
    AuthorizedKey key = read_line(line, place);
    for (const AuthorizedKey& other : keys) {
      if (other.key == key.key || other.name == key.name)
        throw KeysError(place + ": '" + key.name + "': the key or the name stands above already");
    }
    keys.push_back(std::move(key));
  }
  if (std::ranges::none_of(keys, [](const AuthorizedKey& key) { return key.role == Role::kOperate; }))
    throw KeysError(where + ": has no key with role operate, nobody could command; `crux key new` makes one");
  return keys;
}

std::vector<AuthorizedKey> read_keys(const std::string& path) {
  // What is looked at is what is read; a pipe is not waited for.
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat status{};
  if (file.get() < 0 || ::fstat(file.get(), &status) != 0)
    throw KeysError("--keys " + path + ": " + std::strerror(errno) + "; `crux key new` makes a key for it");
  if (!S_ISREG(status.st_mode)) throw KeysError("--keys " + path + ": is no file");
  if (status.st_uid != 0 && status.st_uid != ::geteuid())
    throw KeysError("--keys " + path + ": belongs to user " + std::to_string(status.st_uid) +
                    ", who could make himself an operator; right is root or user " + std::to_string(::geteuid()) +
                    ", whom the runtime runs as; chown root " + path);
  if ((status.st_mode & (S_IWGRP | S_IWOTH)) != 0)
    throw KeysError("--keys " + path + ": others may write to it, and make themselves operators; chmod go-w " + path);
  return parse_keys(read_all(file.get(), path), path);
}

}  // namespace crux
