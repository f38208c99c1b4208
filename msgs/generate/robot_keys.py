"""Reads robot_keys.yaml: the keys of robot.yaml, and what each may hold."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from crux_contracts.robot_bounds import MAX_ANGLE_RAD, MAX_LENGTH_M

from .tables import TableError, document

# The range where a key names none.
RANGES = {"number": "positive", "integer": "count", "per_joint": "not_negative", "interval": "not_negative"}
NAMES = ("text", "file", "names", "nodes")
MOST = {"m": MAX_LENGTH_M, "rad": MAX_ANGLE_RAD}


@dataclass(frozen=True)
class Key:
    """`section` is empty at the top of the file, "limbs" for the keys of each limb. `count` is the length of a list, 0
    where it goes by the joints. A key with a `default`, that of each joint, may be left out."""

    section: str
    name: str
    type: str
    unit: str
    low: float
    high: float
    count: int
    default: float | None
    means: str


@dataclass(frozen=True)
class Section:
    """`keys` are its own ones; the `shared` ones come before them."""

    name: str
    means: str
    shared: Section | None
    keys: tuple[Key, ...]

    @property
    def type_name(self) -> str:
        """Of the struct or class."""
        return "".join(part.capitalize() for part in self.name.split("_"))

    @property
    def optional(self) -> bool:
        """The file may leave it out."""
        return all(key.default is not None for key in self.all_keys)

    @property
    def all_keys(self) -> tuple[Key, ...]:
        return (*(self.shared.keys if self.shared else ()), *self.keys)


@dataclass(frozen=True)
class RobotKeys:
    """`names` are the keys of names, at the top and of the limbs; `sections` hold numbers."""

    names: dict[str, tuple[Key, ...]]
    shared: tuple[Section, ...]
    sections: tuple[Section, ...]

    def rows(self) -> list[Key]:
        """Every key of every section, in the order of the file."""
        numbers = (
            Key(**(vars(key) | {"section": section.name})) for section in self.sections for key in section.all_keys
        )
        return [*chain(*self.names.values()), *numbers]


def read_robot_keys(path: Path) -> RobotKeys:
    """The table. Raises TableError."""
    table = document(path)
    try:
        names = {section: _keys(section, table[section or "top"], table["ranges"]) for section in ("", "limbs", "limb")}
        shared = {entry["section"]: _section(entry, {}, table["ranges"]) for entry in table["shared"]}
        sections = tuple(_section(entry, shared, table["ranges"]) for entry in table["sections"])
    except (KeyError, TypeError, ValueError) as error:
        raise TableError(f"{path}: {type(error).__name__}: {error}") from None
    keys = RobotKeys(names, tuple(shared.values()), sections)
    rows = [(key.section, key.name) for key in keys.rows()]
    if twice := {row for row in rows if rows.count(row) > 1}:
        raise TableError(f"{path}: these keys stand there twice: {sorted(twice)}")
    return keys


def _section(entry: dict[str, Any], shared: dict[str, Section], ranges: dict[str, list[float]]) -> Section:
    includes = shared[entry["includes"]] if "includes" in entry else None
    return Section(entry["section"], entry["means"], includes, _keys(entry["section"], entry["keys"], ranges))


def _keys(section: str, entries: list[dict[str, Any]], ranges: dict[str, list[float]]) -> tuple[Key, ...]:
    return tuple(_key(section, ranges, **entry) for entry in entries)


def _key(
    section: str,
    ranges: dict[str, list[float]],
    *,
    key: str,
    means: str,
    type: str = "number",
    unit: str = "",
    range: str | list[float] = "",
    count: int = 0,
    default: float | None = None,
) -> Key:
    if type not in (*RANGES, *NAMES):
        raise ValueError(f"{section}.{key}: {type} is no type")
    if unit and not key.endswith("_" + re.sub("[ /]", "_", unit)):
        raise ValueError(f"{section}.{key} does not end with its unit, {unit}")
    named = range or RANGES.get(type, "not_negative")
    low, high = ranges[named] if isinstance(named, str) else named
    high = min(high, MOST.get(unit, high))
    low = -high if type == "interval" else low
    if default is not None and (type not in ("number", "per_joint") or not low <= default <= high):
        raise ValueError(f"{section}.{key}: {default} is no default of it")
    count = 2 if type == "interval" else count
    return Key(section, key, type, unit, low, high, count, default, means)
