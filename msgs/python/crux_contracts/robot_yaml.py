"""robot.yaml, checked key by key with the table of msgs/robot_keys.yaml; the runtime's robot_yaml.cpp does the same."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from crux_msgs.robot_keys import KEYS, SECTIONS, Key

from . import LIMB_NAMES
from .reading import Checker
from .yaml_document import DocumentError, Node


class RobotYaml:
    """Values by key: at the top, of each limb, of all limbs (`limb`), and the sections of numbers as dataclasses.

    Raises `error`, with everything that is wrong.
    """

    def __init__(self, root: Node, path: str, error: type[DocumentError]) -> None:
        self._check = Checker(path)
        self._joints: tuple[str, ...] = ()
        keys = self._check.members(root, [*_keys(""), "limbs", "limb", *SECTIONS])
        self.top = self._values(keys, "")
        self.limbs = self._limbs(keys["limbs"]) if "limbs" in keys else {}
        self.limb = self._section(keys["limb"], "limb") if "limb" in keys else {}
        sections = {name: self._section(keys[name], name) for name in SECTIONS if name in keys}
        self._check.finish(error)
        self.sections = {name: SECTIONS[name](**values) for name, values in sections.items()}

    def _section(self, node: Node, section: str) -> dict[str, Any]:
        return self._values(self._check.members(node, _keys(section)), section)

    def _values(self, members: Mapping[str, Node], section: str) -> dict[str, Any]:
        keys = (key for key in KEYS if key.section == section and key.name in members)
        return {key.name: self._value(key, members[key.name]) for key in keys}

    def _limbs(self, node: Node) -> dict[str, dict[str, Any]]:
        """In the order used everywhere."""
        limbs = self._check.members(node, LIMB_NAMES)
        read: dict[str, dict[str, Any]] = {}
        for name in (name for name in LIMB_NAMES if name in limbs):
            keys = self._check.members(limbs[name], _keys("limbs"))
            values = self._values(keys, "limbs")
            for key, value in values.items():
                if value != "" and value in (other.get(key) for other in read.values()):
                    self._check.note(keys[key], f"expected a {key} of its own for each limb")
            read[name] = values
        return read

    def _value(self, key: Key, node: Node) -> Any:
        check, low, high = self._check, key.low, key.high
        if key.type == "number":
            return check.number(node, low, high, key.unit)
        if key.type == "integer":
            return check.integer(node, int(low), int(high))
        if key.type == "per_joint":
            return check.numbers(node, key.count, low, high, key.unit)
        if key.type == "interval":
            return self._interval(key, node)
        if key.type == "names":
            return self._names(key, node)
        if key.type == "nodes":
            return self._nodes(node)
        text = check.text(node)
        if key.type == "file" and Path(text).name != text:
            check.note(node, "expected a file name in the same folder")
        return text

    def _interval(self, key: Key, node: Node) -> tuple[float, float]:
        before = len(self._check.problems)
        low, high = (v + 0.0 for v in self._check.numbers(node, 2, key.low, key.high, key.unit))  # -0 is 0
        if len(self._check.problems) == before and not low < high:
            self._check.note_at(node, "", f"[{low:g}, {high:g}]", "expected [low, high] with low below high")
        return (low, high)

    def _names(self, key: Key, node: Node) -> tuple[str, ...]:
        if not isinstance(node.content, list) or len(node.content) != key.count:
            self._check.note(node, f"expected a list of {key.count} names")
            return ()
        names = tuple(self._check.text(item) for item in node.content)
        if key.name == "joints" and all(names):
            self._joints = names
        return names

    def _nodes(self, node: Node) -> dict[str, int]:
        """Numbers on the bus, which the CAN database fixes: from the shoulder outwards, the gripper last."""
        if not self._joints:
            return {}
        names = (*self._joints, "gripper")
        keys = self._check.members(node, names)
        for number, name in enumerate(names, start=1):
            if name in keys and (keys[name].content != number or isinstance(keys[name].content, (bool, float))):
                self._check.note(keys[name], f"expected {number}: nodes count from the shoulder outwards")
        return {name: number for number, name in enumerate(names, start=1)}


def _keys(section: str) -> list[str]:
    return [key.name for key in KEYS if key.section == section]
