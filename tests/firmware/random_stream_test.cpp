// A hundred thousand frames of good, forged, stale, damaged and senseless traffic with gaps, lost sensors and host
// restarts, against a model that knows which frames were good. Whatever comes, joints keep the hold law of the last
// good command and grippers do not open unless a good command asks.
#include <algorithm>
#include <random>

#include "node_fixture.hpp"

namespace crux::firmware {
namespace {

constexpr int kFrames = 100000;

class Traffic {
 public:
  explicit Traffic(unsigned seed) : random_(seed) {}
  bool chance(double probability) { return std::bernoulli_distribution(probability)(random_); }
  int whole(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  // A multiple of `step`, as the bus can carry it.
  float number(float low, float high, float step) {
    return static_cast<float>(whole(static_cast<int>(low / step), static_cast<int>(high / step))) * step;
  }

 private:
  std::mt19937 random_;
};

// Counter of one identifier as the host keeps it, and what the node must make of it.
struct Line {
  std::uint8_t counter = 0;
  int silent_periods = kWatchdogCycles;  // before the first frame every counter is good
  bool heard = false;
  int step = kWatchdogCycles;  // of the last good counter
  int whole = 0;               // frames with a right CRC since the last good Sync, whoever sent them
  crux_frame last{};           // the last good one

  bool lapsed() const { return silent_periods >= kWatchdogCycles; }
  std::uint8_t good(Traffic& traffic) {
    step = lapsed() ? kWatchdogCycles : traffic.whole(1, traffic.chance(0.1) ? 5 : 1);
    counter = static_cast<std::uint8_t>(lapsed() ? traffic.whole(0, 255) : counter + step);
    ++whole;
    heard = true;
    silent_periods = 0;
    return counter;
  }
  std::uint8_t stale(Traffic& traffic) const {
    const int off = traffic.chance(0.3) ? 0 : traffic.whole(kWatchdogCycles + 1, 255);
    return static_cast<std::uint8_t>(counter + off);
  }
  void tick() {
    silent_periods = heard ? 0 : silent_periods + 1;
    heard = false;
  }
};

crux_frame damaged(crux_frame frame, Traffic& traffic) {
  const int bit = traffic.whole(0, frame.length * 8 - 1);
  frame.data[bit / 8] = static_cast<std::uint8_t>(frame.data[bit / 8] ^ (1U << (bit % 8)));
  return frame;
}

crux_frame noise(Traffic& traffic) {
  crux_frame frame{};
  frame.id = static_cast<std::uint16_t>(traffic.whole(0, 0x7FF));
  frame.length = static_cast<std::uint8_t>(traffic.whole(0, 64));
  for (auto& byte : frame.data) {
    byte = static_cast<std::uint8_t>(traffic.whole(0, 255));
  }
  return frame;
}

// What both kinds of node must have in mind after each period.
template <typename Command>
struct Model {
  Line commands;
  Line syncs;
  bool waiting = false;
  bool fresh = false;
  int silent_periods = kWatchdogCycles;
  int rival_periods = 0;  // for which nothing is taken over
  bool tracking = false;
  bool latched = false;
  bool fault = false;
  bool obeyed = false;  // in the last period, as TRACK
  bool undone = false;  // in the last period: what was obeyed last
  Command pending{};
  Command taken{};

