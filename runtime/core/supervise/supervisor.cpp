#include "core/supervise/supervisor.hpp"

#include <algorithm>

namespace crux {

using crux_msgs::command_t;

namespace {

constexpr double kMostCode = 1000.0;
constexpr const char* kFaultStands = "a fault stands; clear it first";
constexpr const char* kPlanComplete = "the plan is complete";
constexpr const char* kWalkSpeed = "a walk keeps its balance at speed 1 alone; crux speed 1";
constexpr const char* kWalkStops =
    "a walk cannot stop in mid-step nor go backward; start, hold and resume alone lead it";

}  // namespace

void Supervisor::update(const Observation& seen) noexcept {
  verdict_ = CommandVerdict::kNone;
  refusal_ = {};
  rearm_requested_ = false;
  departs_ = false;

  for (const FaultEvent& fault : seen.faults) {
    if (!seen.rearming && state_ != SupervisorState::kIdle) raise(fault);
  }
  if (seen.link_restored && !seen.rearming) recover(seen);
  tell();
  if (state_ == SupervisorState::kClimbing && seen.arrived) state_ = SupervisorState::kHolding;
  obey(seen);
  if (state_ == SupervisorState::kIdle && seen.may_take_over) state_ = SupervisorState::kReady;
}

void Supervisor::raise(const FaultEvent& fault) noexcept {
  const crux_msgs::FaultInfo* info = crux_msgs::fault_info(static_cast<std::int16_t>(fault.code));
  const auto next = static_cast<SupervisorState>(info->to);
  // A graver fault replaces a lighter one; the first of equals leads, it is nearest to the cause.
  const bool follows = fault_.code == FaultCode::kPowerLost && fault.code == FaultCode::kStandsNoFurther;
  const bool leads = state_ != SupervisorState::kFault &&
                     !(state_ == SupervisorState::kHolding && fault_ && next == SupervisorState::kHolding && !follows);
  if (standing_.add(fault) || leads) untold_.add(fault);
  if (!leads) return;
  state_ = next;
  fault_ = fault;
}

/// One a cycle, so that each is seen in the log.
void Supervisor::tell() noexcept {
  news_ = {};
  if (untold_.empty()) return;
  news_ = untold_[0];
  FaultList later;
  for (std::size_t i = 1; i < untold_.size(); ++i) later.add(untold_[i]);
  untold_ = later;
}

/// A fault of the link ends with its cause: the robot is controlled again, but does not move on by itself. In mid-plan
/// the fault goes on standing, so that RESUME waits until somebody has seen it.
void Supervisor::recover(const Observation& seen) noexcept {
  const crux_msgs::FaultInfo* info = crux_msgs::fault_info(static_cast<std::int16_t>(fault_.code));
  if (info == nullptr || !info->recovers) return;
  if (seen.plan_started && state_ == SupervisorState::kFault) {
    state_ = SupervisorState::kHolding;
    rearm_requested_ = true;
    if (seen.supply) {
      fault_ = seen.supply;
      standing_.add(fault_);
      untold_.add(fault_);
    }
  } else if (!seen.plan_started && (state_ == SupervisorState::kFault || state_ == SupervisorState::kHolding)) {
    state_ = SupervisorState::kIdle;
    fault_ = {};
    standing_.clear();
    rearm_requested_ = true;
  }
}

void Supervisor::refuse(const Reason& reason) noexcept {
  verdict_ = CommandVerdict::kRefused;
  refusal_ = reason;
}

void Supervisor::refuse(const FaultEvent& cause) noexcept {
  const char* text = crux_msgs::fault_info(static_cast<std::int16_t>(cause.code))->text.data();  // of a literal
  refuse(Reason{text, cause.limb, cause.node, cause.value, cause.limit});
}

void Supervisor::depart(Motion motion) noexcept {
  state_ = SupervisorState::kClimbing;
  motion_ = motion;
  departs_ = true;
  accept();
}

/// The plan from its beginning.
void Supervisor::start(const Observation& seen, Motion motion) noexcept {
  if (!seen.plan_loaded) return refuse("no plan is loaded");
  if (state_ == SupervisorState::kIdle) return refuse(seen.not_ready_reason);
  if (state_ == SupervisorState::kClimbing) return refuse("the robot is climbing already");
  if (state_ == SupervisorState::kFault) return refuse(kFaultStands);
  if (state_ == SupervisorState::kHolding)
    return refuse(seen.plan_complete ? "the plan is complete; upload a new one"
                                     : "the robot holds in mid-plan; resume it");
  if (seen.walks && speed_scale_ != 1.0) return refuse(kWalkSpeed);
  depart(motion);
}

/// Along the plan from where the robot holds.
void Supervisor::go_on(const Observation& seen, Motion motion) noexcept {
  if (fault_) return refuse(kFaultStands);
  if (seen.rearming) return refuse("nodes are being re-armed; try again in a moment");
  if (seen.stands_up) return refuse("the robot stands up to where it was before; try again when it stands");
  if (motion != Motion::kReverse && seen.plan_complete) return refuse(kPlanComplete);
  if (seen.testing && (motion == Motion::kReverse) != (motion_ == Motion::kReverse))
    return refuse("a new grasp is being tested by a pull, which ends by itself; try again in a moment");
  depart(motion);
}

void Supervisor::reverse(const Observation& seen) noexcept {
  if (seen.walks) return refuse(kWalkStops);
  if (seen.footholds) return refuse("a plan with footholds is not played backward");
  if (state_ == SupervisorState::kClimbing) return refuse("the robot is climbing; hold it first");
  if (state_ != SupervisorState::kHolding) return refuse("only a robot that is holding can go backward");
  if (!seen.can_reverse) return refuse("no verified stance of the plan lies behind");
  go_on(seen, Motion::kReverse);
}

void Supervisor::set_speed(const Observation& seen) noexcept {
  if (!(seen.command_value >= 0.0 && seen.command_value <= 1.0))
    return refuse({"the speed scale would be {value}, right is 0 (stand still) to 1 (as planned)", -1, 0,
                   seen.command_value, 0.0});
  if (seen.walks && seen.command_value != 1.0) return refuse(kWalkSpeed);
  speed_scale_ = seen.command_value;
  accept();
}

/// All that stands, or the faults of one code.
void Supervisor::clear(const Observation& seen) noexcept {
  if (seen.cause && state_ != SupervisorState::kIdle) return refuse(seen.cause);
  if (!(seen.command_value >= 0.0 && seen.command_value <= kMostCode)) return refuse("no such fault stands");
  const auto code = static_cast<FaultCode>(static_cast<std::int16_t>(seen.command_value));
  if (code != FaultCode::kNone && !standing_.remove(code)) return refuse("no such fault stands");
  accept();
  const auto leads = [](const FaultEvent& fault) {
    return crux_msgs::fault_info(static_cast<std::int16_t>(fault.code))->to == crux_msgs::robot_state_t::FAULT;
  };
  if (code != FaultCode::kNone && !standing_.empty()) {
    const FaultEvent* gravest = std::find_if(standing_.begin(), standing_.end(), leads);
    fault_ = gravest != standing_.end() ? *gravest : standing_[0];
    return;
  }
  rearm_requested_ = true;
  fault_ = {};
  standing_.clear();
  untold_.clear();
  if (state_ == SupervisorState::kFault || state_ == SupervisorState::kHolding) {
    state_ = seen.plan_started ? SupervisorState::kHolding : SupervisorState::kIdle;
  }
}

void Supervisor::obey(const Observation& seen) noexcept {
  switch (seen.command) {
    case command_t::NONE:
      return;
    case command_t::START:
      return start(seen, Motion::kForward);
    case command_t::HOLD:
      if (state_ == SupervisorState::kClimbing) state_ = SupervisorState::kHolding;
      return accept();
    case command_t::RESUME:
      if (state_ != SupervisorState::kHolding) return refuse("only a robot that is holding can resume");
      return go_on(seen, Motion::kForward);
    case command_t::STEP:
      if (seen.walks) return refuse(kWalkStops);
      if (state_ == SupervisorState::kHolding) return go_on(seen, Motion::kStep);
      if (state_ != SupervisorState::kClimbing) return start(seen, Motion::kStep);
      if (motion_ == Motion::kReverse) return refuse("the robot goes backward; hold it first");
      return depart(Motion::kStep);
    case command_t::REVERSE:
      return reverse(seen);
    case command_t::SPEED:
      return set_speed(seen);
    case command_t::CLEAR_FAULT:
      return clear(seen);
    case command_t::SHUTDOWN:
      if (state_ != SupervisorState::kIdle) return refuse(kOnTheWall);
      return accept();
    case command_t::FORCE_SHUTDOWN:
    case command_t::STATUS:
      // Answered by the program around the core; the nodes go on holding after it has gone.
      return accept();
    default:
      return refuse("unknown command");
  }
}

void Supervisor::take_up(const FaultEvent& fault, double speed_scale) noexcept {
  state_ = SupervisorState::kHolding;
  fault_ = fault;
  standing_.add(fault);
  if (fault) news_ = fault;
  speed_scale_ = speed_scale;
}

void Supervisor::plan_exchanged(bool stands) noexcept {
  if (state_ != SupervisorState::kFault) {
    state_ = stands ? SupervisorState::kReady : SupervisorState::kIdle;
    fault_ = {};
    standing_.clear();
  }
  motion_ = Motion::kForward;
}

}  // namespace crux
