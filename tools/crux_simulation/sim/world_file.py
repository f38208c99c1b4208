"""World files: what differs in truth from what the plan says, as `crux climb --world FILE` reads it.

Every problem in a file is noted on the way through its YAML nodes. Any number may be drawn: {uniform: [least, most]} or
{normal: [mean, deviation]}; in place of a list of numbers, one such draw for each. examples/world.yaml has every key
with its unit, frame and default.
"""

from __future__ import annotations

import hashlib
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.reading import did_you_mean
from crux_contracts.records import Key, Records
from crux_contracts.scenario import FACE_NAMES
from crux_contracts.yaml_document import MAX_BYTES, DocumentError, Node, Problem, parse_mapping, read_bytes
from crux_msgs import hold_t, plan_t

from crux_simulation.sim.world import (
    AMBIENT_DEGC,
    BY_CHANNEL,
    ERRORS,
    JOINT_NAMES,
    MAX_TIME_S,
    SENSORS,
    SHARES,
    VERSION,
    GripperChange,
    HoldChange,
    JointChange,
    Payload,
    Push,
    SensorError,
    Vector,
    World,
    WorldError,
)

ALL = "all"
MAX_ENTRIES = 1000
SECTIONS = ("holds", "robot", "sensors", "pushes")
ROBOT_KEYS = ("payload", "ambient_degC", "joints", "grippers")
DISTRIBUTIONS = {"uniform": "[least, most]", "normal": "[mean, deviation]"}
_AMBIENT = Key(-40.0, 80.0, "degC")

T = TypeVar("T")


@dataclass(frozen=True)
class WorldSpec:
    """A world file that has been checked, its numbers not yet drawn."""

    name: str
    sha256: str
    path: str
    root: Node = field(repr=False)

    def draw(self, seed: int, plan: plan_t) -> World:
        """The world of this seed on the wall of `plan`. A number's draw depends on the seed and its own place in the
        world alone. Raises WorldError for holds that the plan does not have."""
        reader = _Reader(self.path, seed)
        there = [hold for hold in plan.holds if hold.graspable != hold_t.FOOTHOLD]  # footholds are places, not things
        world = reader.world(self, [hold.name for hold in there], [bool(hold.graspable) for hold in there])
        reader.check.finish(WorldError)
        return world


def read_world(path: Path) -> WorldSpec:
    """Reads and checks a world file. Raises WorldError."""
    try:
        return parse_world(read_bytes(path), str(path))
    except DocumentError as error:
        raise WorldError(error.path, error.problems) from None


def parse_world(data: bytes, path: str = "world") -> WorldSpec:
    """Checks a world given as text; `path` names it in messages. Raises WorldError with all problems found."""
    try:
        if len(data) > MAX_BYTES:
            raise DocumentError(path, [Problem("", f"{len(data)} bytes", f"expected at most {MAX_BYTES} bytes")])
        root = parse_mapping(data, path)
    except DocumentError as error:
        raise WorldError(path, error.problems) from None
    reader = _Reader(path, None)
    keys = reader.check.members(root, ["version", "name"], SECTIONS)
    if "version" in keys:
        reader.check.integer(keys["version"], VERSION, VERSION)
    name = reader.check.text(keys["name"]) if "name" in keys else ""
    spec = WorldSpec(name, hashlib.sha256(data).hexdigest(), path, root)
    reader.world(spec, None, [])
    reader.check.finish(WorldError)
    return spec


