#include "lcm/identity.hpp"

#include <fcntl.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>

namespace crux {
namespace {

EVP_PKEY* of(void* key) { return static_cast<EVP_PKEY*>(key); }

struct Closed {
  void operator()(std::FILE* file) const noexcept { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, Closed>;

/// Null where there is no key; `trouble` says why, but not where there is no file.
EVP_PKEY* read(const std::string& path, std::string& trouble) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd < 0) {
    if (errno != ENOENT) trouble = std::strerror(errno);
    return nullptr;
  }
  const File file(::fdopen(fd, "r"));
  struct stat status{};
  ::fstat(fd, &status);
  if (!S_ISREG(status.st_mode) || (status.st_mode & (S_IRWXG | S_IRWXO)) != 0 || status.st_uid != ::geteuid()) {
    trouble = "others may read it, or it is another user's; right is a file of the runtime's user with mode 600";
    return nullptr;
  }
  EVP_PKEY* key = PEM_read_PrivateKey(file.get(), nullptr, nullptr, nullptr);
  if (key != nullptr && EVP_PKEY_get_id(key) == EVP_PKEY_ED25519) return key;
  EVP_PKEY_free(key);
  trouble = "has no Ed25519 key in PEM without a password";
  return nullptr;
}

/// Puts the whole file there at once, and none over another one.
bool write(const std::string& path, EVP_PKEY* key) {
  std::error_code ignored;
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  if (std::filesystem::create_directories(folder, ignored)) ::chmod(folder.c_str(), S_IRWXU);
  std::string made = path + ".XXXXXX";
  const int fd = ::mkostemp(made.data(), O_CLOEXEC);  // mode 600
  if (fd < 0) return false;
  File file(::fdopen(fd, "w"));
  bool good = PEM_write_PrivateKey(file.get(), key, nullptr, nullptr, 0, nullptr, nullptr) == 1;
  good = std::fflush(file.get()) == 0 && good;
  good = good && (::link(made.c_str(), path.c_str()) == 0 || errno == EEXIST);
  const int error = errno;
  ::unlink(made.c_str());
  errno = error;
  return good;
}

}  // namespace

void Identity::Freed::operator()(void* key) const noexcept { EVP_PKEY_free(of(key)); }

Identity::Identity() : key_(EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519")) {
  if (!key_) throw std::runtime_error("OpenSSL makes no Ed25519 key");
}

Identity Identity::of_file(const std::string& path, std::string& trouble) {
  Identity made;
  if (path.empty()) {
    trouble = "there is no place for it: neither STATE_DIRECTORY, XDG_STATE_HOME nor HOME is set";
    return made;
  }
  if (EVP_PKEY* found = read(path, trouble)) return Identity(found);
  if (trouble.empty() && !write(path, of(made.key_.get()))) trouble = std::strerror(errno);
  if (!trouble.empty()) {
    trouble = path + ": " + trouble;
    return made;
  }
  EVP_PKEY* found = read(path, trouble);  // of another runtime that began at the same time, or the one made here
  return found != nullptr ? Identity(found) : std::move(made);
}

std::string Identity::default_path() {
  // NOLINTBEGIN(concurrency-mt-unsafe) before there are threads
  const char *own = std::getenv("STATE_DIRECTORY"), *state = std::getenv("XDG_STATE_HOME"), *home = std::getenv("HOME");
  // NOLINTEND(concurrency-mt-unsafe)
  if (own != nullptr && *own != '\0') return std::string(own) + "/runtime.pem";
  if (state != nullptr && *state != '\0') return std::string(state) + "/crux/runtime.pem";
  return home != nullptr && *home != '\0' ? std::string(home) + "/.local/state/crux/runtime.pem" : "";
}

Identity::Key Identity::key() const {
  Key key{};
  std::size_t size = key.size();
  EVP_PKEY_get_raw_public_key(of(key_.get()), key.data(), &size);
  return key;
}

Identity::Signature Identity::sign(std::span<const std::uint8_t> bytes) const {
  Signature signature{};
  std::size_t size = signature.size();
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  if (EVP_DigestSignInit(context, nullptr, nullptr, nullptr, of(key_.get())) == 1)
    EVP_DigestSign(context, signature.data(), &size, bytes.data(), bytes.size());
  EVP_MD_CTX_free(context);
  return signature;
}

std::array<std::uint8_t, 32> digest_of(std::span<const std::uint8_t> bytes) {
  std::array<std::uint8_t, 32> digest{};
  EVP_Digest(bytes.data(), bytes.size(), digest.data(), nullptr, EVP_sha256(), nullptr);
  return digest;
}

std::string hex_of(std::span<const std::uint8_t> bytes) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : bytes) (text += kDigits[byte >> 4U]) += kDigits[byte & 15U];
  return text;
}

}  // namespace crux
