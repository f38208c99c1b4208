#include "plant.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <new>
#include <optional>
#include <random>
#include <span>
#include <vector>

#include "screws.hpp"
#include "world.hpp"

namespace {

// A hand carries the body until the nodes and the runtime stand: a stiff spring that releases smoothly.
constexpr double kHandStiffness_N_m = 1e5, kHandStiffness_Nm_rad = 1e3;
constexpr double kHandDamping_Ns_m = 2e3, kHandDamping_Nms_rad = 40.0;
constexpr double kHandReleases_s[2] = {0.5, 1.5};
constexpr std::int64_t kFirstContactStep = 2;  // the step of cycle 0 is the first
constexpr std::size_t kFirstSamples = 8192;

enum class Supply : std::int32_t { kPowered, kBraked, kFree };  // crux_supply

double smoothstep(double x) {
  x = std::clamp(x, 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

}  // namespace

const std::int32_t crux_plant_contact_period = 5;

struct crux_plant {
  crux_plant(mjModel* model, mjData* data, const crux_plant_map& map, const crux_plant_settings& settings,
             const crux_world* world, crux_plant_state& state);
  void step(const double* joint_torque_nm, const double* finger_force_n);
  void power_joint(std::size_t joint, Supply supply);
  void power_gripper(std::size_t limb, Supply supply);
  void record(std::int64_t cycle, std::int32_t climbing);

  mjModel* model_;
  mjData* data_;
  crux_plant_map map_;
  crux_plant_settings settings_;
  std::array<double, CRUX_SIM_JOINTS> torque_share_;
  crux::sim::Screws screws_;
  std::optional<crux::sim::World> world_;
  crux_plant_state& state_;
  std::vector<crux_plant_truth> truth_;
  double carried_until_s_ = 0.0;  ///< at least
  std::array<Supply, CRUX_SIM_JOINTS> supply_{};
  std::array<bool, CRUX_SIM_LIMBS> gripper_off_{};

 private:
  void carry();
  void read_sensors();
  void look_at_contacts();
  void take_contact(const mjContact& contact);
  void read_encoders();
  double normal() { return normal_(random_); }
  [[nodiscard]] std::size_t joints() const { return CRUX_SIM_LIMBS * static_cast<std::size_t>(map_.slots); }
  [[nodiscard]] bool hand_is_gone() const {
    return time_s() > carried_until_s_ + kHandReleases_s[1] + model_->opt.timestep;
  }
  [[nodiscard]] double time_s() const { return static_cast<double>(state_.cycle) * model_->opt.timestep; }

  std::mt19937_64 random_;
  std::mt19937_64 encoder_random_;
  std::normal_distribution<double> normal_, encoder_normal_;
  std::array<double, CRUX_SIM_WRENCHES> ft_bias_{};
  std::array<double, 3> hand_position_{};
  std::int64_t cycle_ = -1;  ///< of the runtime, when record() was called last
};

crux_plant::crux_plant(mjModel* model, mjData* data, const crux_plant_map& map, const crux_plant_settings& settings,
                       const crux_world* world, crux_plant_state& state)
    : model_(model),
      data_(data),
      map_(map),
      settings_(settings),
      screws_(*model, map_, settings.screw_middle, settings.screw_width),
      state_(state),
      random_(settings.seed),
      encoder_random_(settings.seed + 2) {
  state_ = {};
  torque_share_.fill(settings.torque_share);
  for (std::size_t i = 0; i < ft_bias_.size(); ++i) ft_bias_[i] = settings.ft_bias[i % 6] * normal();
  std::copy_n(data->qpos, 3, hand_position_.begin());
  truth_.reserve(kFirstSamples);
  if (world != nullptr) world_.emplace(*model, *data, map_, *world, settings.seed);
  look_at_contacts();
  read_sensors();
}

void crux_plant::step(const double* joint_torque_nm, const double* finger_force_n) {
  std::array<double, CRUX_SIM_JOINTS> told_nm{};
  std::array<double, CRUX_SIM_LIMBS> told_n;
  if (world_) {
    std::copy_n(joint_torque_nm, joints(), told_nm.begin());
    std::copy_n(finger_force_n, told_n.size(), told_n.begin());
    world_->command(told_nm, told_n);
    joint_torque_nm = told_nm.data();
    finger_force_n = told_n.data();
  }
  for (std::size_t j = 0; j < joints(); ++j) {
    state_.joint_torque_nm[j] += torque_share_[j] * (joint_torque_nm[j] - state_.joint_torque_nm[j]);
    if (supply_[j] != Supply::kPowered) state_.joint_torque_nm[j] = 0.0;
    data_->ctrl[map_.joint_actuators[j]] = state_.joint_torque_nm[j];
  }
  for (std::size_t l = 0; l < CRUX_SIM_LIMBS; ++l) {
    const double squeeze_n = 0.5 * (state_.pad_force_n[2 * l] + state_.pad_force_n[2 * l + 1]);
    if (!gripper_off_[l]) screws_.press(l, finger_force_n[l], squeeze_n);
  }
  for (std::size_t p = 0; p < CRUX_SIM_PADS; ++p)
    data_->ctrl[map_.finger_actuators[p]] = -(finger_force_n[p / 2] + screws_.set(p, state_.pad_force_n[p]));
  std::copy_n(finger_force_n, CRUX_SIM_LIMBS, state_.finger_force_n);
  carry();
  if (world_) {
    world_->act(time_s(), hand_is_gone());
    world_->heat(state_.joint_torque_nm);
  }
  mj_step(model_, data_);
  ++state_.cycle;
  if (screws_.any() || state_.cycle % crux_plant_contact_period == kFirstContactStep) look_at_contacts();
  read_sensors();
}

void crux_plant::power_joint(std::size_t joint, Supply supply) {
  if (supply_[joint] == supply) return;
  const auto idles = [](Supply at) { return at == Supply::kPowered ? 0.0 : 1.0; };
  const auto brakes = [](Supply at) { return at == Supply::kBraked ? 1.0 : 0.0; };
  const double friction_nm = settings_.idle_friction_nm * (idles(supply) - idles(supply_[joint]));
  const double damping_nms_rad = settings_.braking_nms_rad * (brakes(supply) - brakes(supply_[joint]));
  if (map_.tendon[joint] >= 0) {
    model_->tendon_frictionloss[map_.tendon[joint]] += friction_nm;
    model_->tendon_damping[map_.tendon[joint]] += damping_nms_rad;
  } else {
    const double ratio = map_.ratio[joint];
    model_->dof_frictionloss[map_.driven_dof[joint]] += std::abs(ratio) * friction_nm;
    model_->dof_damping[map_.driven_dof[joint]] += ratio * ratio * damping_nms_rad;
  }
  supply_[joint] = supply;
}

void crux_plant::power_gripper(std::size_t limb, Supply supply) {
  gripper_off_[limb] = supply != Supply::kPowered;
  if (gripper_off_[limb]) screws_.lock(limb);
}

void crux_plant::carry() {
  if (hand_is_gone()) return;
  const double since_s = time_s() - carried_until_s_;
  const double share = 1 - smoothstep((since_s - kHandReleases_s[0]) / (kHandReleases_s[1] - kHandReleases_s[0]));
  double turn[9];  // hand <- body
  mju_mulMatMatT(turn, settings_.hand_rotation, data_->xmat + 9 * map_.body, 3, 3, 3);
  const std::array<double, 3> axis{(turn[7] - turn[5]) / 2, (turn[2] - turn[6]) / 2, (turn[3] - turn[1]) / 2};
  double* push = data_->xfrc_applied + 6 * map_.body;
  for (std::size_t i = 0; i < 3; ++i) {
    push[i] = share * kHandStiffness_N_m * (hand_position_[i] - data_->qpos[i]);
    push[3 + i] = share * kHandStiffness_Nm_rad * axis[i];
    model_->dof_damping[i] = share * kHandDamping_Ns_m;
    model_->dof_damping[3 + i] = share * kHandDamping_Nms_rad;
  }
}

/// Whole counts of a reading that hovers about the angle, as magnetic encoders' do.
void crux_plant::read_encoders() {
  const double step_rad = settings_.encoder_step_rad;
  const auto at = [&](const double* values, const std::int32_t* places, std::size_t j) {
    return map_.ratio[j] * values[places[j]] + map_.coupling[j] * values[places[map_.coupled_to[j]]];
  };
  for (std::size_t j = 0; j < joints(); ++j) {
    const double angle_rad = at(data_->qpos, map_.driven_qpos, j) + map_.offset_rad[j] +
                             settings_.encoder_noise_rad * encoder_normal_(encoder_random_);
    state_.joint_position_rad[j] = step_rad > 0.0 ? step_rad * std::round(angle_rad / step_rad) : angle_rad;
    state_.joint_velocity_rad_s[j] =
        at(data_->qvel, map_.driven_dof, j) + settings_.encoder_noise_rad_s * encoder_normal_(encoder_random_);
  }
}

void crux_plant::read_sensors() {
  read_encoders();
  for (std::size_t i = 0; i < CRUX_SIM_WRENCHES; ++i) {
    // MuJoCo reports what the link exerts on the hand; wanted is what the world exerts on it.
    state_.ft_true[i] = -data_->sensordata[map_.ft_sensors[i]];
    state_.ft[i] = state_.ft_true[i] + settings_.ft_noise[i % 6] * normal() + ft_bias_[i];
  }
  for (std::size_t l = 0; l < CRUX_SIM_LIMBS; ++l) {
    const std::int32_t *qpos = map_.finger_qpos + 2 * l, *dof = map_.finger_dof + 2 * l;
    state_.finger_opening_m[l] = (data_->qpos[qpos[0]] + data_->qpos[qpos[1]]) / 2;
    state_.finger_speed_m_s[l] = (data_->qvel[dof[0]] + data_->qvel[dof[1]]) / 2;
  }
  if (world_) world_->sense(time_s(), state_);
}

/// Which face each pad touches and how hard; sets the spines' pull accordingly. Spines catch while the fingers press.
void crux_plant::look_at_contacts() {
  std::ranges::fill(state_.pad_force_n, 0.0);
  std::ranges::fill(state_.pad_face, -1);
  state_.link_contact_force_n = 0.0;
  for (const mjContact& contact : std::span(data_->contact, static_cast<std::size_t>(data_->ncon)))
    take_contact(contact);
  for (std::size_t p = 0; p < CRUX_SIM_PADS; ++p) {
    if (map_.spine_actuators[p] < 0) continue;
    const std::int64_t face = state_.pad_face[p];
    const bool caught = face >= 0 && (state_.finger_force_n[p / 2] > 0.0 || screws_.locked(p / 2));
    data_->ctrl[map_.spine_actuators[p]] = caught ? map_.adhesion_of_face[face] : 0.0;
  }
}

void crux_plant::take_contact(const mjContact& contact) {
  const int a = contact.geom[0], b = contact.geom[1];
  const std::int32_t pad = std::max(map_.pad_of_geom[a], map_.pad_of_geom[b]);
  const std::int32_t face = std::max(map_.face_of_geom[a], map_.face_of_geom[b]);
  // The first row of a contact is along its normal.
  const double force_n = contact.efc_address >= 0 ? data_->efc_force[contact.efc_address] : 0.0;
  if (pad < 0) {
    state_.link_contact_force_n = std::max(state_.link_contact_force_n, force_n);
  } else if (state_.pad_face[pad] < 0 || force_n > state_.pad_force_n[pad]) {
    state_.pad_face[pad] = face;
    state_.pad_force_n[pad] = force_n;
  }
}

void crux_plant::record(std::int64_t cycle, std::int32_t climbing) {
  const std::int64_t step = cycle == cycle_ ? state_.cycle : cycle + 1;  // by itself while the runtime is silent
  cycle_ = cycle;
  if (step % crux_plant_contact_period != kFirstContactStep) return;
  crux_plant_truth& row = truth_.emplace_back();
  row.cycle = cycle;
  row.climbing = climbing;
  std::copy_n(data_->qpos, 3, row.body_position_m);
  std::copy_n(data_->qpos + 3, 4, row.body_quaternion);
  for (std::size_t l = 0; l < CRUX_SIM_LIMBS; ++l) {
    const auto site = static_cast<std::size_t>(map_.gripper_sites[l]);
    std::copy_n(data_->site_xpos + 3 * site, 3, row.gripper_position_m[l]);
    std::copy_n(data_->site_xmat + 9 * site, 9, row.gripper_rotation[l]);
    std::copy_n(state_.ft_true + 6 * l, 6, row.hand_wrench_g[l]);
  }
  for (std::size_t p = 0; p < CRUX_SIM_PADS; ++p)
    std::copy_n(data_->geom_xpos + 3 * static_cast<std::size_t>(map_.pad_geoms[p]), 3, row.pad_position_m[p]);
  std::ranges::copy(state_.pad_force_n, row.pad_force_n);
  std::ranges::copy(state_.pad_face, row.pad_face);
  row.link_contact_force_n = state_.link_contact_force_n;
}

crux_plant* crux_plant_open(mjModel* model, mjData* data, const crux_plant_map* map,
                            const crux_plant_settings* settings, const crux_world* world, crux_plant_state* state) {
  return new (std::nothrow) crux_plant(model, data, *map, *settings, world, *state);
}

void crux_plant_close(crux_plant* plant) { delete plant; }

void crux_plant_drive_joint(crux_plant* plant, std::int32_t joint) {
  plant->torque_share_[static_cast<std::size_t>(joint)] = 1.0;
}

void crux_plant_drive_gripper(crux_plant* plant, std::int32_t limb) {
  plant->screws_.drive(static_cast<std::size_t>(limb));
}

std::int32_t crux_plant_slots(const crux_plant* plant) { return plant->map_.slots; }

void crux_plant_power_joint(crux_plant* plant, std::int32_t joint, std::int32_t supply) {
  plant->power_joint(static_cast<std::size_t>(joint), static_cast<Supply>(supply));
}

void crux_plant_power_gripper(crux_plant* plant, std::int32_t limb, std::int32_t supply) {
  plant->power_gripper(static_cast<std::size_t>(limb), static_cast<Supply>(supply));
}

void crux_plant_carry(crux_plant* plant) {
  plant->carried_until_s_ = static_cast<double>(plant->state_.cycle) * plant->model_->opt.timestep;
}

void crux_plant_step(crux_plant* plant, const double* joint_torque_nm, const double* finger_force_n) {
  plant->step(joint_torque_nm, finger_force_n);
}

const crux_plant_state* crux_plant_state_of(const crux_plant* plant) { return &plant->state_; }

const double* crux_plant_temperature(const crux_plant* plant) {
  return plant->world_ ? plant->world_->temperature().data() : nullptr;
}

void crux_plant_record(crux_plant* plant, std::int64_t cycle, std::int32_t climbing) { plant->record(cycle, climbing); }

const crux_plant_truth* crux_plant_recorded(const crux_plant* plant, std::int64_t* count) {
  *count = static_cast<std::int64_t>(plant->truth_.size());
  return plant->truth_.data();
}