class _Reader(Records):
    """Walks a world file. Without a seed it checks; with one it draws, and what it walks has been checked."""

    def __init__(self, path: str, seed: int | None) -> None:
        super().__init__(path)
        self.seed = seed

    def world(self, spec: WorldSpec, holds: Sequence[str] | None, graspable: Sequence[bool]) -> World:
        """`holds`: names in the plan, None: not known yet."""
        root: Any = spec.root.content
        robot = self.check.members(root["robot"], [], ROBOT_KEYS) if "robot" in root else {}
        ambient = (
            self.number(robot["ambient_degC"], _AMBIENT, "robot.ambient_degC") if "ambient_degC" in robot else None
        )
        return World(
            spec.name,
            spec.sha256,
            self.seed or 0,
            self._holds(root["holds"], holds, graspable) if "holds" in root else {},
            self.record(Payload, robot["payload"], place="robot.payload") if "payload" in robot else Payload(),
            AMBIENT_DEGC if ambient is None else ambient,
            self._joints(robot["joints"]) if "joints" in robot else {},
            self._grippers(robot["grippers"]) if "grippers" in robot else {},
            tuple(error for node in self._list(root, "sensors") for error in self._sensor_errors(node)),
            tuple(self.record(Push, node, place=node.key) for node in self._list(root, "pushes")),
        )

    def _list(self, root: dict[str, Node], section: str) -> list[Node]:
        return self.check.items(root[section], MAX_ENTRIES) if section in root else []

    def _mapping(self, node: Node) -> dict[str, Node]:
        if isinstance(node.content, dict):
            return node.content
        self.check.note(node, "expected a mapping")
        return {}

    def _holds(self, node: Node, names: Sequence[str] | None, graspable: Sequence[bool]) -> dict[str, HoldChange]:
        entries = self._mapping(node)
        if names is None:
            return {name: self.record(HoldChange, entry, place=f"holds.{name}") for name, entry in entries.items()}
        chains: dict[str, list[Node]] = {
            name: [entries[ALL]] if ALL in entries and grasped else []
            for name, grasped in zip(names, graspable, strict=True)
        }
        for name, entry in entries.items():
            index = int(name) if name.isdecimal() else -1
            if name in chains:
                chains[name].append(entry)
            elif 0 <= index < len(names):
                chains[names[index]].append(entry)
            elif name != ALL:
                self.check.note_at(entry, "", "", f"no such hold in the plan; {did_you_mean(name, names)}")
        return {name: self.record(HoldChange, *chain, place=f"holds.{name}") for name, chain in chains.items() if chain}

    def _joints(self, node: Node) -> dict[str, JointChange]:
        entries = self.check.members(node, [], [ALL, *LIMB_NAMES, *JOINT_NAMES])
        chains = {name: [key for key in (ALL, name[:2], name) if key in entries] for name in JOINT_NAMES}
        return self._places(JointChange, "robot.joints", entries, chains)

    def _grippers(self, node: Node) -> dict[str, GripperChange]:
        entries = self.check.members(node, [], [ALL, *LIMB_NAMES])
        chains = {name: [key for key in (ALL, name) if key in entries] for name in LIMB_NAMES}
        return self._places(GripperChange, "robot.grippers", entries, chains)

    def _places(
        self, kind: type[T], where: str, entries: dict[str, Node], chains: dict[str, list[str]]
    ) -> dict[str, T]:
        if self.seed is None:
            return {name: self.record(kind, entry, place=where) for name, entry in entries.items()}
        return {
            name: self.record(kind, *(entries[key] for key in chain), place=f"{where}.{name}")
            for name, chain in chains.items()
            if chain
        }

    def _sensor_errors(self, node: Node) -> list[SensorError]:
        """One for each place that the entry is about."""
        check = self.check
        units = {unit for channels in SENSORS.values() for unit in channels}
        keys = check.members(node, ["sensor", "on", "error"], [*sorted(units), "factor", "share", "from_s", "for_s"])
        if not {"sensor", "on", "error"} <= keys.keys():
            return []
        before = len(check.problems)
        sensor, error = check.choice(keys["sensor"], list(SENSORS)), check.choice(keys["error"], ERRORS)
        if len(check.problems) > before:
            return []  # what goes with another sensor or error says nothing of this one
        places = JOINT_NAMES if sensor == "encoder" else LIMB_NAMES
        on = check.choice(keys["on"], [ALL, *LIMB_NAMES, *(JOINT_NAMES if sensor == "encoder" else ())])
        needed = [SHARES[error][0]] if error in SHARES else list(SENSORS[sensor]) if error in BY_CHANNEL else []
        allowed = ["sensor", "on", "error", *needed, "from_s", "for_s"]
        for name, member in keys.items():
            if name not in allowed:
                check.note_at(member, "", "", f"does not go with {error} of {sensor}; {did_you_mean(name, allowed)}")
        if error == "cross_talk" and sensor != "force_torque":
            check.note(keys["error"], "one channel has no cross-talk: expected it of force_torque alone")
        if error == "jump" and "from_s" not in keys:
            check.note_at(keys["error"], "", "", "a jump needs the time of it: from_s")
        if not any(name in keys for name in needed) and needed:
            check.note_at(keys["error"], "", "", f"{error} of {sensor} needs {' or '.join(needed)}")
        return [
            SensorError(
                sensor,
                place,
                error,
                self._sensor_values(keys, sensor, error, f"{node.key}.{place}"),
                *(
                    self.number(keys[name], Key(0.0, MAX_TIME_S, "s"), f"{node.key}.{place}.{name}")
                    if name in keys
                    else default
                    for name, default in (("from_s", 0.0), ("for_s", math.inf))
                ),
            )
            for place in ([on] if self.seed is None else places)
            if self.seed is None or on in (ALL, place, place[:2])
        ]

    def _sensor_values(self, keys: dict[str, Node], sensor: str, error: str, place: str) -> Vector:
        if error in SHARES:
            name, bounds = SHARES[error]
            return (self.number(keys[name], bounds, f"{place}.{name}"),) if name in keys else (0.0,)
        if error not in BY_CHANNEL:
            return ()
        nothing = math.inf if error == "saturation" else 0.0
        values: list[float] = []
        for unit, (count, most) in SENSORS[sensor].items():
            bounds = Key(0.0 if error == "saturation" else -most, most, unit)
            if unit not in keys:
                values += [nothing] * count
            elif count == 1:
                values.append(self.number(keys[unit], bounds, f"{place}.{unit}"))
            else:
                values += self.vector(keys[unit], bounds, count, f"{place}.{unit}")
        return tuple(values)

    def value(self, key: Key, node: Node, place: str = "") -> Any:
        if key.type == dict[str, bool]:
            return self._spines(node)
        if key.type == dict[str, float]:
            return self._friction(node, key, place)
        return super().value(key, node, place)

    def _spines(self, node: Node) -> dict[str, bool]:
        if not isinstance(node.content, dict):
            return dict.fromkeys(FACE_NAMES, self.check.flag(node))
        return {face: self.check.flag(flag) for face, flag in self.check.members(node, [], FACE_NAMES).items()}

    def _friction(self, node: Node, bounds: Key, place: str) -> dict[str, float]:
        if not isinstance(node.content, dict) or set(node.content) & set(DISTRIBUTIONS):
            return dict.fromkeys(FACE_NAMES, self.number(node, bounds, place))
        faces = self.check.members(node, [], FACE_NAMES)
        return {face: self.number(value, bounds, f"{place}.{face}") for face, value in faces.items()}

    def vector(self, node: Node, bounds: Key, count: int, place: str) -> Vector:
        """`count` numbers: a list, or a draw for each."""
        if isinstance(node.content, dict):
            return tuple(
                self.number(node, bounds, f"{place}[{i}]") for i in range(count if self.seed is not None else 1)
            )
        if not isinstance(node.content, list) or len(node.content) != count:
            self.check.note(node, f"expected a list of {count} numbers{' in ' + bounds.unit if bounds.unit else ''}")
            return (0.0,) * count
        return tuple(self.number(item, bounds, f"{place}[{i}]") for i, item in enumerate(node.content))

    def number(self, node: Node, bounds: Key, place: str) -> float:
        """A number within `bounds`, drawn where the file says so; a draw beyond them is their end."""
        if not isinstance(node.content, dict):
            return self.check.number(node, bounds.low, bounds.high, bounds.unit)
        if len(node.content) != 1 or not set(node.content) <= set(DISTRIBUTIONS):
            self.check.note(node, "expected a number, {uniform: [least, most]} or {normal: [mean, deviation]}")
            return bounds.low
        ((kind, pair),) = node.content.items()
        if not isinstance(pair.content, list) or len(pair.content) != 2:
            self.check.note(pair, f"expected {DISTRIBUTIONS[kind]}")
            return bounds.low
        first = self.check.number(pair.content[0], bounds.low, bounds.high, bounds.unit)
        least = first if kind == "uniform" else 0.0
        second = self.check.number(
            pair.content[1], least, bounds.high if kind == "uniform" else bounds.high - bounds.low, bounds.unit
        )
        if self.seed is None:
            return first
        generator = np.random.default_rng([self.seed, zlib.crc32(place.encode())])
        drawn = generator.uniform(first, second) if kind == "uniform" else generator.normal(first, second)
        return float(np.clip(drawn, bounds.low, bounds.high))
