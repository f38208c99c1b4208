#include "world.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace crux::sim {
namespace {

constexpr double kStandingSpeed_rad_s = 0.01;  // stiction fades around this speed
constexpr double kJamForce_N = 1e4;

double opening(const mjData& data, const crux_plant_map& map, std::size_t limb) {
  return (data.qpos[map.finger_qpos[2 * limb]] + data.qpos[map.finger_qpos[2 * limb + 1]]) / 2;
}

}  // namespace

World::World(mjModel& model, mjData& data, const crux_plant_map& map, const crux_world& world, std::uint64_t seed)
    : model_(model),
      data_(data),
      map_(map),
      world_(world),
      broken_(static_cast<std::size_t>(world.breaks_count), false),
      random_(seed + 1) {
  for (std::size_t j = 0; j < joints(); ++j) {
    friction_nm_[j] = model.dof_frictionloss[map.driven_dof[j]];
    const bool warms = world.heating_k_nm2[j] > 0;
    temperature_degc_[j] = warms ? world.ambient_degc : std::numeric_limits<double>::quiet_NaN();
    warms_ = warms_ || warms;
  }
  for (std::size_t l = 0; l < CRUX_SIM_LIMBS; ++l) opening_m_[l] = opening(data, map, l);
  const std::span errors(world.sensor_errors, static_cast<std::size_t>(world.sensor_errors_count));
  for (const crux_sensor_error& error : errors) faults_.push_back({.what = error});
}

void World::command(std::span<double, CRUX_SIM_JOINTS> torque_nm, std::span<double, CRUX_SIM_LIMBS> finger_force_n) {
  std::ranges::copy(torque_nm, past_nm_[now_].begin());
  for (std::size_t j = 0; j < joints(); ++j) {
    const auto dead = static_cast<std::size_t>(world_.dead_cycles[j]);
    const double told_nm = past_nm_[(now_ + past_nm_.size() - dead) % past_nm_.size()][j];
    const double limit_nm = world_.torque_limit_nm[j];
    lagged_nm_[j] = std::lerp(lagged_nm_[j], std::clamp(told_nm, -limit_nm, limit_nm), world_.torque_share[j]);
    torque_nm[j] = lagged_nm_[j];
  }
  now_ = (now_ + 1) % past_nm_.size();
  for (std::size_t l = 0; l < CRUX_SIM_LIMBS; ++l)
    finger_force_n[l] = std::clamp(finger_force_n[l], -world_.finger_force_limit_n[l], world_.finger_force_limit_n[l]);
}

void World::act(double time_s, bool hand_is_gone) {
  for (std::size_t j = 0; j < joints(); ++j) data_.ctrl[map_.joint_actuators[j]] *= world_.torque_factor[j];
  for (std::size_t p = 0; p < CRUX_SIM_PADS; ++p)
    data_.ctrl[map_.finger_actuators[p]] *= world_.finger_force_factor[p / 2];
  stick();
  spring();
  jam(time_s);
  break_holds(time_s);
  if (hand_is_gone) push(time_s);
}

void World::stick() {
  for (std::size_t j = 0; j < joints(); ++j) {
    if (world_.stiction_nm[j] <= 0) continue;
    const double speed = data_.qvel[map_.driven_dof[j]] / kStandingSpeed_rad_s;
    model_.dof_frictionloss[map_.driven_dof[j]] = friction_nm_[j] + world_.stiction_nm[j] * std::exp(-speed * speed);
  }
}

/// Explicit, as stiffness in MuJoCo is: steps of 2 ms bear it up to the stiffness that a world file may give.
void World::spring() {
  for (std::size_t j = 0; j < joints(); ++j) {
    if (world_.play_dof[j] < 0) continue;
    const double angle = data_.qpos[world_.play_qpos[j]], half = world_.half_play_rad[j];
    data_.qfrc_applied[world_.play_dof[j]] = world_.stiffness_nm_rad[j] * (std::clamp(angle, -half, half) - angle);
  }
}

void World::jam(double time_s) {
  for (std::size_t l = 0; l < CRUX_SIM_LIMBS; ++l) {
    const double before_m = opening_m_[l], at_m = world_.jam_m[l];
    opening_m_[l] = opening(data_, map_, l);
    const bool there = std::isnan(at_m) || (before_m <= at_m) == (at_m <= opening_m_[l]);
    if (jammed_[l] || time_s < world_.jam_s[l] || !there) continue;
    jammed_[l] = true;
    for (std::size_t p = 2 * l; p < 2 * l + 2; ++p) model_.dof_frictionloss[map_.finger_dof[p]] = kJamForce_N;
  }
}

void World::break_holds(double time_s) {
  for (std::size_t b = 0; b < broken_.size(); ++b) {
    const crux_hold_break& hold = world_.breaks[b];
    if (broken_[b] || (time_s < hold.at_s && !(std::isfinite(hold.load_n) && load_n(hold.body) > hold.load_n)))
      continue;
    broken_[b] = true;
    model_.body_pos[3 * static_cast<std::size_t>(hold.body) + 2] = world_.gone_m;
  }
}

