// What differs from plan and robot description while a climb runs: between the nodes' commands and the physics, and
// between the physics and the nodes' sensors.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "plant.h"

namespace crux::sim {

class World {
 public:
  /// @param seed of the samples that are lost
  World(mjModel& model, mjData& data, const crux_plant_map& map, const crux_world& world, std::uint64_t seed);

  /// What the motors of joints and fingers are told, after dead time, limits and lag.
  void command(std::span<double, CRUX_SIM_JOINTS> torque_nm, std::span<double, CRUX_SIM_LIMBS> finger_force_n);

  /// What the motors give of it, joints' friction and elasticity, jammed fingers, holds that break, pushes. Call it
  /// with all of `data.ctrl` set, before the step.
  void act(double time_s, bool hand_is_gone);

  /// Heat of the motors by the torque they were told [Nm].
  void heat(std::span<const double, CRUX_SIM_JOINTS> torque_nm);

  /// What the sensors say in place of the true readings in `state`.
  void sense(double time_s, crux_plant_state& state);

  /// [degC], of each joint; NaN: not known here. Empty when none is.
  [[nodiscard]] std::span<const double> temperature() const;

 private:
  static constexpr std::size_t kMaxDeadCycles = 16;

  struct Fault {
    crux_sensor_error what;
    std::array<double, 6> last{};
    double last_rate = 0.0;
    bool has_last = false;
  };

  void stick();
  void spring();
  void jam(double time_s);
  void break_holds(double time_s);
  void push(double time_s);
  [[nodiscard]] double load_n(int body) const;
  [[nodiscard]] std::size_t joints() const { return CRUX_SIM_LIMBS * static_cast<std::size_t>(map_.slots); }
  void spoil(Fault& fault, double time_s, std::span<double> channels, double* rate);
  void repeat(Fault& fault, bool on, std::span<double> channels, double& speed);

  mjModel& model_;
  mjData& data_;
  const crux_plant_map& map_;
  const crux_world world_;
  std::array<double, CRUX_SIM_JOINTS> friction_nm_{}, lagged_nm_{}, temperature_degc_{};
  std::array<std::array<double, CRUX_SIM_JOINTS>, kMaxDeadCycles + 1> past_nm_{};
  std::size_t now_ = 0;
  bool warms_ = false;
  std::array<double, CRUX_SIM_LIMBS> opening_m_{};
  std::array<bool, CRUX_SIM_LIMBS> jammed_{};
  std::vector<bool> broken_;
  std::vector<Fault> faults_;
  std::mt19937_64 random_;
};

}  // namespace crux::sim
