"""ros2msg definitions: the text that MCAP readers use to decode the CDR payloads."""

from __future__ import annotations

from .lcm_types import Field, Struct

_ROS_TYPES = {
    "int8_t": "int8",
    "int16_t": "int16",
    "int32_t": "int32",
    "int64_t": "int64",
    "byte": "uint8",
    "double": "float64",
    "float": "float32",
    "string": "string",
}
_SEPARATOR = "=" * 80


def _field_line(member: Field, structs: dict[str, Struct]) -> str:
    if member.is_primitive:
        ros_type = _ROS_TYPES[member.type]
    else:
        nested = structs[member.type]
        ros_type = f"{nested.package}/{nested.ros_name}"
    if member.dimension is None:
        suffix = ""
    elif isinstance(member.dimension, int):
        suffix = f"[{member.dimension}]"
    else:
        suffix = "[]"
    return f"{ros_type}{suffix} {member.name}"


def _own_lines(struct: Struct, structs: dict[str, Struct]) -> list[str]:
    constants = [f"{_ROS_TYPES[c.type]} {c.name}={c.value}" for c in struct.constants]
    return constants + [_field_line(member, structs) for member in struct.fields]


def _nested(struct: Struct, structs: dict[str, Struct], seen: list[str]) -> list[str]:
    for member in struct.fields:
        if not member.is_primitive and member.type not in seen:
            seen.append(member.type)
            _nested(structs[member.type], structs, seen)
    return seen


def definition(struct: Struct, structs: dict[str, Struct]) -> str:
    """The concatenated definition of one type: its own members, then every nested type once."""
    lines = _own_lines(struct, structs)
    for name in _nested(struct, structs, []):
        nested = structs[name]
        lines += [_SEPARATOR, f"MSG: {nested.package}/{nested.ros_name}", *_own_lines(nested, structs)]
    return "\n".join(lines) + "\n"
