#include "core/estimate/encoder_watch.hpp"

#include <cmath>

namespace crux {
namespace {

constexpr double kJumpShare = 1.5;    // of the way a joint can make since its last reading
constexpr int kMemory = 250;          // readings in which is learnt how an encoder hovers
constexpr double kStands_rad = 2e-5;  // of a command in a cycle
constexpr double kChance = 1e-9;      // that one which hovers reads the same for so long

}  // namespace

EncoderWatch::EncoderWatch(const RobotDescription& robot, int limb) noexcept
    : limb_(limb),
      standstill_rad_(robot.supervisor.encoder_standstill_rad),
      most_friction_Nm_(robot.supervisor.max_ft_residual_Nm),
      gain_Nm_rad_(robot.servo.position_gain_Nm_rad),
      actuators_(robot.limbs[limb].actuators),
      nodes_(robot.can.nodes.joints) {}

void EncoderWatch::hover(int joint, double moved_rad, double commanded_rad) noexcept {
  same_[joint] = moved_rad == 0.0 ? same_[joint] + 1 : 0;
  const double turns_back = moved_rad * last_step_rad_[joint] < 0.0 ? 1.0 : 0.0;
  if (std::abs(commanded_rad) < kStands_rad) hovers_[joint] += (turns_back - hovers_[joint]) / kMemory;
  if (moved_rad != 0.0) last_step_rad_[joint] = moved_rad;
}

bool EncoderWatch::stands_by_itself(int joint, double commanded_rad) const noexcept {
  if (commanded_rad <= standstill_rad_) return false;
  const bool hovers = same_[joint] * std::log1p(-hovers_[joint]) < std::log(kChance);
  return hovers || gain_Nm_rad_[joint] * (commanded_rad - standstill_rad_) > most_friction_Nm_;
}

double EncoderWatch::look(int joint, double raw_rad, double command_rad, double dt_s) noexcept {
  const double moved_rad = raw_rad - last_rad_[joint];
  const double most_rad = kJumpShare * actuators_[joint].velocity_rad_s * (silent_s_[joint] + dt_s);
  silent_s_[joint] = 0.0;
  last_rad_[joint] = raw_rad;
  if (!seen_[joint] || moved_rad != 0.0) still_at_rad_[joint] = command_rad;
  if (seen_[joint] && std::abs(moved_rad) > most_rad) {
    shift_rad_[joint] += moved_rad;
    if (!fault_) fault_ = {FaultCode::kEncoderJumped, limb_, nodes_[joint], moved_rad, most_rad};
  }
  if (seen_[joint]) hover(joint, moved_rad, command_rad - last_command_rad_[joint]);
  last_command_rad_[joint] = command_rad;
  seen_[joint] = true;
  const double commanded_rad = std::abs(command_rad - still_at_rad_[joint]);
  if (stands_by_itself(joint, commanded_rad)) {
    frozen_ = true;
    if (!fault_) fault_ = {FaultCode::kEncoderFrozen, limb_, nodes_[joint], commanded_rad, standstill_rad_};
  }
  return raw_rad - shift_rad_[joint];
}

}  // namespace crux
