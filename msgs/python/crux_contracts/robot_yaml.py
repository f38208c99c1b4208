"""robot.yaml, checked key by key with the table of msgs/robot_keys.yaml; the runtime's robot_yaml.cpp does the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from crux_msgs.robot_keys import SECTIONS, InUrdf, OfLimb, Top

from . import LIMB_NAMES
from .records import Key, Records, keys_of
from .robot_bounds import GRIPPER_NODE, JOINTS, LEAST_JOINTS, MOST_JOINTS
from .yaml_document import DocumentError, Node


class RobotYaml(Records):
    """Values by key: at the top, of each limb, of all limbs (`limb`), and the sections of numbers as dataclasses.

    Raises `error`, with everything that is wrong.
    """

    def __init__(self, root: Node, path: str, error: type[DocumentError]) -> None:
        super().__init__(path)
        self._joints: tuple[str, ...] = ()
        optional = [name for name, kind in SECTIONS.items() if not any(key.required for key in keys_of(kind).values())]
        sections = [name for name in SECTIONS if name not in optional]
        members = self.check.members(root, [*keys_of(Top), "limbs", "limb", *sections], optional)
        self.top = self._values(Top, members)
        self.limbs = self._limbs(members["limbs"]) if "limbs" in members else {}
        self.limb: Any = self.record(InUrdf, members["limb"]) if "limb" in members else None
        self.sections = {name: SECTIONS[name]() for name in optional}
        self.sections |= {name: self.record(SECTIONS[name], members[name]) for name in SECTIONS if name in members}
        self.check.finish(error)

    def _values(self, kind: Any, members: Mapping[str, Node]) -> dict[str, Any]:
        return {name: self.value(key, members[name]) for name, key in keys_of(kind).items() if name in members}

    def _limbs(self, node: Node) -> dict[str, dict[str, Any]]:
        """In the order used everywhere."""
        limbs = self.check.members(node, LIMB_NAMES)
        read: dict[str, dict[str, Any]] = {}
        for name in (name for name in LIMB_NAMES if name in limbs):
            members = self.check.members(limbs[name], list(keys_of(OfLimb)))
            values = self._values(OfLimb, members)
            for key, value in values.items():
                if value != "" and value in (other.get(key) for other in read.values()):
                    self.check.note(members[key], f"expected a {key} of its own for each limb")
            read[name] = values
        return read

    def value(self, key: Key, node: Node, place: str = "") -> Any:
        """What a key holds; a number for each joint that section `limb` names."""
        if key.type != tuple[float, ...]:
            return super().value(key, node, place)
        count = len(self._joints) or (len(node.content) if isinstance(node.content, list) else JOINTS)
        return self.check.numbers(node, count, key.low, key.high, key.unit)

    def vector(self, node: Node, bounds: Key, count: int, place: str) -> tuple[float, ...]:
        """The two numbers of an interval."""
        before = len(self.check.problems)
        numbers = super().vector(node, bounds, count, place)
        low, high = (number + 0.0 for number in numbers)  # -0 is 0
        if len(self.check.problems) == before and not low < high:
            self.check.note_at(node, "", f"[{low:g}, {high:g}]", "expected [low, high] with low below high")
        return (low, high)

    def file(self, node: Node) -> str:
        text = self.check.text(node)
        if Path(text).name != text:
            self.check.note(node, "expected a file name in the same folder")
        return text

    def joints(self, node: Node) -> tuple[str, ...]:
        names = self._names(node, LEAST_JOINTS, MOST_JOINTS)
        self._joints = names if all(names) else ()
        return names

    def finger_joints(self, node: Node) -> tuple[str, ...]:
        return self._names(node, 2, 2)

    def _names(self, node: Node, least: int, most: int) -> tuple[str, ...]:
        if not isinstance(node.content, list) or not least <= len(node.content) <= most:
            self.check.note(node, f"expected a list of {least} {f'to {most} ' if most > least else ''}names")
            return ()
        return tuple(self.check.text(item) for item in node.content)

    def nodes(self, node: Node) -> dict[str, int]:
        """Numbers on the bus, which the CAN database fixes: from the shoulder outwards; the gripper's is always one."""
        if not self._joints:
            return {}
        numbers = node_numbers(self._joints)
        members = self.check.members(node, list(numbers))
        for name, number in numbers.items():
            given = members[name].content if name in members else number
            if given != number or isinstance(given, (bool, float)):
                self.check.note(members[name], f"expected {number}: nodes count from the shoulder outwards")
        return numbers


def node_numbers(joints: Sequence[str]) -> dict[str, int]:
    """On a limb's bus: joints count from 1, and leave out the gripper's."""
    free = (number for number in range(1, MOST_JOINTS + 2) if number != GRIPPER_NODE)
    return {**dict(zip(joints, free, strict=False)), "gripper": GRIPPER_NODE}
