"""C++ headers of the channel table, the fault table and the ros2msg schemas."""

from __future__ import annotations

from .lcm_types import Struct
from .ros2msg import definition
from .tables import Channel, Fault

_BANNER = "// Generated from {origin} by msgs/generate. Do not edit.\n#pragma once\n"


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.lower().split("_"))


def channels_header(channels: list[Channel], structs: dict[str, Struct], log_format: int) -> str:
    entries = "\n".join(
        f'    ChannelInfo{{Channel::k{_camel(c.name.removeprefix("CRUX_"))}, "{c.name}", "{c.type}", '
        f'"{structs[c.type].schema_name}", "{c.topic}", {c.rate_Hz}, Writer::k{_camel(c.writer)}, '
        f"{str(c.logged).lower()}, {c.log_every}, {str(c.per_limb).lower()}}},"
        for c in channels
    )
    names = ", ".join(f"k{_camel(c.name.removeprefix('CRUX_'))}" for c in channels)
    return f"""{_BANNER.format(origin="msgs/channels.yaml")}
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace crux_msgs {{

enum class Channel : std::uint8_t {{ {names} }};
enum class Writer : std::uint8_t {{ kTools, kRuntime }};

inline constexpr int kLogFormat = {log_format};
inline constexpr double kEventRate = -1.0;  // sent when something happens

struct ChannelInfo {{
  Channel channel;
  const char* name;  // LCM channel
  std::string_view type;
  std::string_view schema_name;
  std::string_view topic;  // in the log; empty when not logged
  double rate_Hz;          // on LCM; 0: only logged
  Writer writer;
  bool logged;
  int log_every;           // control cycles, counted from the first
  bool per_limb;           // in the log each limb has a topic of its own: /LF and so on before `topic`
}};

inline constexpr std::array<ChannelInfo, {len(channels)}> kChannels = {{{{
{entries}
}}}};

constexpr const ChannelInfo& channel_info(Channel channel) {{ return kChannels[static_cast<std::size_t>(channel)]; }}

}}  // namespace crux_msgs
"""


def faults_header(faults: list[Fault]) -> str:
    names = "\n".join(f"  k{_camel(f.name)} = {f.code}," for f in faults)
    entries = "\n".join(
        f'    FaultInfo{{FaultCode::k{_camel(f.name)}, "{f.name}", robot_state_t::{f.to}, '
        f'{str(f.recovers).lower()}, "{f.text}"}},'
        for f in faults
    )
    return f"""{_BANNER.format(origin="msgs/faults.yaml")}
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "crux_msgs/robot_state_t.hpp"

namespace crux_msgs {{

enum class FaultCode : std::int16_t {{
  kNone = 0,
{names}
}};

struct FaultInfo {{
  FaultCode code;
  std::string_view name;
  std::int8_t to;         // supervisor state that follows, as in robot_state_t
  bool recovers;          // ends by itself when the link to the nodes is well again
  std::string_view text;  // {{value}} and {{limit}} stand for fault_t's numbers
}};

inline constexpr std::array<FaultInfo, {len(faults)}> kFaults = {{{{
{entries}
}}}};

/// nullptr for kNone and for unknown codes.
constexpr const FaultInfo* fault_info(std::int16_t code) {{
  return code >= 1 && static_cast<std::size_t>(code) <= kFaults.size() ? &kFaults[static_cast<std::size_t>(code) - 1]
                                                                      : nullptr;
}}

}}  // namespace crux_msgs
"""


def ros2msg_header(structs: dict[str, Struct]) -> str:
    entries = "\n".join(
        f"template <>\nstruct Ros2Schema<{s.name}> {{\n"
        f'  static constexpr std::string_view kName = "{s.schema_name}";\n'
        f'  static constexpr std::string_view kDefinition = R"ros2msg({definition(s, structs)})ros2msg";\n}};'
        for s in structs.values()
    )
    types = "\n".join(
        f'  if (type == "{s.name}") return {{Ros2Schema<{s.name}>::kName, Ros2Schema<{s.name}>::kDefinition}};'
        for s in structs.values()
    )
    includes = "\n".join(f'#include "crux_msgs/{n}.hpp"' for n in sorted(structs))
    return f"""{_BANNER.format(origin="msgs/lcm")}
#include <string_view>

{includes}

namespace crux_msgs {{

/// MCAP schema of a message type: encoding "ros2msg".
template <class Message>
struct Ros2Schema;

{entries}

struct Ros2SchemaText {{
  std::string_view name;
  std::string_view definition;
}};

/// Schema by the type's name ("plan_t"); empty for an unknown name.
constexpr Ros2SchemaText ros2_schema(std::string_view type) {{
{types}
  return {{}};
}}

}}  // namespace crux_msgs
"""
