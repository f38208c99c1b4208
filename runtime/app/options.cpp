#include "app/options.hpp"

#include <algorithm>
#include <charconv>
#include <string_view>

#include "app/restart_keeper.hpp"
#include "bus/bus.hpp"
#include "core/robot/reason.hpp"

namespace crux {
namespace {

constexpr std::string_view kDefaultBusBase = "udp:239.74.163.2:43113";
constexpr std::string_view kNoState = "none";
constexpr double kMaxGuardTime_s = 3600.0;
constexpr double kMaxIdleLogs_GB = 1e5;

void set_bus(Options& options, const std::string& value) {
  const std::size_t equals = value.find('=');
  const auto limb = std::ranges::find(kLimbNames, std::string_view(value).substr(0, equals));
  if (equals == std::string::npos || limb == kLimbNames.end())
    throw OptionError("--bus '" + value +
                      "': right is LIMB=NAME with LIMB one of LF, RF, LR, RR, for example LF=socketcan:can0");
  options.buses[static_cast<std::size_t>(limb - kLimbNames.begin())] = value.substr(equals + 1);
}

Pace parse_pace(const std::string& value) {
  if (value == "bus") return Pace::kBus;
  if (value == "clock") return Pace::kClock;
  throw OptionError("--pace '" + value + "': right is bus (lockstep) or clock (real time)");
}

CommandFrames parse_commands(const std::string& value) {
  if (value == "each") return CommandFrames::kEachNode;
  if (value == "broadcast") return CommandFrames::kBroadcast;
  throw OptionError("--commands '" + value + "': right is each (a frame a node) or broadcast (one for all)");
}

std::chrono::nanoseconds parse_guard_time(const std::string& value) {
  double seconds = 0.0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), seconds);
  if (error != std::errc{} || end != value.data() + value.size() || !(seconds > 0.0) || seconds > kMaxGuardTime_s)
    throw OptionError("--guard-time '" + value + "': right is a number of seconds above 0, at most 3600");
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(seconds));
}

std::uintmax_t parse_gigabytes(const std::string& value) {
  double gigabytes = 0.0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), gigabytes);
  if (error != std::errc{} || end != value.data() + value.size() || !(gigabytes > 0.0) || gigabytes > kMaxIdleLogs_GB)
    throw OptionError("--idle-logs '" + value + "': right is a number of GB above 0, at most 100000");
  return static_cast<std::uintmax_t>(1e9 * gigabytes);
}

void add_tag(Options& options, const std::string& value) {
  const std::size_t equals = value.find('=');
  if (equals == 0 || equals == std::string::npos)
    throw OptionError("--tag '" + value + "': right is KEY=VALUE, for example --tag seed=7");
  options.tags.emplace_back(value.substr(0, equals), value.substr(equals + 1));
}

void complete_buses(Options& options) {
  const auto missing = std::ranges::find(options.buses, std::string());
  if (missing == options.buses.end()) return;
  if (std::ranges::all_of(options.buses, [](const std::string& bus) { return bus.empty(); })) {
    options.buses = consecutive_udp_buses(kDefaultBusBase);
    return;
  }
  throw OptionError("--bus: limb " +
                    std::string(kLimbNames[static_cast<std::size_t>(missing - options.buses.begin())]) +
                    " has no bus; give all four or none");
}

/// A robot has a state; a simulation in lockstep only where it is asked for.
void complete_state(Options& options) {
  if (options.state.empty() && options.cycle.pace == Pace::kClock)
    options.state = RestartKeeper::default_folder(options.buses);
  if (options.state == kNoState) options.state.clear();
}

void check_authority(const Options& options) {
  if (options.keys.empty() == options.insecure) return;
  if (options.insecure) throw OptionError("--insecure: with --keys none but their owners command; give one of the two");
  throw OptionError(
      "--keys FILE is missing: who may command this robot? `crux key new` makes a key and says how it gets into FILE; "
      "for tests and simulations --insecure lets everybody command who reaches LCM");
}

}  // namespace

