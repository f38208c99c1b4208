#include "app/restart_keeper.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <string_view>
#include <thread>
#include <utility>

#include "bus/descriptor.hpp"
#include "core/plan/plan_preparation.hpp"
#include "core/robot/hash.hpp"
#include "crux_msgs/cdr.hpp"
#include "lcm/identity.hpp"

namespace crux {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

constexpr auto kLooksEvery = 20ms;
constexpr double kAgain_s = 0.1, kSameAgain_s = 1.0;  // of a climb, and of a robot that stands
constexpr const char *kPlanFile = "/plan", *kPointFile = "/point", *kRetired = ".refused";
constexpr std::string_view kHead = "crux restart 1\n";
constexpr std::size_t kHashDigits = 64;

template <class Message>
std::string bytes_of(const Message& message) {
  std::string bytes(static_cast<std::size_t>(message.getEncodedSize()), '\0');
  message.encode(bytes.data(), 0, message.getEncodedSize());
  return bytes;
}

/// Puts the whole file there at once, on the disk; why it could not, else empty.
std::string replace_file(const std::string& path, const std::string& content) {
  const std::string made = path + ".new";
  const Descriptor file(::open(made.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (file.get() < 0) return path + ": " + std::strerror(errno);
  const auto size = static_cast<ssize_t>(content.size());
  if (::write(file.get(), content.data(), content.size()) != size || ::fdatasync(file.get()) != 0 ||
      ::rename(made.c_str(), path.c_str()) != 0)
    return path + ": " + std::strerror(errno);
  return "";
}

template <class Message>
std::string write_message(const std::string& path, const Message& message) {
  const std::string bytes = bytes_of(message);
  return replace_file(path, std::string(kHead) + sha256_hex(bytes) + bytes);
}

/// False where there is no such file, or where `trouble` says what is wrong with it.
template <class Message>
bool read_message(const std::string& path, Message& message, std::string& trouble) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    if (errno != ENOENT && errno != ENOTDIR) trouble = path + ": " + std::strerror(errno);
    return false;
  }
  const std::string content{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const std::size_t begin = kHead.size() + kHashDigits;
  const std::string_view whole = content;
  if (content.size() < begin || !whole.starts_with(kHead)) {
    trouble = path + ": is no file of this version";
    return false;
  }
  const std::string_view bytes = whole.substr(begin);
  const auto* data = reinterpret_cast<const std::uint8_t*>(bytes.data());
  if (sha256_hex(bytes) != whole.substr(kHead.size(), kHashDigits) ||
      !crux_msgs::decode_lcm({data, bytes.size()}, message)) {
    trouble = path + ": is damaged";
    return false;
  }
  return true;
}

/// What must not be kept late; the plan's time may be.
bool grips_the_same(const crux_msgs::restart_t& a, const crux_msgs::restart_t& b) {
  return a.plan_id == b.plan_id && a.supervisor_state == b.supervisor_state && a.fault.code == b.fault.code &&
         std::equal(std::begin(a.grips), std::end(a.grips), std::begin(b.grips));
}

}  // namespace

RestartKeeper::RestartKeeper(std::string folder, const RobotDescription& robot, RuntimeExchange& exchange)
    : folder_(std::move(folder)), robot_(robot), exchange_(exchange) {}

std::string RestartKeeper::default_folder(const std::array<std::string, kLimbs>& buses) {
  const std::string key = Identity::default_path();
  if (key.empty()) return "";
  std::string all;
  for (const std::string& bus : buses) all += bus + "\n";
  return (fs::path(key).parent_path() / ("restart-" + short_hash(all))).string();
}

std::optional<RestartKeeper::Left> RestartKeeper::find(std::string& trouble) const {
  Left left;
  if (folder_.empty() || !read_message(folder_ + kPointFile, left.point, trouble)) return std::nullopt;
  if (left.point.robot_sha256 != robot_.sha256) {
    trouble = folder_ + kPointFile + ": is of another robot description, " + left.point.robot_sha256;
    return std::nullopt;
  }
  if (!read_message(folder_ + kPlanFile, left.plan, trouble)) {
    if (trouble.empty()) trouble = folder_ + kPlanFile + ": is not there";
    return std::nullopt;
  }
  if (left.plan.plan_id != left.point.plan_id) {
    trouble = folder_ + kPlanFile + ": is plan " + left.plan.plan_id + ", climbed was " + left.point.plan_id;
    return std::nullopt;
  }
  Result<std::unique_ptr<const PreparedPlan>> prepared = prepare_plan(robot_, left.plan);
  if (!prepared) {
    trouble = folder_ + kPlanFile + ": " + prepared.reason();
    return std::nullopt;
  }
  left.prepared = std::move(prepared.value());
  return left;
}

void RestartKeeper::take_plan(const crux_msgs::plan_t& plan) {
  const std::lock_guard<std::mutex> lock(mutex_);
  new_plan_ = plan;
}

void RestartKeeper::retire() const {
  if (folder_.empty()) return;
  std::error_code none_there;
  fs::rename(folder_ + kPointFile, folder_ + kPointFile + kRetired, none_there);
}

void RestartKeeper::run(const std::atomic<bool>& ended) {
  for (bool last_round = false; !last_round; std::this_thread::sleep_for(kLooksEvery)) {
    last_round = ended.load(std::memory_order_acquire);
    keep();
  }
}

void RestartKeeper::keep() {
  if (folder_.empty()) return;
  keep_plan();
  const RestartPoint* newest = exchange_.restart.take();
  if (newest == nullptr || newest->left.plan_id.empty() || newest->left.plan_id != plan_id_) return;
  const bool stands = newest->left.interval == kept_.interval && newest->left.elapsed_s == kept_.elapsed_s;
  const double age_s = static_cast<double>(newest->cycle - kept_cycle_) / robot_.can.rate_Hz;
  if (grips_the_same(newest->left, kept_) && age_s < (stands ? kSameAgain_s : kAgain_s)) return;
  kept_cycle_ = newest->cycle;
  keep_point(newest->left);
}

/// The point of a plan follows the plan: a plan without a point is no restart.
void RestartKeeper::keep_plan() {
  std::optional<crux_msgs::plan_t> plan;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::swap(plan, new_plan_);
  }
  if (!plan) return;
  std::error_code error;
  if (fs::create_directories(folder_, error)) ::chmod(folder_.c_str(), S_IRWXU);
  const std::string trouble = write_message(folder_ + kPlanFile, *plan);
  if (!trouble.empty()) return fail(trouble);
  plan_id_ = plan->plan_id;
}

