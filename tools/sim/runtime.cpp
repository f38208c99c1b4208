#include "runtime.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <deque>
#include <exception>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "app/cycle_loop.hpp"
#include "app/open_log.hpp"
#include "app/options.hpp"
#include "app/restart_keeper.hpp"
#include "core/robot/robot_reader.hpp"
#include "lcm/operator_server.hpp"
#include "memory_bus.hpp"
#include "telemetry/log_writer.hpp"

namespace {

using namespace crux;
using namespace std::chrono_literals;

constexpr const char* kInProcess = "memq://";  // LCM's own queue in memory: what is published comes back to subscribers
constexpr std::size_t kLogQueue = 1024;

constexpr int kNodeSlots = CRUX_SIM_JOINTS / CRUX_SIM_LIMBS;  // for joints of each limb among the nodes

/// Numbers of the plant's joints, `slots` for each limb, as the nodes have them; 0 behind those.
struct OfNodes {
  OfNodes(const double* of_plant, int slots) {
    for (std::ptrdiff_t l = 0; l < CRUX_SIM_LIMBS; ++l)
      std::copy_n(of_plant + l * slots, slots, values.begin() + l * kNodeSlots);
  }
  std::array<double, CRUX_SIM_JOINTS> values{};
};

int node_of(int joint) { return static_cast<int>(CRUX_CAN_NODE_OF_JOINT(static_cast<unsigned>(joint))); }

thread_local std::string last_error;

PerLimb<std::unique_ptr<Bus>> memory_buses(crux_nodes* nodes) {
  PerLimb<std::unique_ptr<Bus>> buses;
  for (int l = 0; l < kLimbs; ++l) buses[static_cast<std::size_t>(l)] = std::make_unique<sim::MemoryBus>(nodes, l);
  return buses;
}

Options options_of(std::span<const char* const> arguments) {
  Options options = parse_options(arguments);
  options.cycle.pace = Pace::kBus;
  for (const char* word : arguments)
    options.command_line += (options.command_line.empty() ? "" : " ") + std::string(word);
  return options;
}

RobotDescription robot_of(const Options& options) {
  Result<RobotDescription> loaded = load_robot((std::filesystem::path(options.robot) / "robot.yaml").string());
  if (!loaded) throw OptionError(loaded.reason());
  loaded.value().calibrates = options.calibrate;
  return std::move(loaded.value());
}

}  // namespace

struct crux_runtime {
  crux_runtime(crux_nodes* nodes, const Options& options);
  ~crux_runtime() { finish(); }
  crux_runtime(const crux_runtime&) = delete;
  crux_runtime& operator=(const crux_runtime&) = delete;

  void tell(const std::string& channel, std::span<const std::uint8_t> data);
  void serve();
  const std::string& finish();

  RobotDescription robot_;
  RuntimeExchange exchange_;
  SpscRing<CycleRecord> records_{kLogQueue};
  OperatorServer server_;
  LogWriter log_writer_;
  CycleLoop loop_;
  RestartKeeper keeper_;
  std::deque<std::vector<std::uint8_t>> to_operators_;
  std::vector<std::uint8_t> told_;  ///< the last one that crux_runtime_next gave

 private:
  std::atomic<bool> ended_{false};
  std::thread log_thread_;
};

crux_runtime::crux_runtime(crux_nodes* nodes, const Options& options)
    : robot_(robot_of(options)),
      server_(kInProcess, robot_, exchange_, CommandGate({}, unpredictable), {}, false),  // nobody else reaches it
      log_writer_(records_, open_log(options, robot_), exchange_.log_broken, options.log_frames),
      loop_(robot_, memory_buses(nodes), exchange_, records_, options.cycle),
      keeper_(options.state, robot_, exchange_),
      log_thread_([this] { log_writer_.run(ended_); }) {
  using Self = crux_runtime*;
  const auto keep = [](const lcm::ReceiveBuffer* buffer, const std::string&, Self self) {
    const auto* bytes = static_cast<const std::uint8_t*>(buffer->data);
    self->to_operators_.emplace_back(bytes, bytes + buffer->data_size);
  };
  take_up(keeper_, loop_, server_, exchange_);
  server_.link().subscribeFunction<Self>(crux_msgs::channel_info(crux_msgs::Channel::kAnswer).name, keep, this);
}