Options parse_options(std::span<const char* const> arguments) {
  Options options;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::string name = arguments[i];
    if (name == "--help" || name == "-h") {
      options.help = true;
      return options;
    }
    if (name == "--version") {
      options.version = true;
      return options;
    }
    const std::array<std::pair<std::string_view, bool*>, 5> switches = {{{"--check", &options.check},
                                                                         {"--overwrite", &options.overwrite},
                                                                         {"--insecure", &options.insecure},
                                                                         {"--log-frames", &options.log_frames},
                                                                         {"--calibrate", &options.calibrate}}};
    if (const auto* given = std::ranges::find(switches, name, &std::pair<std::string_view, bool*>::first);
        given != switches.end()) {
      *given->second = true;
      continue;
    }
    constexpr std::array<std::string_view, 14> kNames = {
        "--robot", "--bus",        "--bus-base", "--commands", "--pace",      "--keys",     "--lcm",
        "--log",   "--guard-time", "--tag",      "--note",     "--idle-logs", "--identity", "--state"};
    if (std::ranges::find(kNames, name) == kNames.end())
      throw OptionError("unknown option '" + name + "'; --help lists them");
    if (++i == arguments.size()) throw OptionError(name + " needs a value; --help says which");
    const std::string value = arguments[i];
    if (name == "--robot") options.robot = value;
    if (name == "--bus") set_bus(options, value);
    if (name == "--bus-base") options.buses = consecutive_udp_buses(value);
    if (name == "--commands") options.cycle.commands = parse_commands(value);
    if (name == "--pace") options.cycle.pace = parse_pace(value);
    if (name == "--keys") options.keys = value;
    if (name == "--identity") options.identity = value;
    if (name == "--state") options.state = value;
    if (name == "--lcm") options.lcm_url = value;
    if (name == "--log") options.log = value;
    if (name == "--tag") add_tag(options, value);
    if (name == "--note") options.tags.emplace_back("note", value);
    if (name == "--idle-logs") options.idle_log_bytes = parse_gigabytes(value);
    if (name == "--guard-time") options.cycle.guard_time = parse_guard_time(value);
  }
  if (options.check) return options;
  if (options.idle_log_bytes > 0 && (options.log.empty() || options.cycle.pace == Pace::kBus))
    throw OptionError("--idle-logs goes with --log and --pace clock: a simulation has one log");
  complete_buses(options);
  check_authority(options);
  complete_state(options);
  return options;
}

const char* usage() {
  return R"(crux-runtime: controls the robot. Reads the nodes over four CAN buses, takes plans and commands over LCM.

usage: crux-runtime [options]
  --robot DIR       folder with robot.yaml and the URDF it names       (msgs/robots/scaler)
  --check           check that description and exit; needs no keys
  --bus LIMB=NAME   the bus of LF, RF, LR or RR; four times            NAME: socketcan:can0 or udp:GROUP:PORT
  --bus-base NAME   four UDP buses on consecutive ports                (udp:239.74.163.2:43113)
  --commands HOW    each: one frame for each node and a Sync;
                    broadcast: one for a whole bus, for 1 kHz          (each)
  --pace PACE       clock: real time; bus: lockstep, a cycle follows
                    when all nodes have answered the one before        (clock)
  --guard-time S    pace bus: how long to wait for an answer           (1)
  --calibrate       tune the admittance gains while climbing           (fixed, as in robot.yaml)
  --lcm URL         where operators reach it                           (udpm://239.255.76.67:7667?ttl=0)
  --keys FILE       who may command it, one key a line: KEY ROLE NAME;
                    commands must be signed (crux key)                 (this or --insecure)
  --identity FILE   its own private key, which signs its answers;      (runtime.pem in $STATE_DIRECTORY or
                    created if missing                                  ~/.local/state/crux)
  --state DIR       keep where the robot hangs in DIR, for the next    (a folder for these buses beside the
                    run to go on from there; none: keep nothing         key; none in pace bus)
  --insecure        accept commands from anyone who reaches LCM:
                    for tests and the simulation
  --log FILE        log every cycle as MCAP; an existing FILE is kept,
                    and the new log gets a number                      (none)
  --idle-logs GB    limit the logs in which nothing climbs: they are
                    called .idle, the oldest are deleted beyond GB     (one log)
  --overwrite       replace an existing log
  --log-frames      log the CAN frames of every cycle, not only around
                    faults
  --note TEXT       note to store in the log; crux log ls and crux report
                    show it
  --tag KEY=VALUE   metadata to store in the log; may be repeated
  --version         print version and commit
  --help            print this

SIGINT and SIGTERM: the nodes are told to hold, the log is finished, exit 0.
exit status: 0 ended on request; 1 the log is incomplete; 2 wrong usage, robot description, keys, bus or LCM
)";
}

}  // namespace crux
