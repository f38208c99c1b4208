// What one limb's nodes are told and what they answer: frames with end-to-end protection on one side, a slice of
// control_input_t and control_output_t on the other. Owns no socket and reads no clock.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "bus/frame.hpp"
#include "bus/frame_kind.hpp"
#include "bus/limb_statistics.hpp"
#include "bus/stream_watch.hpp"
#include "core/robot/robot_description.hpp"
#include "crux_msgs/control_input_t.hpp"
#include "crux_msgs/control_output_t.hpp"
#include "e2e.h"

namespace crux {

/// Something a node said that an operator should read.
struct NodeNotice {
  enum class Kind : std::uint8_t { kEmergency, kWrongProtocol, kWrongPlace, kWrongParameters };
  Kind kind = Kind::kEmergency;
  std::int8_t limb = 0;
  std::uint8_t node = 0;
  std::uint8_t cause = 0;    ///< of the emergency; the protocol spoken; the limb the node believes in
  std::uint32_t detail = 0;  ///< of the emergency; the hash of the robot description the node was made for
};

/// HostHeartbeat's two numbers.
struct HostHeartbeat {
  std::uint8_t state = 0;
  std::uint32_t uptime_ms = 0;
};

/// How the commands of a cycle go out. Nodes understand both, and answer as they are asked.
enum class CommandFrames : std::uint8_t {
  kEachNode,   ///< a frame a node, then Sync
  kBroadcast,  ///< one frame for all, which is the Sync as well
};

/// @throws BusError where a broadcast cannot carry the joint's gains, or so many joints
void check_broadcast_gains(const RobotDescription& robot, std::size_t joint);
void check_broadcast_joints(const RobotDescription& robot, std::size_t joints);

class LimbBus {
 public:
  /// @param limb 0..3 in the order LF, RF, LR, RR
  /// @throws BusError when the robot's node numbers are not those of the CAN database, or its gains not among those a
  ///         broadcast can carry
  LimbBus(int limb, const RobotDescription& robot, CommandFrames frames = CommandFrames::kEachNode);

  /// The frames of one cycle in sending order: heartbeat if given, joint commands, gripper command, Sync, or in the
  /// place of these the broadcast. From here on the answers to `cycle` are awaited. Valid until the next pack_ call.
  std::span<const Frame> pack_cycle(const crux_msgs::control_output_t& output, std::uint32_t cycle,
                                    const HostHeartbeat* heartbeat) noexcept;

  /// Sync(0) alone, repeated while not all nodes have answered; answers to earlier repetitions stay good.
  std::span<const Frame> pack_wake_up() noexcept;

  /// Judges and files one received frame. Returns true and fills `notice` when an operator should hear of it.
  bool take(const Frame& frame, NodeNotice& notice) noexcept;

  /// A frame that this host sent itself and its bus brought back.
  [[nodiscard]] bool is_echo(const Frame& frame) const noexcept;

  /// Every node has told this run who it is, and is the right one. Until then each heartbeat asks one of the others, in
  /// turn. Who was silent for longer than silent_cycles, or has restarted, is asked again.
  [[nodiscard]] bool identified() const noexcept { return (nodes_ & ~identified_nodes_) == 0; }

  /// What is known of a node (1..8), as in status_t; one that the limb does not have is well.
  [[nodiscard]] std::int8_t node_state(std::uint8_t node) const noexcept;

  /// All nodes and the F/T sensor have answered the awaited cycle.
  [[nodiscard]] bool complete() const noexcept { return ((nodes_ | 1U << kForceTorqueBit) & ~answered_) == 0; }

  /// Somebody else has sent commands or Syncs since the last pack_cycle.
  [[nodiscard]] bool foreign_host() const noexcept { return foreign_host_; }

  /// From Sync on the wire to the last answer, by the kernel's stamps; 0 unless all have answered and stamps exist.
  [[nodiscard]] std::int64_t answer_time_ns() const noexcept {
    return complete() && sync_stamp_ns_ > 0 && answer_stamp_ns_ > 0 ? answer_stamp_ns_ - sync_stamp_ns_ : 0;
  }

  /// Nodes that have not answered the awaited cycle; for messages, it allocates.
  [[nodiscard]] std::vector<int> silent_nodes() const;

  /// Writes the newest values of this limb and whether they answer the awaited cycle.
  void fill(crux_msgs::control_input_t& input) const noexcept;

  [[nodiscard]] const LimbStatistics& statistics() const noexcept { return statistics_; }

