#include "lcm/authorized_keys.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

namespace crux {
namespace {

const std::string kA(64, 'a'), kB(64, 'b');

std::string error_of(const std::string& text) {
  try {
    parse_keys(text, "keys");
  } catch (const KeysError& error) {
    return error.what();
  }
  return "";
}

TEST(AuthorizedKeys, ALineAKey) {
  const auto keys = parse_keys("# ours\n\n" + kA + " operate ann@base\r\n  " + kB + "\twatch\tbob", "keys");
  ASSERT_EQ(keys.size(), 2U);
  EXPECT_EQ(keys[0].key[0], 0xAA);
  EXPECT_EQ(keys[0].role, Role::kOperate);
  EXPECT_EQ(keys[0].name, "ann@base");
  EXPECT_EQ(keys[1].key[31], 0xBB);
  EXPECT_EQ(keys[1].role, Role::kWatch);
  EXPECT_EQ(keys[1].name, "bob");
}

TEST(AuthorizedKeys, MistakesAreNamedWithTheirLine) {
  const std::string good = kA + " operate ann\n";
  const auto has = [](const std::string& said, const std::string& words) {
    EXPECT_NE(said.find(words), std::string::npos) << said;
  };
  has(error_of(good + kB), "keys:2");
  has(error_of(good + kB + " operate"), "KEY ROLE NAME");
  has(error_of(good + kB + " operate bob bobson"), "KEY ROLE NAME");
  has(error_of(good + kB + " root bob"), "'root': right is operate or watch");
  has(error_of(good + kB.substr(1) + " operate bob"), "64 hexadecimal digits");
  has(error_of(good + "+" + kB.substr(1) + " operate bob"), "64 hexadecimal digits");
  has(error_of(good + "g" + kB.substr(1) + " operate bob"), "64 hexadecimal digits");
  has(error_of(good + kA + " watch bob"), "stands above already");
  has(error_of(good + kB + " watch ann"), "stands above already");
  has(error_of(good + kB + " watch b\x1b[2Jb"), "ASCII");
  has(error_of(""), "crux key new");
  has(error_of(kA + " watch ann"), "no key with role operate");
}

TEST(AuthorizedKeys, AFileThatOthersMayWriteToIsRefused) {
  const std::string path = testing::TempDir() + "crux_authorized_keys_test";
  std::ofstream(path) << kA << " operate ann\n";
  for (const mode_t mode : {0600U, 0644U, 0444U}) {
    ASSERT_EQ(::chmod(path.c_str(), mode), 0);
    EXPECT_EQ(read_keys(path).size(), 1U);
  }
  for (const mode_t mode : {0620U, 0602U}) {
    ASSERT_EQ(::chmod(path.c_str(), mode), 0);
    EXPECT_THROW(read_keys(path), KeysError);
  }
  std::remove(path.c_str());
  EXPECT_THROW(read_keys(path), KeysError);
  EXPECT_THROW(read_keys(testing::TempDir()), KeysError);
}

TEST(AuthorizedKeys, AFileOfAnotherUserIsRefused) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root gives files away";
  constexpr uid_t kOther = 65534;
  const std::string path = testing::TempDir() + "crux_authorized_keys_of_another";
  std::ofstream(path) << kA << " operate ann\n";
  ASSERT_EQ(::chmod(path.c_str(), 0644), 0);
  ASSERT_EQ(::chown(path.c_str(), kOther, 0), 0);
  try {
    read_keys(path);
    FAIL() << "taken";
  } catch (const KeysError& error) {
    EXPECT_NE(std::string(error.what()).find("belongs to user 65534"), std::string::npos) << error.what();
  }
  // A runtime that runs as a user of its own takes root's file.
  ASSERT_EQ(::chown(path.c_str(), 0, 0), 0);
  ASSERT_EQ(::seteuid(kOther), 0);
  EXPECT_EQ(read_keys(path).size(), 1U);
  ASSERT_EQ(::seteuid(0), 0);
  std::remove(path.c_str());
}

}  // namespace
}  // namespace crux
