#include "core/encoder_watch.hpp"

#include <cmath>

namespace crux {
namespace {

constexpr double kJumpShare = 1.5;  // of the way a joint can make since its last reading

}  // namespace

EncoderWatch::EncoderWatch(const RobotDescription& robot, int limb) noexcept
    : limb_(limb),
      standstill_rad_(robot.supervisor.encoder_standstill_rad),
      joints_(robot.limbs[limb].joints),
      nodes_(robot.can.joint_nodes) {}

double EncoderWatch::look(int joint, double raw_rad, double command_rad, double dt_s) noexcept {
  const double moved_rad = raw_rad - last_rad_[joint];
  const double most_rad = kJumpShare * joints_[joint].velocity_rad_s * (silent_s_[joint] + dt_s);
  silent_s_[joint] = 0.0;
  last_rad_[joint] = raw_rad;
  if (!seen_[joint] || moved_rad != 0.0) still_at_rad_[joint] = command_rad;
  if (seen_[joint] && std::abs(moved_rad) > most_rad) {
    shift_rad_[joint] += moved_rad;
    if (!fault_) fault_ = {FaultCode::kEncoderJumped, limb_, nodes_[joint], moved_rad, most_rad};
  }
  seen_[joint] = true;
  const double commanded_rad = std::abs(command_rad - still_at_rad_[joint]);
  if (commanded_rad > standstill_rad_) {
    frozen_ = true;
    if (!fault_) fault_ = {FaultCode::kEncoderFrozen, limb_, nodes_[joint], commanded_rad, standstill_rad_};
  }
  return raw_rad - shift_rad_[joint];
}

}  // namespace crux
