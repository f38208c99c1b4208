#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "app/claim.hpp"
#include "app/cycle_loop.hpp"
#include "app/log_files.hpp"
#include "app/open_log.hpp"
#include "app/options.hpp"
#include "app/realtime.hpp"
#include "app/restart_keeper.hpp"
#include "core/robot/robot_reader.hpp"
#include "lcm/operator_server.hpp"
#include "telemetry/log_writer.hpp"

namespace {

using namespace crux;

constexpr int kDone = 0, kFailed = 1, kWrongUsage = 2;
constexpr std::size_t kLogQueue = 1024;  // cycles: two seconds in real time

std::atomic<bool>* g_stop = nullptr;  // what a signal handler can reach

void on_signal(int) { g_stop->store(true, std::memory_order_release); }

/// Signals go to this thread alone: its waits are the ones to be cut short.
void handle_signals(std::atomic<bool>& stop) {
  g_stop = &stop;
  struct sigaction action{};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGXFSZ, SIG_IGN);  // a log as long as files may become ends the log, not the control
}

class SignalsBlocked {
 public:
  SignalsBlocked() {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals, &before_);
  }
  ~SignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  SignalsBlocked(const SignalsBlocked&) = delete;
  SignalsBlocked& operator=(const SignalsBlocked&) = delete;

 private:
  sigset_t before_{};
};

/// A thread that is told to end, and joined, when the scope ends.
class Worker {
 public:
  template <class Task>
  explicit Worker(Task& task) : thread_([this, &task] { task.run(ended_); }) {}
  ~Worker() {
    ended_.store(true, std::memory_order_release);
    thread_.join();
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

 private:
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

void print_report(const CycleReport& report, const CycleLoop& loop) {
  const auto line = [](const char* what, std::uint64_t n) {
    if (n > 0) std::fprintf(stderr, "crux-runtime: %llu %s\n", static_cast<unsigned long long>(n), what);
  };
  line("cycles not answered by all nodes within the guard time", static_cast<std::uint64_t>(report.unanswered));
  line("cycles began more than a period late", static_cast<std::uint64_t>(report.missed_deadlines));
  line("cycles are missing in the log, its queue was full", static_cast<std::uint64_t>(report.dropped_records));
  LimbStatistics limbs;
  BusStatistics buses;
  for (const LimbBus& limb : loop.limbs()) limbs += limb.statistics();
  for (const auto& bus : loop.buses()) buses += bus->statistics();
  line("frames with a wrong CRC", limbs.crc_errors);
  line("frames repeated", limbs.repeated);
  line("frames lost", limbs.lost);
  line("frames of the wrong size", limbs.wrong_size);
  line("frames with unknown identifiers", limbs.unknown);
  line("frames of nodes that are not listened to", limbs.distrusted);
  line("frames of a second sender under a node's number", limbs.rivals);
  line("malformed frames or datagrams", buses.malformed);
  line("error frames of CAN controllers", buses.error_frames);
  line("times a CAN controller left its bus", buses.bus_off);
  line("times a CAN interface went down", buses.interface_down);
  line("frames dropped by the kernel, not fetched in time", buses.receive_lost);
  line("frames that could not be sent", buses.send_failed);
  line("frames of another host", limbs.foreign);
}

/// Operators who know it take it for the same runtime; whoever sets them up finds the public half here.
Identity identity_of(const Options& options) {
  std::string trouble;
  Identity identity =
      Identity::of_file(options.identity.empty() ? Identity::default_path() : options.identity, trouble);
  if (!trouble.empty())
    std::fprintf(stderr,
                 "crux-runtime: its own key is for this run alone, and operators will miss the one they know: %s\n",
                 trouble.c_str());
  if (!options.insecure) std::fprintf(stderr, "crux-runtime: its own key is %s\n", hex_of(identity.key()).c_str());
  return identity;
}

int run(const Options& options) {
  Result<RobotDescription> loaded = load_robot((std::filesystem::path(options.robot) / "robot.yaml").string());
  if (!loaded) throw OptionError(loaded.reason());
  if (options.check) {
    const RobotDescription& read = loaded.value();
    std::printf("%s: robot %s, %.3g kg, %s\n", options.robot.c_str(), read.name.c_str(), read.total_mass_kg,
                read.sha256.c_str());
    return kDone;
  }
  loaded.value().calibrates = options.calibrate;
  const RobotDescription& robot = loaded.value();
  CommandGate gate(options.insecure ? std::vector<AuthorizedKey>() : read_keys(options.keys), unpredictable);
  std::vector<Claim> claims;  // until the end: no second runtime on the same LCM address or bus
  if (!options.lcm_url.starts_with("memq:")) claims.emplace_back(options.lcm_url);
  for (const std::string& bus : options.buses) claims.emplace_back(bus);
  PerLimb<std::unique_ptr<Bus>> buses;
  for (std::size_t l = 0; l < buses.size(); ++l) buses[l] = open_bus(options.buses[l]);

  RuntimeExchange exchange;
  SpscRing<CycleRecord> records(kLogQueue);
  OperatorServer server(options.lcm_url, robot, exchange, std::move(gate), identity_of(options));
  const bool must_log = options.cycle.pace == Pace::kBus;  // a robot on the wall gets its runtime without a log, too
  LogFiles log_files(options, robot);
  LogWriter log_writer(records, must_log ? open_log(options, robot) : nullptr, exchange.log_broken, options.log_frames);
  if (!must_log && !options.log.empty())
    log_writer.take_logs_from(log_files, exchange.new_cores, [&robot] { return std::make_unique<ControlCore>(robot); });
  const auto loop = std::make_unique<CycleLoop>(robot, std::move(buses), exchange, records, options.cycle);
  RestartKeeper keeper(options.state, robot, exchange);
  take_up(keeper, *loop, server, exchange);
  handle_signals(exchange.stop);
  if (options.insecure)
    std::fprintf(stderr, "crux-runtime: INSECURE: whoever reaches LCM at %s commands the robot\n",
                 options.lcm_url.c_str());
  CycleReport report;
  {
    auto blocked = std::make_unique<SignalsBlocked>();  // the workers inherit it
    const Worker log_worker(log_writer);
    const Worker server_worker(server);
    const Worker restart_worker(keeper);
    blocked.reset();
    if (options.cycle.pace == Pace::kClock) {
      if (const std::string refused = become_realtime(); !refused.empty())
        std::fprintf(stderr, "crux-runtime: not in real time: %s\n", refused.c_str());
    }
    report = loop->run();
    log_writer.set_end(end_of(report));
  }
  print_report(report, *loop);
  return log_writer.error().empty() ? kDone : kFailed;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    Options options = parse_options({argv + 1, static_cast<std::size_t>(std::max(argc - 1, 0))});
    for (int i = 0; i < argc; ++i) options.command_line += (i > 0 ? " " : "") + std::string(argv[i]);
    if (options.help) return std::fputs(usage(), stdout), kDone;
    if (options.version) return std::printf("crux-runtime %s\n", version().c_str()), kDone;
    return run(options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "crux-runtime: %s\n", error.what());
    return kWrongUsage;
  }
}
