// Watches nodes, sensors and the loop's own errors for the faults of msgs/faults.yaml.
#pragma once

#include <array>
#include <crux_msgs/control_input_t.hpp>

#include "core/estimate/drift_watch.hpp"
#include "core/estimate/limb_health.hpp"
#include "core/robot/fault_list.hpp"
#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// What the control loop reports of itself each cycle.
struct LoopErrors {
  double body_error_m = 0.0;
  PerLimb<double> tracking_error_rad{};  ///< of the limb's worst joint
  PerLimb<int> worst_joint{};
  PerLimb<double> ik_error_m{};
  PerLimb<double> finger_force_N{};
  PerLimb<bool> must_grip{};      ///< bears load: its fingers must press
  PerLimb<double> foot_N{};       ///< normal force of one on a foothold
  PerLimb<bool> must_press{};     ///< it bears load there: its foot must press
  PerLimb<bool> finds_no_hold{};  ///< its fingers, as they close, come to
  PerLimb<double> opening_m{};    ///< and press on nothing
  PerLimb<double> hold_m{};       ///< where they should have touched
  PerLimb<bool> grasp_failed{};   ///< gave way to the pull that tested it
  double gave_way_m = 0.0, gave_way_limit_m = 0.0;
  PerLimb<double> ft_residual_Nm{};     ///< torque of the limb's joints that its F/T sensor does not explain
  PerLimb<double> ft_limit_Nm{};        ///< the most that this may be
  PerLimb<double> ft_frozen_Nm{};       ///< change of that torque while the sensor gives the very same numbers
  PerLimb<bool> closes_on_nothing{};    ///< its fingers close further than its hold is wide,
  PerLimb<double> least_force_N{};      ///< with less than this force
  PerLimb<double> finger_residual_N{};  ///< finger force that opening and command do not explain
  PerLimb<double> slid_m{};             ///< in a slip
  DriftWatch::Told drift;               ///< of a hold or an encoder
  PerLimb<bool> slips_on{};             ///< in spite of all that was done
  double unbalanced_N = 0.0;
  int unbalanced_limb = -1;
  PerLimb<double> misfit_m{};            ///< of the limb that does not fit the others
  PerLimb<double> misfit_off_faces_m{};  ///< what of that no slide on its hold makes
  double late_s = 0.0;                   ///< this cycle began so long after its instant
  double waited_s = 0.0;                 ///< for the plan clock's event
  double below_m = 0.0;                  ///< its plan the body hangs so far,
  double rise_waited_s = 0.0;            ///< and has come no nearer for so long
  int waiting_limb = -1;
};

class FaultMonitor {
 public:
  explicit FaultMonitor(const RobotDescription& robot);

  /// Counts the cycles without news of each node. Once a cycle, before the questions below.
  void observe(const crux_msgs::control_input_t& in) noexcept;

  /// Every node and sensor has spoken in this cycle, is fit and not latched: control may take over.
  bool all_well(const crux_msgs::control_input_t& in) const noexcept;

  /// Buses, nodes and sensors have been fit and heard without a break for settle_time_s: a fault of the link is over.
  /// Nodes may still be latched.
  bool link_restored() const noexcept { return well_time_s_ >= limits_.settle_time_s; }

  /// Faults of inputs, buses, nodes and sensors, the gravest first. `tracking`: nodes are being told to track, so one
  /// that holds does so by itself.
  FaultEvent node_fault(const crux_msgs::control_input_t& in, bool tracking) noexcept;

  /// What was silent has restarted: it had no power, for how long [s]. None when nothing has since forgive().
  FaultEvent supply_fault() const noexcept { return supply_; }

  /// The part of the fault that re-arming the nodes cannot clear: silence, buses, heat, silent sensors.
  FaultEvent standing_cause(const crux_msgs::control_input_t& in) const noexcept;

  /// Adds all faults of the loop. Errors count when they last for persistence_s.
  void loop_faults(const LoopErrors& errors, double dt_s, FaultList& found) noexcept;

  /// What of each limb is no longer counted on.
  const LimbHealth& health() const noexcept { return health_; }
  /// A node of the limb's joints, or that of its fingers, holds by itself though it is told to track.
  bool joint_stands(int limb) const noexcept { return joint_stands_[limb]; }
  bool fingers_stand(int limb) const noexcept { return fingers_stand_[limb]; }
  /// A plan begins with the limb in the air: what it held is looked for no more.
  void begin_in_air(int limb) noexcept { health_.hold_lost[limb] = false; }
  /// An operator has looked: what was lost or distrusted is tried again.
  void forgive() noexcept;

  /// A node's watchdog has latched its hold: only REARM leads on.
  bool any_latched(const crux_msgs::control_input_t& in) const noexcept;
  bool force_torque_well(const crux_msgs::control_input_t& in) const noexcept;
  std::int64_t missed_cycles() const { return missed_cycles_; }

 private:
  /// What silence may follow from: kOtherFaults leaves out what a fault of the limb's bus has told already.
  enum class After : std::uint8_t { kAnything, kOtherFaults };

  void note_restart(int limb, int node, int silence, double dt_s) noexcept;
  bool link_well(const crux_msgs::control_input_t& in) const noexcept;
  /// Its bus fails, or did a moment ago: what is not heard of its nodes says nothing more.
  bool follows_bus(int limb) const noexcept;
  FaultEvent bus_fault(const crux_msgs::control_input_t& in) const noexcept;
  FaultEvent silent_node(After after) const noexcept;  ///< or all of them, which is no single node's fault
  FaultEvent doubled_node(const crux_msgs::control_input_t& in) const noexcept;
  FaultEvent unfit_node(const crux_msgs::control_input_t& in, bool state_counts) const noexcept;
  /// Told to track, a node in this state holds by itself.
  bool holds_by_itself(int state, int faults) const noexcept;
  void note_standing(const crux_msgs::control_input_t& in) noexcept;
  FaultEvent holding_node(const crux_msgs::control_input_t& in) noexcept;  ///< or some of every limb
  FaultEvent sensor_fault(const crux_msgs::control_input_t& in, After after) const noexcept;

  SupervisorParameters limits_;
  CanDescription can_;
  StanceParameters stance_;
  double unbalanced_time_s_ = 0.0;
  PerLimb<double> misfit_time_s_{};
  PerLimb<double> slip_time_s_{};
  std::array<int, kAllJoints> joint_silence_{};
  PerLimb<int> gripper_silence_{};
  PerLimb<int> ft_silence_{};
  PerLimb<int> full_cycles_{};
  PerLimb<bool> bus_held_{};  ///< its nodes hold since their bus failed
  PerLimb<bool> joint_stands_{}, fingers_stand_{};
  PerLimb<double> since_bus_fault_s_{1e9, 1e9, 1e9, 1e9};
  double well_time_s_ = 0.0;
  FaultEvent supply_;
  int tracking_cycles_ = 0;
  std::int64_t missed_cycles_ = 0;
  double body_error_time_s_ = 0.0;
  PerLimb<double> tracking_error_time_s_{};
  PerLimb<double> ik_error_time_s_{};
  PerLimb<double> grip_error_time_s_{};
  PerLimb<double> hold_gone_time_s_{};
  PerLimb<double> no_hold_time_s_{};
  PerLimb<double> foot_error_time_s_{};
  PerLimb<double> ft_residual_time_s_{};
  PerLimb<double> finger_residual_time_s_{};
  LimbHealth health_;
};

}  // namespace crux
