"""Python module of robot.yaml: a dataclass for each of its sections, whose fields are their keys."""

from __future__ import annotations

from crux_contracts.robot_bounds import MOST_JOINTS

from .robot_keys import Key, RobotKeys

_TYPES = {
    "number": "float",
    "integer": "int",
    "per_joint": "tuple[float, ...]",
    "interval": "tuple[float, float]",
    "text": "str",
    "file": "str",
    "names": "tuple[str, ...]",
    "nodes": "dict[str, int]",
}


def module(keys: RobotKeys) -> str:
    """crux_msgs/robot_keys.py."""
    named = {"Top": ("", "at the top of the file"), "OfLimb": ("limbs", "each limb's bus and names")}
    named["InUrdf"] = ("limb", "names in the URDF, without the prefix")
    names = [_dataclass(name, means, keys.names[section]) for name, (section, means) in named.items()]
    of_numbers = [
        _dataclass(each.type_name + (f"({each.shared.type_name})" if each.shared else ""), each.means, each.keys)
        for each in (*keys.shared, *keys.sections)
    ]
    members = "\n".join(f"    {section.name}: {section.type_name}" for section in keys.sections)
    types = "\n".join(f'    "{section.name}": {section.type_name},' for section in keys.sections)
    classes = "\n\n".join([*names, *of_numbers])
    return f'''"""Generated from msgs/robot_keys.yaml by msgs/generate. Do not edit.

Units stand in the names; a tuple of any length has one value a joint, shoulder outwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from crux_contracts.records import REQUIRED, key


{classes}

@dataclass(frozen=True)
class Sections:
    """The sections of robot.yaml that hold numbers."""

{members}


SECTIONS: dict[str, Any] = {{
{types}
}}
'''


def _dataclass(name: str, means: str, keys: tuple[Key, ...]) -> str:
    fields = "\n".join(map(_field, keys))
    return f'@dataclass(frozen=True)\nclass {name}:\n    """{_sentence(means)}"""\n\n{fields}\n'


def _field(key: Key) -> str:
    default = "REQUIRED" if key.default is None else repr(float(key.default))
    if key.type == "per_joint" and key.default is not None:
        default = f"({default},) * {MOST_JOINTS}"
    told = [default, *map(repr, (key.low, key.high, key.unit, key.means))]
    if key.type in ("file", "names", "nodes"):
        told.append(f"reader={(key.type if key.type == 'file' else key.name)!r}")
    return f'    {key.name}: {_TYPES[key.type]} = key({", ".join(told)})\n    """{_sentence(key.means)}"""'


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."