  // A whole frame out of sequence. Where one was there before it, and it is not the same, there are two senders.
  void stale(Line& line, const crux_frame& frame) {
    if (std::equal(frame.data, frame.data + frame.length, line.last.data)) {
      return;
    }
    ++line.whole;
    if (static_cast<std::uint8_t>(line.counter - frame.data[2]) <= kWatchdogCycles) {
      rival_periods = kWatchdogCycles;
      fresh = false;
    }
  }
  void tick(bool measured) {
    obeyed = undone = false;
    if (!measured && !fault) {
      fault = true;
      latched = true;
      tracking = false;
    }
    if (fresh) {
      silent_periods = 0;
      if (taken.mode == CRUX_MODE_REARM) {
        if (measured) {
          fault = false;
        }
        if (!fault) {
          latched = false;
          tracking = false;
        }
      } else if (taken.mode == CRUX_MODE_HOLD) {
        tracking = false;
      } else if (!latched) {
        tracking = obeyed = true;
      }
    } else if (rival_periods > 0 || ++silent_periods == kWatchdogCycles) {
      undone = tracking && rival_periods > 0;
      latched = latched || tracking;
      tracking = false;
      silent_periods = kWatchdogCycles;
    }
    rival_periods = std::max(rival_periods - 1, 0);
    fresh = false;
    commands.tick();
    syncs.tick();
  }
};

// Sends one frame of any quality. Only good ones reach the model.
template <typename Node, typename Command>
void send_one(Node& node, Model<Command>& model, Traffic& traffic, const Command& command, const Command& senseless) {
  const int kind = traffic.whole(0, 9);
  if (kind <= 4) {
    node.hear(model.commands.last = frame_of(command, model.commands.good(traffic)));
    model.pending = command;
    model.waiting = true;
  } else if (kind == 5) {
    node.hear(damaged(frame_of(command, static_cast<std::uint8_t>(model.commands.counter + 1)), traffic));
  } else if (kind == 6 && !model.commands.lapsed()) {
    const crux_frame frame = frame_of(command, model.commands.stale(traffic));
    node.hear(frame);
    model.stale(model.commands, frame);
  } else if (kind == 7) {
    // whole and in sequence: it uses its counter up, but says nothing
    node.hear(model.commands.last = frame_of(senseless, model.commands.good(traffic)));
  } else if (kind == 8 && !model.syncs.lapsed()) {
    const crux_frame frame = sync_frame(1, model.syncs.stale(traffic));
    node.hear(frame);
    model.stale(model.syncs, frame);
  } else {
    node.hear(noise(traffic));
  }
}

template <typename Node, typename Command>
void send_sync(Node& node, Model<Command>& model, Traffic& traffic) {
  model.syncs.last = sync_frame(++node.cycle, model.syncs.good(traffic));
  node.hear(model.syncs.last);
  // One command a Sync: of more, nobody knows which is the host's.
  if (model.waiting && model.commands.whole <= model.syncs.step && model.rival_periods == 0) {
    model.fresh = true;
    model.taken = model.pending;
  }
  model.waiting = false;
  model.commands.whole = 0;
}

unsigned any_mode(Traffic& traffic) {
  const int roll = traffic.whole(0, 9);
  return static_cast<unsigned>(roll < 7 ? CRUX_MODE_TRACK : (roll < 9 ? CRUX_MODE_REARM : CRUX_MODE_HOLD));
}

TEST(RandomStream, JointsKeepTheLawOfTheLastGoodCommand) {
  Traffic traffic(20250101);
  const crux_joint_parameters limits = joint_parameters();
  Joint joint;
  Model<JointCommand> model;
  joint.tick();  // takes the first measurement as its setpoint
  float kp = limits.position_gain_Nm_rad;
  float kd = limits.velocity_gain_Nms_rad;
  float feedforward_Nm = 0.0F;
  float fault_Nm = 0.0F;
  float seen_rad = 0.0F;
  crux_joint_law remembered{};
  int frames = 0;
  int tracked = 0;
  int undone = 0;
  int latched = 0;
  int faults = 0;
  for (int quiet = 0; frames < kFrames; --quiet) {
    const bool was_fault = model.fault;
    const float before_rad = joint.node.setpoint_rad;
    if (quiet <= 0) {
      const JointCommand command{.mode = any_mode(traffic),
                                 .position_rad = traffic.number(-3.0F, 3.0F, 0.0001F),
                                 .velocity_rad_s = traffic.number(-6.0F, 6.0F, 0.001F),
                                 .torque_Nm = traffic.number(-12.0F, 12.0F, 0.001F),
                                 .kp = traffic.number(1.0F, 300.0F, 0.01F),
                                 .kd = traffic.number(0.0F, 10.0F, 0.001F)};
      JointCommand senseless = command;
      const int how = traffic.whole(0, 2);
      senseless.position_rad = how == 0 ? kNaN : senseless.position_rad;
      senseless.mode = static_cast<unsigned>(how == 1 ? traffic.whole(3, 15) : int{CRUX_MODE_TRACK});
      senseless.kp = how == 2 ? 0.0F : senseless.kp;
      for (int n = traffic.whole(0, 3); n > 0; --n, ++frames) {
        send_one(joint, model, traffic, command, senseless);
      }
      if (traffic.chance(0.9)) {
        send_sync(joint, model, traffic);
        ++frames;
      }
      quiet = traffic.chance(0.01) ? traffic.whole(2, 40) : 1;
    }
    const bool measured = !traffic.chance(0.002);
    joint.inputs.position_rad = measured ? joint.node.setpoint_rad + traffic.number(-0.1F, 0.1F, 0.0001F) : kNaN;
    joint.inputs.velocity_rad_s = traffic.number(-5.0F, 5.0F, 0.001F);
    const float torque_Nm = joint.tick();
    model.tick(measured);
    if (!measured && !was_fault) {
      fault_Nm = std::clamp(kp * (before_rad - seen_rad) + feedforward_Nm, -10.0F, 10.0F);
    }
    if (was_fault && !model.fault) {
      feedforward_Nm = fault_Nm;
    }
    if (model.obeyed) {
      remembered.setpoint_rad = before_rad;
      remembered.feedforward_Nm = feedforward_Nm;
      remembered.position_gain_Nm_rad = kp;
      remembered.velocity_gain_Nms_rad = kd;
      kp = model.taken.kp;
      kd = model.taken.kd;
      feedforward_Nm = std::clamp(model.taken.torque_Nm, -10.0F, 10.0F);
    } else if (model.undone) {
      kp = remembered.position_gain_Nm_rad;
      kd = remembered.velocity_gain_Nms_rad;
      feedforward_Nm = remembered.feedforward_Nm;
    }
    const float law_Nm = kp * (joint.node.setpoint_rad - joint.inputs.position_rad) +
                         kd * (joint.node.velocity_setpoint_rad_s - joint.inputs.velocity_rad_s) + feedforward_Nm;
    ASSERT_NEAR(torque_Nm, model.fault ? fault_Nm : std::clamp(law_Nm, -10.0F, 10.0F), 2e-3F) << "frame " << frames;
    ASSERT_EQ(joint.node.state == CRUX_STATE_TRACK, model.tracking) << "frame " << frames;
    ASSERT_EQ(joint.node.state == CRUX_STATE_FAULT, model.fault) << "frame " << frames;
    ASSERT_EQ(joint.node.latched, model.latched) << "frame " << frames;
    if (!was_fault && !model.fault) {
      const float from_rad = model.undone ? remembered.setpoint_rad : before_rad;
      ASSERT_LE(std::abs(joint.node.setpoint_rad - from_rad), limits.velocity_limit_rad_s * kDt * 1.001F);
      ASSERT_GE(joint.node.setpoint_rad, limits.position_min_rad - 0.1F);
      ASSERT_LE(joint.node.setpoint_rad, limits.position_max_rad + 0.1F);
    }
    seen_rad = model.fault ? seen_rad : joint.inputs.position_rad;
    tracked += model.tracking ? 1 : 0;
    undone += model.undone ? 1 : 0;
    latched += model.latched ? 1 : 0;
    faults += model.fault ? 1 : 0;
    take_all(joint.node.link);
  }
  // The traffic must have been everywhere for this to say something.
  EXPECT_GT(tracked, 1000);
  EXPECT_GT(undone, 100);
  EXPECT_GT(latched, 1000);
  EXPECT_GT(faults, 100);
  EXPECT_GT(joint.node.link.counters.timeouts, 100U);
}

TEST(RandomStream, GrippersOpenOnlyWhenAGoodCommandAsks) {
  Traffic traffic(20250102);
  const crux_gripper_parameters limits = gripper_parameters();
  Gripper gripper;
  Model<GripperCommand> model;
  gripper.tick();  // takes the first measurement as its setpoint
  float force_limit_N = limits.force_limit_N;
  float remembered_m = 0.0F;
  float remembered_N = 0.0F;
  int frames = 0;
  int opened = 0;
  int undone = 0;
  int latched = 0;
  for (int quiet = 0; frames < kFrames; --quiet) {
    const float before_m = gripper.node.setpoint_m;
    if (quiet <= 0) {
      const GripperCommand command{.mode = any_mode(traffic),
                                   .opening_m = traffic.number(0.0F, 0.08F, 0.0001F),
                                   .speed_limit_m_s = traffic.number(0.0F, 0.05F, 0.0001F),
                                   .force_limit_N = traffic.number(1.0F, 100.0F, 0.01F)};
      GripperCommand senseless = command;
      const int how = traffic.whole(0, 2);
      senseless.opening_m = how == 0 ? kNaN : 0.066F;
      senseless.mode = static_cast<unsigned>(how == 1 ? traffic.whole(3, 15) : int{CRUX_MODE_TRACK});
      senseless.force_limit_N = how == 2 ? 0.0F : 60.0F;
      for (int n = traffic.whole(0, 3); n > 0; --n, ++frames) {
        send_one(gripper, model, traffic, command, senseless);
      }
      if (traffic.chance(0.9)) {
        send_sync(gripper, model, traffic);
        ++frames;
      }
      quiet = traffic.chance(0.01) ? traffic.whole(2, 40) : 1;
    }
    const bool measured = !traffic.chance(0.002);
    // The load pries the fingers open or squeezes them, up to more than the force limit is worth.
    const float opening_m = std::clamp(before_m + traffic.number(-0.004F, 0.006F, 0.00001F), 0.006F, 0.068F);
    const bool was_fault = model.fault;
    gripper.inputs.opening_m = measured ? opening_m : kNaN;
    gripper.inputs.speed_m_s = traffic.number(-0.02F, 0.02F, 0.001F);
    const float force_N = gripper.tick();
    model.tick(measured);
    if (model.obeyed) {
      remembered_m = before_m;
      remembered_N = force_limit_N;
      force_limit_N = std::min(model.taken.force_limit_N, limits.force_limit_N);
    } else if (model.undone) {
      force_limit_N = std::max(force_limit_N, remembered_N);
    }
    const float from_m = model.undone ? std::min(remembered_m, before_m) : before_m;
    ASSERT_EQ(gripper.node.state == CRUX_STATE_TRACK, model.tracking) << "frame " << frames;
    ASSERT_EQ(gripper.node.latched, model.latched) << "frame " << frames;
    ASSERT_LE(std::abs(force_N), force_limit_N + 1e-3F);
    const bool asked = model.tracking && model.taken.opening_m > from_m;
    if (!model.tracking) {
      ASSERT_GE(force_N, 0.0F) << "frame " << frames;
    }
    if (!model.tracking && !was_fault && !model.fault) {
      ASSERT_FLOAT_EQ(gripper.node.setpoint_m, from_m) << "frame " << frames;
      const float law_N = limits.stiffness_N_m * (opening_m - from_m) + limits.damping_Ns_m * gripper.inputs.speed_m_s;
      ASSERT_NEAR(force_N, std::clamp(law_N, 0.0F, force_limit_N), 0.05F) << "frame " << frames;
    }
    if (gripper.node.setpoint_m > from_m + 1e-7F && !asked && !was_fault) {
      // Overpowered: the setpoint is dragged along, but the fingers squeeze with all that is allowed.
      ASSERT_NEAR(force_N, force_limit_N, std::abs(200.0F * gripper.inputs.speed_m_s) + 0.05F) << "frame " << frames;
    }
    opened += asked ? 1 : 0;
    undone += model.undone ? 1 : 0;
    latched += model.latched ? 1 : 0;
    take_all(gripper.node.link);
  }
  EXPECT_GT(opened, 1000);
  EXPECT_GT(undone, 100);
  EXPECT_GT(latched, 1000);
}

}  // namespace
}  // namespace crux::firmware
