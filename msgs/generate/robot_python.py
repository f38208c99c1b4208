"""Python module of robot.yaml: a dataclass for each section of numbers, and the keys' table."""

from __future__ import annotations

from crux_contracts.robot_bounds import JOINTS

from .robot_keys import Key, RobotKeys, Section

_TYPES = {
    "number": "float",
    "integer": "int",
    "per_joint": f"tuple[{', '.join(['float'] * JOINTS)}]",
    "interval": "tuple[float, float]",
    "nodes": "dict[str, int]",
}


def module(keys: RobotKeys) -> str:
    """crux_msgs/robot_keys.py."""
    classes = "\n\n".join(_dataclass(section) for section in (*keys.shared, *keys.sections))
    members = "\n".join(f"    {section.name}: {section.type_name}" for section in keys.sections)
    types = "\n".join(f'    "{section.name}": {section.type_name},' for section in keys.sections)
    rows = "\n".join(f"    Key{tuple(vars(key).values())!r}," for key in keys.rows())
    means = "\n".join(f"    {section.name!r}: {section.means!r}," for section in keys.sections)
    return f'''"""Generated from msgs/robot_keys.yaml by msgs/generate. Do not edit.

Units stand in the names; a tuple of {JOINTS} has one value a joint, shoulder outwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple


{classes}

@dataclass(frozen=True)
class Sections:
    """The sections of robot.yaml that hold numbers."""

{members}


SECTIONS: dict[str, Any] = {{
{types}
}}
# section -> what it holds
MEANS: dict[str, str] = {{
{means}
}}


class Key(NamedTuple):
    """`section` is empty at the top of the file, "limbs" for the keys of each limb; `count` is the length of a list."""

    section: str
    name: str
    type: str
    unit: str
    low: float
    high: float
    count: int
    means: str


KEYS: list[Key] = [
{rows}
]
'''


def _dataclass(section: Section) -> str:
    base = f"({section.shared.type_name})" if section.shared else ""
    return (
        f'@dataclass(frozen=True)\nclass {section.type_name}{base}:\n    """{_sentence(section.means)}"""\n\n'
        + "\n".join(map(_field, section.keys))
        + "\n"
    )


def _field(key: Key) -> str:
    return f'    {key.name}: {_TYPES[key.type]}\n    """{_sentence(key.means)}"""'


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."
