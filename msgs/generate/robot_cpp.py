"""C++ header of what a robot description must be: keys of robot.yaml with their ranges, and bounds of the URDF."""

from __future__ import annotations

from crux_contracts import robot_bounds
from crux_contracts.reading import MAX_TEXT, OTHER_UNITS
from crux_contracts.robot_sections import key_rules
from crux_contracts.yaml_document import MAX_BYTES, MAX_DEPTH


def _bounds() -> str:
    lines = [
        f"inline constexpr {'int' if isinstance(value, int) else 'double'} "
        f"k{''.join(part.capitalize() for part in name.split('_'))} = {value!r};"
        for name, value in vars(robot_bounds).items()
        if name.isupper() and isinstance(value, (int, float))
    ]
    lines.append(f"inline constexpr int kMaxText = {MAX_TEXT};  // characters")
    lines.append(f"inline constexpr int kMaxBytes = {MAX_BYTES};  // of a file")
    lines.append(f"inline constexpr int kMaxDepth = {MAX_DEPTH};  // of YAML")
    return "\n".join(lines)


def header() -> str:
    axes = ", ".join("{{" + ", ".join(map(repr, axis)) + "}}" for axis in robot_bounds.JOINT_AXES)
    units = "\n".join(
        f'    OtherUnit{{"{unit}", {factor!r}, "{name}"}},'
        for unit, others in OTHER_UNITS.items()
        for factor, name in others
    )
    kinds = {
        "number": "kNumber",
        "integer": "kInteger",
        "per_joint": "kPerJoint",
        "interval": "kInterval",
        "nodes": "kNodes",
    }
    keys = [
        f'    RobotKey{{"{rule.section}", "{rule.key}", RobotKeyKind::{kinds[rule.kind]}, '
        f'{float(rule.range.low)!r}, {float(rule.range.high)!r}, "{rule.unit}"}},'
        for rule in key_rules()
    ]
    rows = "\n".join(keys)
    return f"""// Generated from msgs/python/crux_contracts by msgs/generate. Do not edit.
#pragma once

#include <array>
#include <string_view>

namespace crux_msgs::robot {{

{_bounds()}
inline constexpr std::array<std::array<double, 3>, {len(robot_bounds.JOINT_AXES)}> kJointAxes = {{{{{axes}}}}};

enum class RobotKeyKind {{ {", ".join(kinds.values())} }};

struct RobotKey {{
  std::string_view section;
  std::string_view key;
  RobotKeyKind kind;
  double low;
  double high;
  std::string_view unit;  // m, rad or empty
}};

/// Every section of robot.yaml has exactly these keys.
inline constexpr std::array<RobotKey, {len(keys)}> kKeys = {{{{
{rows}
}}}};

/// Units that a number may have been written in by mistake: value * factor is in `unit`.
struct OtherUnit {{
  std::string_view unit;
  double factor;
  const char* name;
}};

inline constexpr std::array<OtherUnit, {sum(map(len, OTHER_UNITS.values()))}> kOtherUnits = {{{{
{units}
}}}};

}}  // namespace crux_msgs::robot
"""
