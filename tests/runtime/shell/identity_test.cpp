#include "lcm/identity.hpp"

#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

namespace crux {
namespace {

class IdentityTest : public testing::Test {
 protected:
  IdentityTest() : folder_(testing::TempDir() + "crux_identity_" + std::to_string(::getpid())) {}
  ~IdentityTest() override { std::filesystem::remove_all(folder_); }
  Identity read() { return Identity::of_file(path_, trouble_); }

  std::string folder_, path_ = folder_ + "/state/runtime.pem", trouble_;
};

TEST_F(IdentityTest, IsMadeOnceAndStays) {
  const Identity first = read(), second = read();
  EXPECT_EQ(trouble_, "");
  EXPECT_EQ(first.key(), second.key());
  EXPECT_NE(first.key(), Identity().key());
  struct stat status{};
  ASSERT_EQ(::stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
}

TEST_F(IdentityTest, WhatItSignsIsReadByItsPublicHalf) {
  const Identity identity = read();
  const std::vector<std::uint8_t> message = {1, 2, 3};
  const Identity::Signature signature = identity.sign(message);
  const Identity::Key key = identity.key();
  EVP_PKEY* open = EVP_PKEY_new_raw_public_key(EVP_PKEY_ED25519, nullptr, key.data(), key.size());
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  ASSERT_EQ(EVP_DigestVerifyInit(context, nullptr, nullptr, nullptr, open), 1);
  EXPECT_EQ(EVP_DigestVerify(context, signature.data(), signature.size(), message.data(), message.size()), 1);
  EVP_MD_CTX_free(context);
  EVP_PKEY_free(open);
}

TEST_F(IdentityTest, WhatCannotBeReadOrWrittenKeepsNobodyFromStarting) {
  const auto expect_trouble = [this](const std::string& words) {
    trouble_.clear();
    const Identity identity = read();
    EXPECT_NE(identity.key(), Identity::Key{});
    EXPECT_NE(trouble_.find(words), std::string::npos) << trouble_;
  };
  read();
  ASSERT_EQ(::chmod(path_.c_str(), 0644), 0);
  expect_trouble("others may read it");
  std::ofstream(path_) << "no key\n";
  ASSERT_EQ(::chmod(path_.c_str(), 0600), 0);
  expect_trouble("no Ed25519 key");
  std::filesystem::remove(path_);
  std::filesystem::create_directory_symlink("/etc", path_);
  expect_trouble(path_);
  path_ = "/proc/nowhere/runtime.pem";
  expect_trouble("/proc/nowhere");
  path_.clear();
  expect_trouble("no place for it");
}

}  // namespace
}  // namespace crux