void crux_runtime::tell(const std::string& channel, std::span<const std::uint8_t> data) {
  server_.link().publish(channel, data.data(), static_cast<unsigned>(data.size()));
  serve();
}

void crux_runtime::serve() {
  // A round in which nothing comes in may still have put an answer into LCM's queue.
  for (int idle = 0; idle < 2;) idle = server_.serve(0ms) || loop_.serve() ? 0 : idle + 1;
}

const std::string& crux_runtime::finish() {
  if (log_thread_.joinable()) {
    const CycleReport report = loop_.finish();
    log_writer_.set_end(end_of(report));
    ended_.store(true, std::memory_order_release);
    log_thread_.join();
  }
  return log_writer_.error();
}

crux_runtime* crux_runtime_open(crux_nodes* nodes, std::int32_t count, const char* const arguments[]) {
  try {
    return new crux_runtime(nodes, options_of({arguments, static_cast<std::size_t>(count)}));
  } catch (const std::exception& error) {
    last_error = error.what();
    return nullptr;
  }
}

const char* crux_runtime_error() { return last_error.c_str(); }

std::int32_t crux_runtime_turn(crux_runtime* runtime) {
  const bool goes_on = runtime->loop_.turn();
  runtime->keeper_.keep();
  return goes_on ? 1 : 0;
}

void crux_runtime_tell(crux_runtime* runtime, const char* channel, const std::uint8_t* data, std::int32_t size) {
  runtime->tell(channel, {data, static_cast<std::size_t>(size)});
}

const std::uint8_t* crux_runtime_next(crux_runtime* runtime, std::int32_t* size) {
  if (runtime->to_operators_.empty()) runtime->serve();
  if (runtime->to_operators_.empty()) return nullptr;
  runtime->told_ = std::move(runtime->to_operators_.front());
  runtime->to_operators_.pop_front();
  *size = static_cast<std::int32_t>(runtime->told_.size());
  return runtime->told_.data();
}

const char* crux_runtime_finish(crux_runtime* runtime) { return runtime->finish().c_str(); }

void crux_runtime_close(crux_runtime* runtime) { delete runtime; }

void crux_sim_step(crux_nodes* nodes, crux_plant* plant, double dt_s) {
  const crux_plant_state& state = *crux_plant_state_of(plant);
  double torque_nm[CRUX_SIM_JOINTS], force_n[CRUX_SIM_LIMBS];
  const int slots = crux_plant_slots(plant);
  for (int j = 0; j < CRUX_SIM_LIMBS * slots; ++j)
    crux_plant_power_joint(plant, j, crux_nodes_supply(nodes, j / slots, node_of(j % slots)));
  for (int l = 0; l < CRUX_SIM_LIMBS; ++l)
    crux_plant_power_gripper(plant, l, crux_nodes_supply(nodes, l, CRUX_CAN_NODE_GRIPPER));
  crux_nodes_control(nodes, dt_s, OfNodes(state.joint_position_rad, slots).values.data(),
                     OfNodes(state.joint_velocity_rad_s, slots).values.data(), state.finger_opening_m,
                     state.finger_speed_m_s, state.finger_force_n, torque_nm, force_n);
  for (int l = 0; l < CRUX_SIM_LIMBS; ++l)
    std::copy_n(torque_nm + l * kNodeSlots, slots, torque_nm + l * slots);  // towards the front, from there on
  crux_plant_step(plant, torque_nm, force_n);
  const double* temperature_degc = crux_plant_temperature(plant);
  for (int j = 0; temperature_degc != nullptr && j < CRUX_SIM_LIMBS * slots; ++j)
    if (std::isfinite(temperature_degc[j]))
      crux_nodes_set_temperature(nodes, j / slots, node_of(j % slots), temperature_degc[j]);
}

std::int32_t crux_sim_publish(crux_nodes* nodes, crux_plant* plant) {
  const crux_plant_state& state = *crux_plant_state_of(plant);
  const int slots = crux_plant_slots(plant);
  return crux_nodes_publish(nodes, OfNodes(state.joint_position_rad, slots).values.data(),
                            OfNodes(state.joint_velocity_rad_s, slots).values.data(),
                            OfNodes(state.joint_torque_nm, slots).values.data(), state.finger_opening_m,
                            state.finger_speed_m_s, state.finger_force_n, state.ft);
}
