// crux-recompute: computes the cycles of a log again. It reads what the control core was given, plans and the inputs of
// one cycle after the other, from standard input, and writes what the core makes of them to standard output. The core
// is a function of these alone, so the same code gives the same bits; `crux replay --check` compares them.
//
// Standard input: records of one byte kind, four bytes length (little-endian), a CDR message (plan_t, control_input_t,
// restart_t).
// Standard output, for every control_input_t: a control_output_t and a robot_state_t, length and CDR message.

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/control_core.hpp"
#include "core/robot/robot_reader.hpp"
#include "crux_msgs/cdr.hpp"

namespace {

using namespace crux;

constexpr int kDone = 0, kFailed = 1, kWrongUsage = 2;
constexpr std::uint8_t kPlan = 0, kCycle = 1, kRestart = 2;
constexpr std::size_t kMaxRecord_bytes = std::size_t{64} << 20U;

struct Record {
  std::uint8_t kind = 0;
  std::vector<std::uint8_t> message;
};

/// False at the end of the input.
bool read_record(Record& record) {
  std::array<std::uint8_t, 5> head{};
  const std::size_t got = std::fread(head.data(), 1, head.size(), stdin);
  if (got == 0) return false;
  const std::size_t length =
      head[1] | (std::size_t{head[2]} << 8U) | (std::size_t{head[3]} << 16U) | (std::size_t{head[4]} << 24U);
  if (got != head.size() || length > kMaxRecord_bytes) throw std::runtime_error("a record without a sensible length");
  record.kind = head[0];
  record.message.resize(length);
  if (std::fread(record.message.data(), 1, length, stdin) != length) throw std::runtime_error("a record is cut off");
  return true;
}

template <class Message>
void write_message(const Message& message, std::vector<std::uint8_t>& buffer) {
  buffer.resize(crux_msgs::cdr_size(message));
  const std::size_t length = crux_msgs::encode_cdr(message, buffer);
  const std::array<std::uint8_t, 4> head = {static_cast<std::uint8_t>(length), static_cast<std::uint8_t>(length >> 8U),
                                            static_cast<std::uint8_t>(length >> 16U),
                                            static_cast<std::uint8_t>(length >> 24U)};
  if (std::fwrite(head.data(), 1, head.size(), stdout) != head.size() ||
      std::fwrite(buffer.data(), 1, length, stdout) != length)
    throw std::runtime_error("standard output is closed");
}

void take_plan(ControlCore& core, std::span<const std::uint8_t> bytes) {
  crux_msgs::plan_t plan;
  if (!crux_msgs::decode_cdr(bytes, plan)) throw std::runtime_error("a plan that is no plan_t");
  if (const std::string refusal = core.load_plan(plan); !refusal.empty())
    throw std::runtime_error("the plan is refused: " + refusal);
}

void restore(ControlCore& core, std::span<const std::uint8_t> bytes) {
  crux_msgs::restart_t left;
  if (!crux_msgs::decode_cdr(bytes, left)) throw std::runtime_error("a restart that is no restart_t");
  core.restore(left);
}

void recompute(const RobotDescription& robot) {
  ControlCore core(robot);
  const auto result = std::make_unique<CycleResult>();
  const auto input = std::make_unique<crux_msgs::control_input_t>();
  std::vector<std::uint8_t> buffer;
  for (Record record; read_record(record);) {
    if (record.kind == kPlan) {
      take_plan(core, record.message);
    } else if (record.kind == kRestart) {
      restore(core, record.message);
    } else if (record.kind == kCycle && crux_msgs::decode_cdr(record.message, *input)) {
      core.step(*input, *result);
      write_message(result->output, buffer);
      write_message(result->state, buffer);
    } else {
      throw std::runtime_error("a record that is no control_input_t");
    }
  }
  if (std::fflush(stdout) != 0) throw std::runtime_error("standard output is closed");
}

}  // namespace

int main(int count, char** arguments) {
  const std::vector<std::string> words(arguments + std::min(count, 1), arguments + count);
  std::string as_sha256;  // of the robot that plans were made for, empty for this one
  bool calibrates = false, understood = !words.empty();
  for (std::size_t i = 1; i < words.size() && understood; ++i) {
    if (words[i] == "--calibrate")
      calibrates = true;
    else if (words[i] == "--as" && i + 1 < words.size())
      as_sha256 = words[++i];
    else
      understood = false;
  }
  if (!understood) {
    std::fputs(
        "usage: crux-recompute ROBOT_FOLDER [--calibrate] [--as ROBOT_SHA256] <records >results; `crux replay "
        "LOG --check` starts it\n",
        stderr);
    return kWrongUsage;
  }
  try {
    Result<RobotDescription> robot = load_robot((std::filesystem::path(words.front()) / "robot.yaml").string());
    if (!robot) {
      std::fprintf(stderr, "crux-recompute: %s\n", robot.reason().c_str());
      return kWrongUsage;
    }
    robot.value().calibrates = calibrates;
    if (!as_sha256.empty()) robot.value().sha256 = as_sha256;  // plans for that one are taken
    recompute(robot.value());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "crux-recompute: %s\n", error.what());
    return kFailed;
  }
  return kDone;
}