 private:
  static constexpr std::uint32_t kForceTorqueBit = 0;  // bits 1..8 are the nodes
  static constexpr std::size_t kMaxFrames = 2 + CRUX_CAN_NODES;

  Frame& next(std::uint32_t id, std::uint8_t length) noexcept;
  void protect(Frame& frame) noexcept;
  void add_heartbeat(const HostHeartbeat& heartbeat) noexcept;
  void forget_silent_nodes() noexcept;
  void add_sync(std::uint32_t cycle) noexcept;
  void add_commands(const crux_msgs::control_output_t& output) noexcept;
  void add_broadcast(const crux_msgs::control_output_t& output, std::uint32_t cycle) noexcept;
  bool trusted(const Frame& frame, const FrameMeaning& meaning) noexcept;
  bool trusted_answer(const Frame& frame, const FrameMeaning& meaning) noexcept;
  void start_anew(std::uint8_t node) noexcept;
  void age_streams() noexcept;
  void take_joint_status(const Frame& frame, std::uint8_t node) noexcept;
  void take_gripper_status(const Frame& frame) noexcept;
  void take_force_torque(const Frame& frame) noexcept;
  void take_gripper_answer(const Frame& frame) noexcept;
  bool take_identity(const Frame& frame, std::uint8_t node, NodeNotice& notice) noexcept;
  bool accept_answer(std::uint32_t bit, std::uint8_t node, std::uint16_t cycle_echo) noexcept;
  void take_from_host(const Frame& frame) noexcept;

  struct JointValues {
    std::int8_t state = 0;
    std::int16_t faults = 0;
    double position_rad = 0.0, velocity_rad_s = 0.0, torque_Nm = 0.0;
  };
  struct GripperValues {
    std::int8_t state = 0;
    std::int16_t faults = 0;
    double opening_m = 0.0, speed_m_s = 0.0, force_N = 0.0;
  };
  struct ForceTorqueValues {
    std::int16_t status = 0;
    std::array<double, 3> force_N{}, moment_Nm{};
  };

  int limb_;
  std::size_t driven_;       ///< joints of this limb
  std::uint32_t nodes_ = 0;  ///< of this limb
  std::array<std::uint8_t, CRUX_CAN_JOINTS> node_of_joint_{};
  std::array<int, CRUX_CAN_NODES + 1> joint_of_node_{};
  std::array<float, CRUX_CAN_JOINTS> kp_Nm_rad_{}, kd_Nms_rad_{};
  CommandFrames command_frames_;
  std::uint32_t parameter_hash_ = 0;  ///< what nodes made for this robot description say

  std::array<Frame, kMaxFrames> frames_{};
  std::size_t n_frames_ = 0;
  std::array<std::uint8_t, kStandardIds> send_counters_{};
  std::array<crux_e2e_receiver, kStandardIds> receivers_{};

  // Of the frames that answer a Sync, by node; the wrench has the place of a node 0, the answer to a broadcast the
  // last.
  static constexpr std::size_t kWrenchStream = 0, kAnswerStream = CRUX_CAN_NODES + 1, kStreams = CRUX_CAN_NODES + 2;
  std::array<StreamWatch, kStreams> streams_;
  std::array<int, CRUX_CAN_NODES + 1> disputed_{};  ///< cycles yet in which no answer of the node is believed
  bool believed_ = false;                           ///< the answer just received is its node's

  std::uint16_t awaited_cycle_ = 0;
  std::uint32_t answered_ = 0;
  std::uint32_t fresh_ = 0;                             ///< of these, what came from nodes that are known
  std::uint32_t identified_nodes_ = 0;                  ///< who has told this run the right identity
  std::uint32_t introduced_ = 0;                        ///< who has done so since the last pack_cycle
  std::uint8_t asked_node_ = 0;                         ///< last
  std::array<NodeNotice, CRUX_CAN_NODES + 1> wrong_{};  ///< the wrong identity last heard, node 0: none
  std::array<int, CRUX_CAN_NODES + 1> silence_{};       ///< cycles without an answer or identity
  int silent_cycles_;
  bool foreign_host_ = false;
  std::uint32_t restarted_ = 0;  ///< nodes that said so since the last pack_cycle; their statuses may be newer already
  std::int64_t sync_stamp_ns_ = 0, answer_stamp_ns_ = 0;
  std::array<JointValues, CRUX_CAN_JOINTS> joints_{};
  GripperValues gripper_;
  ForceTorqueValues force_torque_;
  LimbStatistics statistics_;
};

}  // namespace crux