void RestartKeeper::keep_point(const crux_msgs::restart_t& point) {
  kept_ = point;
  kept_.robot_sha256 = robot_.sha256;
  const std::string trouble = write_message(folder_ + kPointFile, kept_);
  if (!trouble.empty()) fail(trouble);
}

void take_up(RestartKeeper& keeper, CycleLoop& loop, OperatorServer& server, RuntimeExchange& exchange) {
  std::string trouble;
  std::optional<RestartKeeper::Left> left = keeper.find(trouble);
  server.keep_plans([&keeper](const crux_msgs::plan_t& plan) { keeper.take_plan(plan); },
                    [&keeper] { keeper.retire(); }, left ? std::optional(left->plan) : std::nullopt);
  if (left) {
    auto entry = std::make_unique<LogEntry>();
    entry->acknowledgement.subject = crux_msgs::acknowledgement_t::PLAN;
    entry->acknowledgement.piece = -1;
    entry->acknowledgement.plan_id = left->plan.plan_id;
    entry->acknowledgement.reason = "of the run before";
    entry->restart = left->point;
    entry->plan = std::move(left->plan);
    return loop.restore(std::move(left->prepared), left->point, std::move(entry));
  }
  if (trouble.empty()) return;
  std::fprintf(stderr, "crux-runtime: %s\n", trouble.c_str());
  crux_msgs::fault_t* told = exchange.faults.back();
  *told = {};
  told->code = static_cast<std::int16_t>(FaultCode::kRestartRefused);
  told->limb = -1;
  exchange.faults.push();
}

void RestartKeeper::fail(const std::string& what) {
  if (std::exchange(trouble_, what) != what)  // not every few milliseconds
    std::fprintf(stderr, "crux-runtime: after a restart it will not know where the robot hangs: %s\n", what.c_str());
}

}  // namespace crux
