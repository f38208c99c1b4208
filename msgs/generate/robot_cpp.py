"""C++ header of what a robot description must be: robot.yaml's keys as structs and as a table, bounds of the URDF."""

from __future__ import annotations

from crux_contracts import LIMB_NAMES, N_LIMBS, robot_bounds
from crux_contracts.reading import MAX_TEXT, OTHER_UNITS
from crux_contracts.robot_bounds import MOST_JOINTS
from crux_contracts.yaml_document import MAX_BYTES, MAX_DEPTH

from .robot_keys import NAMES, RANGES, Key, RobotKeys, Section

_TYPES = {
    "number": "double {} = {!r};",
    "integer": "int {} = 0;",
    "per_joint": "PerJoint {}{{}};",
    "interval": "Interval {};",
    "nodes": "Nodes {};",
}


def _camel(name: str) -> str:
    return f"k{''.join(part.capitalize() for part in name.split('_'))}"


def _bounds() -> str:
    lines = [
        f"inline constexpr {'int' if isinstance(value, int) else 'double'} {_camel(name)} = {value!r};"
        for name, value in vars(robot_bounds).items()
        if name.isupper() and isinstance(value, (int, float))
    ]
    names = ", ".join(f'"{name}"' for name in LIMB_NAMES)
    lines.append(f"inline constexpr int kLimbs = {N_LIMBS};")
    lines.append(f"inline constexpr std::array<const char*, kLimbs> kLimbNames = {{{{{names}}}}};")
    lines.append(f"inline constexpr int kMaxText = {MAX_TEXT};  // characters")
    lines.append(f"inline constexpr int kMaxBytes = {MAX_BYTES};  // of a file")
    lines.append(f"inline constexpr int kMaxDepth = {MAX_DEPTH};  // of YAML")
    return "\n".join(lines)


def _member(key: Key) -> str:
    if key.type == "per_joint" and key.default is not None:
        return f"PerJoint {key.name} = each({float(key.default)!r});"
    return _TYPES[key.type].format(key.name, float(key.default or 0.0))


def _struct(section: Section) -> str:
    base = f" : {section.shared.type_name}" if section.shared else ""
    members = "\n".join(f"  {_member(key)}  ///< {key.means}" for key in section.keys)
    return f"/// {section.means}\nstruct {section.type_name}{base} {{\n{members}\n}};\n"


def _row(key: Key) -> str:
    return (
        f'    RobotKey{{"{key.section}", "{key.name}", RobotKeyType::{_camel(key.type)}, "{key.unit}", '
        f"{float(key.low)!r}, {float(key.high)!r}, {key.count}, {str(key.default is not None).lower()}}},"
    )


def _key_table(keys: RobotKeys) -> str:
    """What each key may hold, and the units that a number may be in by mistake."""
    units = "\n".join(
        f'    OtherUnit{{"{unit}", {factor!r}, "{name}"}},'
        for unit, others in OTHER_UNITS.items()
        for factor, name in others
    )
    rows = keys.rows()
    table = "\n".join(map(_row, rows))
    return f"""enum class RobotKeyType {{ {", ".join(map(_camel, (*RANGES, *NAMES)))} }};

/// What a key of robot.yaml may hold.
struct RobotKey {{
  std::string_view section;  ///< empty: at the top; limbs: of each limb
  std::string_view key;
  RobotKeyType type;
  std::string_view unit;
  double low;
  double high;
  std::size_t count;  ///< of a list
  bool optional;      ///< the struct has its default
}};

/// Every section of robot.yaml has exactly these keys; optional ones may be missing.
inline constexpr std::array<RobotKey, {len(rows)}> kKeys = {{{{
{table}
}}}};

/// Units that a number may have been written in by mistake: value * factor is in `unit`.
struct OtherUnit {{
  std::string_view unit;
  double factor;
  const char* name;
}};

inline constexpr std::array<OtherUnit, {sum(map(len, OTHER_UNITS.values()))}> kOtherUnits = {{{{
{units}
}}}};"""


def header(keys: RobotKeys) -> str:
    """crux_msgs/robot.hpp."""
    structs = "\n".join(map(_struct, (*keys.shared, *keys.sections)))
    members = "\n".join(f"  {section.type_name} {section.name};" for section in keys.sections)
    visits = "\n".join(
        f'  visit("{section.name}", "{key.name}", sections.{section.name}.{key.name});'
        for section in keys.sections
        for key in section.all_keys
    )
    return f"""// Generated from msgs/robot_keys.yaml and msgs/python/crux_contracts by msgs/generate. Do not edit.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace crux_msgs::robot {{

{_bounds()}

using PerJoint = std::array<double, {MOST_JOINTS}>;  ///< shoulder outwards

constexpr PerJoint each(double value) {{
  PerJoint values{{}};
  for (double& one : values) one = value;
  return values;
}}

struct Interval {{
  double low = 0.0;
  double high = 0.0;
}};

/// Numbers on the bus.
struct Nodes {{
  std::array<int, {MOST_JOINTS}> joints{{}};
  int gripper = 0;
}};

{structs}
/// The sections of robot.yaml that hold numbers.
struct Sections {{
{members}
}};

/// Calls visit(section, key, value) for every number of robot.yaml.
template <class Visit>
void each_value(Sections& sections, const Visit& visit) {{
{visits}
}}

{_key_table(keys)}

}}  // namespace crux_msgs::robot
"""
