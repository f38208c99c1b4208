// The control core: inputs of one cycle in, outputs of one cycle out. Pure: no clock, no socket, no global; step() does
// not allocate, lock, throw or do I/O. The same object code runs on the robot, in the HIL bench and under replay.
#pragma once

#include <crux_msgs/control_input_t.hpp>
#include <crux_msgs/control_output_t.hpp>
#include <crux_msgs/fault_t.hpp>
#include <crux_msgs/limb_reference_t.hpp>
#include <crux_msgs/limb_telemetry_t.hpp>
#include <crux_msgs/plan_t.hpp>
#include <crux_msgs/restart_t.hpp>
#include <crux_msgs/robot_state_t.hpp>
#include <memory>

#include "core/estimate/body_estimator.hpp"
#include "core/estimate/delay_probe.hpp"
#include "core/estimate/map_localisation.hpp"
#include "core/estimate/touched_height.hpp"
#include "core/estimate/weight_balance.hpp"
#include "core/grips/grips.hpp"
#include "core/limb/calibration.hpp"
#include "core/limb/limb_controller.hpp"
#include "core/loads/load_sharing.hpp"
#include "core/plan/plan_clock.hpp"
#include "core/stand_up.hpp"
#include "core/supervise/fault_monitor.hpp"
#include "core/supervise/supervisor.hpp"

namespace crux {

/// Everything one cycle gives.
struct CycleResult {
  crux_msgs::control_output_t output{};
  crux_msgs::robot_state_t state{};
  crux_msgs::limb_reference_t reference[kLimbs]{};
  crux_msgs::limb_telemetry_t telemetry[kLimbs]{};
  bool has_fault = false;  ///< `fault` was raised in this very cycle
  crux_msgs::fault_t fault{};
  CommandVerdict command_verdict = CommandVerdict::kNone;  ///< on control_input_t.operator_command
  Reason command_refusal;
};

class ControlCore {
 public:
  explicit ControlCore(const RobotDescription& robot);
  ControlCore(const ControlCore&) = delete;
  ControlCore& operator=(const ControlCore&) = delete;

  /// Validates, prepares and takes over a plan. Not for the real-time thread. Empty when done, else the reason.
  std::string load_plan(const crux_msgs::plan_t& plan);

  /// Takes over a plan prepared elsewhere (prepare_plan); `plan` becomes the one there was before, to be freed outside
  /// the real-time thread. Nothing changes where it is refused: while climbing, unless it goes on from a stance of the
  /// one there was to which the robot has not come yet (plan_join), and where the robot is controlled and the plan
  /// begins elsewhere. A stance that is controlled is controlled on, with the limbs in the air that it has.
  Reason exchange_plan(std::unique_ptr<const PreparedPlan>& plan) noexcept;

  /// Before the first cycle, with the plan loaded that `left` names: the robot hangs on the wall in the middle of that
  /// plan, as the run before left it. Believed once all nodes have been heard for a while and joints, fingers and
  /// force/torque sensors agree; HOLDING then, else the plan is dropped. Faults 34 and 35 tell which.
  void restore(const crux_msgs::restart_t& left);

  /// What the next run needs to know; without a plan_id where there is nothing to go on with. `left`.plan_id has room
  /// for a plan's; its robot is not filled in.
  void leave(crux_msgs::restart_t& left) const noexcept;

  /// Why fault 35 was told.
  const Reason& restart_refusal() const noexcept { return restart_refusal_; }

  /// One control cycle.
  void step(const crux_msgs::control_input_t& in, CycleResult& out) noexcept;

  SupervisorState state() const { return supervisor_.state(); }

  /// Faults since the last was cleared, in order.
  const FaultList& standing() const { return supervisor_.standing(); }

  /// Of each joint's drive, as it was measured before the plan began; -1: not known.
  std::array<double, kAllJoints> joint_dead_time_s() const noexcept;

  /// IDLE, and nothing that an operator gave it or has to know of would be lost with it.
  bool as_new() const noexcept;

 private:
  /// In which latched nodes are told to re-arm: frames may be lost.
  static constexpr int kRearmCycles = 50;

  // The steps of a cycle.
  void sense(const crux_msgs::control_input_t& in) noexcept;
  void watch(double dt_s) noexcept;
  void supervise(const crux_msgs::control_input_t& in) noexcept;
  void refer(const crux_msgs::control_input_t& in) noexcept;
  void locate(double dt_s) noexcept;
  void share(double dt_s) noexcept;
  void aim(double dt_s) noexcept;
  /// Takes in where limb `l`, which bears its load now, is found to grip.
  void find_place(int l) noexcept;
  void yield(double dt_s) noexcept;
  /// Other gains for the admittances, where they are to be calibrated.
  void calibrate(double dt_s) noexcept;
  void drive(const crux_msgs::control_input_t& in) noexcept;
  void stand_by() noexcept;
  void write(const crux_msgs::control_input_t& in, CycleResult& out) const noexcept;

  CycleView view() const noexcept;
  /// 0..1: how far control has taken over from what held the joints before.
  double engagement() const noexcept;
  void engage() noexcept;
  /// Decides on what restore() was told, where that is due.
  void take_up() noexcept;
  void begin_again() noexcept;
  Reason change_plan_ahead(std::unique_ptr<const PreparedPlan>& plan) noexcept;
  /// The plan in reference_ takes the stance over from `before`.
  void hand_over(const PlanReference& before) noexcept;
  LoopErrors errors(double late_s) const noexcept;
  /// Control begins or ends, and the plan's clock departs, as the supervisor decided. `well`: control may take over.
  void follow_supervisor(bool well) noexcept;
  void advance_clock(double dt_s) noexcept;
  /// Before the plan's clock starts: until all grips are closed and the stance has stood.
  void settle(const PerLimb<LimbEvents>& events, double dt_s) noexcept;
  /// Moves the body up to its plan where it hangs lower, as long as its limbs bear and reach it.
  void stand_up(double dt_s) noexcept;
  void write_reference(CycleResult& out) const noexcept;
  void write_modes(const crux_msgs::control_input_t& in, CycleResult& out) const noexcept;

  RobotDescription robot_;
  std::unique_ptr<const PreparedPlan> plan_;
  PerLimb<LimbController> limbs_;
  std::unique_ptr<Calibration> calibration_;  ///< none where the gains stay
  BodyEstimator body_;
  BodyCorrection correction_;
  MapLocalisation localisation_;
  PerLimb<TouchedHeight> touched_;
  LoadSharing sharing_;
  Grips grips_;
  StandUp rise_;
  FaultMonitor faults_;
  Supervisor supervisor_;
  WeightBalance balance_;
  DelayProbe probe_;
  PlanClock clock_;

  PlanReference reference_;     ///< of this cycle
  PerLimb<Wrench> wrenches_W_;  ///< that the limbs are to bear, of this cycle
  Vector3 com_W_m_ = Vector3::Zero();
  crux_msgs::restart_t left_{};  ///< that restore() was told, until it is decided on
  bool looks_around_ = false;    ///< to decide on it
  Reason restart_refusal_;
  FaultEvent notice_;                            ///< to be told
  std::unique_ptr<const PreparedPlan> dropped_;  ///< not freed in a cycle
  bool engaged_ = false;                         ///< control has taken over from the nodes' own hold
  double engaged_time_s_ = 0.0;
  bool started_ = false;          ///< the plan's clock has left zero
  double settling_time_s_ = 0.0;  ///< in CLIMBING before that
  int settling_limb_ = -1;
  int rearm_cycles_ = 0;  ///< left in which latched nodes are told to re-arm
};

}  // namespace crux
