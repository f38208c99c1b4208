// The command line of crux-runtime.
#pragma once

#include <array>
#include <chrono>
#include <span>
#include <stdexcept>
#include <string>

#include "app/cycle_loop.hpp"
#include "telemetry/mcap_log.hpp"

namespace crux {

/// A wrong command line; the message says which option, which value and what would be right.
class OptionError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct Options {
  bool help = false;
  bool version = false;
  bool check = false;                        ///< read the robot's description only
  std::string robot = "msgs/robots/scaler";  ///< folder with robot.yaml
  std::array<std::string, kLimbs> buses;     ///< by limb, in the order LF, RF, LR, RR
  std::string lcm_url = "udpm://239.255.76.67:7667?ttl=0";
  std::string keys;       ///< file of those who may command; empty: whoever reaches LCM, with `insecure` alone
  bool insecure = false;  ///< no keys
  std::string state;      ///< folder for what the next run needs; empty: none
  std::string identity;   ///< file of the runtime's own key; empty: where it is without being told
  std::string log;        ///< empty: none
  std::uintmax_t idle_log_bytes = 0;  ///< of logs without a climb, which are ended and deleted; 0: one log, never
  bool overwrite = false;             ///< a log that is there already
  bool log_frames = false;            ///< CAN frames of every cycle
  bool calibrate = false;             ///< the admittance's gains
  Metadata tags;                      ///< what the log is to say of itself besides
  std::string command_line;
  CycleOptions cycle{Pace::kClock, std::chrono::seconds(1)};
};

/// @throws OptionError
Options parse_options(std::span<const char* const> arguments);

const char* usage();

}  // namespace crux