/// Of all contacts together: a squeeze between two faces is no load on what fixes the hold.
double World::load_n(int body) const {
  double sum[3] = {0, 0, 0};
  for (int c = 0; c < data_.ncon; ++c) {
    const mjContact& contact = data_.contact[c];
    const bool first = model_.geom_bodyid[contact.geom[0]] == body;
    if (!first && model_.geom_bodyid[contact.geom[1]] != body) continue;
    double wrench[6], force[3];
    mj_contactForce(&model_, &data_, c, wrench);
    mju_mulMatTVec(force, contact.frame, wrench, 3, 3);
    mju_addToScl3(sum, force, first ? -1.0 : 1.0);
  }
  return mju_norm3(sum);
}

void World::push(double time_s) {
  if (world_.pushes_count == 0) return;
  double* applied = data_.xfrc_applied + 6 * static_cast<std::size_t>(map_.body);
  std::fill_n(applied, 6, 0.0);
  for (const crux_push& push : std::span(world_.pushes, static_cast<std::size_t>(world_.pushes_count)))
    if (time_s >= push.from_s && time_s < push.until_s) mju_addTo(applied, push.wrench_w, 6);
}

void World::heat(std::span<const double, CRUX_SIM_JOINTS> torque_nm) {
  if (!warms_) return;
  for (std::size_t j = 0; j < joints(); ++j) {
    const double rise = world_.heating_k_nm2[j] * torque_nm[j] * torque_nm[j];
    const double share = std::min(1.0, model_.opt.timestep / world_.heating_time_s[j]);
    temperature_degc_[j] += share * (world_.ambient_degc + rise - temperature_degc_[j]);
  }
}

std::span<const double> World::temperature() const {
  return warms_ ? std::span<const double>(temperature_degc_).first(joints()) : std::span<const double>();
}

void World::sense(double time_s, crux_plant_state& state) {
  for (Fault& fault : faults_) {
    const auto place = static_cast<std::size_t>(fault.what.place);
    switch (fault.what.sensor) {
      case CRUX_FORCE_TORQUE:
        spoil(fault, time_s, std::span(state.ft + 6 * place, 6), nullptr);
        break;
      case CRUX_ENCODER:
        spoil(fault, time_s, std::span(state.joint_position_rad + place, 1), state.joint_velocity_rad_s + place);
        break;
      case CRUX_FINGER_OPENING:
        spoil(fault, time_s, std::span(state.finger_opening_m + place, 1), state.finger_speed_m_s + place);
        break;
      default:
        spoil(fault, time_s, std::span(state.finger_force_n + place, 1), nullptr);
        break;
    }
  }
}

/// `rate`: the reading's derivative, of sensors of one channel that have it.
void World::spoil(Fault& fault, double time_s, std::span<double> channels, double* rate) {
  const crux_sensor_error& what = fault.what;
  const bool on = time_s >= what.from_s && time_s < what.until_s;
  double no_rate = 0.0;
  double& speed = rate != nullptr ? *rate : no_rate;
  const bool freezes = what.fault == CRUX_FREEZE;
  if (!on || freezes || what.fault == CRUX_DROPOUT) {
    repeat(fault, on, channels, speed);
    if (on && freezes) speed = 0.0;
    return;
  }
  constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
  double shares = 0.0;  // of the range, all channels together
  if (what.fault == CRUX_CROSS_TALK)
    for (std::size_t i = 0; i < channels.size(); ++i) shares += channels[i] / world_.ft_range[i];
  for (std::size_t i = 0; i < channels.size(); ++i) {
    double& reading = channels[i];
    const double value = what.value[i];
    switch (what.fault) {
      case CRUX_BIAS:
      case CRUX_JUMP:
        reading += value;
        break;
      case CRUX_DRIFT:
        reading += value * (time_s - what.from_s);
        speed += value;
        break;
      case CRUX_SATURATION:
        reading = std::clamp(reading, -value, value);
        break;
      case CRUX_SCALE:
        reading *= what.value[0];
        speed *= what.value[0];
        break;
      case CRUX_CROSS_TALK:
        reading += what.value[0] * (world_.ft_range[i] * shares - reading);
        break;
      default:
        reading = speed = what.fault == CRUX_ZERO ? 0.0 : kNoNumber;
        break;
    }
  }
}

/// While `on`, the last sample in place of this one where that is lost or the sensor frozen; else this is the last.
void World::repeat(Fault& fault, bool on, std::span<double> channels, double& speed) {
  const bool lost =
      on && fault.has_last &&
      (fault.what.fault == CRUX_FREEZE || std::uniform_real_distribution<double>{}(random_) < fault.what.value[0]);
  if (lost) {
    std::copy_n(fault.last.begin(), channels.size(), channels.begin());
    speed = fault.last_rate;
  } else {
    std::ranges::copy(channels, fault.last.begin());
    fault.last_rate = speed;
    fault.has_last = true;
  }
}

}  // namespace crux::sim
