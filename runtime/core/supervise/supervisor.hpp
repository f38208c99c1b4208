// The supervisor's states: IDLE, READY, CLIMBING, HOLDING, FAULT. HOLDING is the safe state: the plan's clock stands,
// the stance is still controlled. In FAULT the nodes hold by themselves.
#pragma once

#include <crux_msgs/command_t.hpp>
#include <crux_msgs/robot_state_t.hpp>

#include "core/plan/plan_clock.hpp"
#include "core/robot/reason.hpp"
#include "core/supervise/fault_monitor.hpp"

namespace crux {

enum class SupervisorState : std::int8_t {
  kIdle = crux_msgs::robot_state_t::IDLE,
  kReady = crux_msgs::robot_state_t::READY,
  kClimbing = crux_msgs::robot_state_t::CLIMBING,
  kHolding = crux_msgs::robot_state_t::HOLDING,
  kFault = crux_msgs::robot_state_t::FAULT,
};

/// Why a runtime that controls the robot does not end.
inline constexpr const char* kOnTheWall =
    "the robot is on the wall: hold it and take it off first; --force ends all the same, the nodes then hold by their "
    "own watchdogs";

enum class CommandVerdict : std::int8_t { kNone, kAccepted, kRefused };

class Supervisor {
 public:
  struct Observation {
    int command = crux_msgs::command_t::NONE;  ///< of the operator, in this cycle
    double command_value = 0.0;
    bool plan_loaded = false;
    bool may_take_over = false;  ///< all nodes well and the robot stands at the plan's start
    bool plan_started = false;   ///< the plan's clock has left zero
    bool plan_complete = false;
    bool walks = false;          ///< the plan is a walk: its balance is that of its speed
    bool footholds = false;      ///< some limb of the plan stands on a foothold
    bool arrived = false;        ///< the plan's clock stands where its motion ends
    bool testing = false;        ///< a new grasp is being pulled
    bool can_reverse = false;    ///< a verified stance lies behind
    bool link_restored = false;  ///< buses and nodes have been well for long enough
    bool rearming = false;       ///< nodes are being re-armed: what they report is of the past
    FaultList faults;            ///< seen in this cycle
    FaultEvent cause;            ///< one of them, where re-arming the nodes cannot clear it
    FaultEvent supply;           ///< what was silent has had no power
    bool stands_up = false;      ///< the body is on its way up to where the plan has it
    Reason not_ready_reason;
  };

  /// One cycle: fault first, then the operator's command, then the way of the plan.
  void update(const Observation& seen) noexcept;

  /// A new plan has come in. `stands`: it begins with the stance that is controlled, which goes on; else it must be
  /// matched with the robot's pose first.
  void plan_exchanged(bool stands) noexcept;

  /// The robot is found hanging on the wall in mid-plan, as the run before left it, `fault` included.
  void take_up(const FaultEvent& fault, double speed_scale) noexcept;

  SupervisorState state() const { return state_; }
  /// Joints are to be driven in this state.
  bool controls() const {
    return state_ == SupervisorState::kReady || state_ == SupervisorState::kClimbing ||
           state_ == SupervisorState::kHolding;
  }
  Motion motion() const { return motion_; }                  ///< along the plan
  bool departs() const { return departs_; }                  ///< it begins in this cycle
  double speed_scale() const { return speed_scale_; }        ///< of the plan's clock, 0..1
  const FaultEvent& fault() const { return fault_; }         ///< why it stands where it stands; none after CLEAR_FAULT
  const FaultList& standing() const { return standing_; }    ///< that and what came beside it, in order
  const FaultEvent& news() const { return news_; }           ///< a fault to tell in this cycle: each once
  CommandVerdict verdict() const { return verdict_; }        ///< on this cycle's command
  const Reason& refusal() const { return refusal_; }         ///< empty unless refused
  bool rearm_requested() const { return rearm_requested_; }  ///< CLEAR_FAULT, or the link is well again, in this cycle

 private:
  void obey(const Observation& seen) noexcept;
  void start(const Observation& seen, Motion motion) noexcept;
  void go_on(const Observation& seen, Motion motion) noexcept;
  void reverse(const Observation& seen) noexcept;
  void depart(Motion motion) noexcept;
  void set_speed(const Observation& seen) noexcept;
  void accept() noexcept { verdict_ = CommandVerdict::kAccepted; }
  void refuse(const Reason& reason) noexcept;
  void refuse(const char* reason) noexcept { refuse(Reason{reason}); }
  void refuse(const FaultEvent& cause) noexcept;
  void raise(const FaultEvent& fault) noexcept;
  void clear(const Observation& seen) noexcept;
  void tell() noexcept;
  void recover(const Observation& seen) noexcept;

  SupervisorState state_ = SupervisorState::kIdle;
  Motion motion_ = Motion::kForward;
  bool departs_ = false;
  double speed_scale_ = 1.0;
  FaultEvent fault_;
  FaultList standing_, untold_;
  FaultEvent news_;
  CommandVerdict verdict_ = CommandVerdict::kNone;
  Reason refusal_;
  bool rearm_requested_ = false;
};

}  // namespace crux
