"""The mapping of `crux robot import`: what a URDF cannot say of a climber, in a file of some twenty lines."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from crux_contracts import LIMB_NAMES
from crux_contracts.robot_bounds import LEAST_JOINTS, MOST_JOINTS
from crux_contracts.yaml_document import DocumentError, Problem, parse_mapping, read_bytes, values

EXAMPLE = """name: mine                                   # of the robot
like: scaler                                 # whose robot.yaml has all that is said nowhere else, marked [A]
body_link: base
limbs: {LF: 0, RF: 1, LR: 2, RR: 3}          # what stands for {} below
joints: ["yaw{}", "hip{}", "knee{}", "pitch{}", "roll{}", "turn{}"]   # shoulder outwards: four to seven
gripper: {link: "palm{}", origin_m: [0, 0, -0.05], rpy_rad: [0, 0, 0]}   # between the pads, in the link's frame
                                             # x: opening axis, z: off the wall, from the pads to the palm
fingers: ["left{}", "right{}"]               # finger 1 moves towards +x of the gripper
locked: {waist: 0}                           # joints that stay where they are
limits_rad: {yaw: [-1.5, 1.5]}               # where the URDF has none, or others; names without {}
effort_Nm: {default: 4.1, hip: 8.2}
speed_rad_s: {default: 4.8}
finger: {effort_N: 60, speed_m_s: 0.02, opening_m: [0.01, 0.065]}
five_bar: {first: "hip{}", crank: "crank{}", rod: "rod{}", pin: "pin{}"}   # where a crank moves the joint after first
masses_kg: {total: 9.6, body: 2.8}           # scales the URDF's
capsule_radius_m: 0.02                       # in place of meshes: capsules along the links
set: {body.height_m: [0.2, 0.25]}            # values of robot.yaml"""


class MappingError(DocumentError):
    """A mapping that cannot be used, or facts that neither it nor the URDF has."""


@dataclass
class Mapping:
    """As EXAMPLE has it. Joints, links and fingers by limb, names in full."""

    path: str
    name: str = ""
    like: str = ""
    body_link: str = ""
    limbs: dict[str, str] = field(default_factory=dict)
    joints: list[str] = field(default_factory=list)
    gripper: dict[str, Any] = field(default_factory=dict)
    fingers: list[str] = field(default_factory=list)
    locked: dict[str, float] = field(default_factory=dict)
    limits_rad: dict[str, list[float]] = field(default_factory=dict)
    effort_Nm: dict[str, float] = field(default_factory=dict)
    speed_rad_s: dict[str, float] = field(default_factory=dict)
    finger: dict[str, Any] = field(default_factory=dict)
    five_bar: dict[str, Any] = field(default_factory=dict)
    masses_kg: dict[str, float] = field(default_factory=dict)
    capsule_radius_m: float | None = None
    set: dict[str, Any] = field(default_factory=dict)

    def of(self, pattern: str, limb: str) -> str:
        """A name of the URDF."""
        return pattern.replace("{}", self.limbs[limb])


def bare(pattern: str) -> str:
    """A name without the {} that stands for the limb."""
    return pattern.replace("{}", "").strip("_") or "joint"


_KINDS: dict[str, type | tuple[type, ...]] = {
    "name": str, "like": str, "body_link": str, "limbs": dict, "joints": list, "gripper": dict, "fingers": list,
    "locked": dict, "limits_rad": dict, "effort_Nm": dict, "speed_rad_s": dict, "finger": dict, "five_bar": dict,
    "masses_kg": dict, "capsule_radius_m": (int, float), "set": dict,
}  # fmt: skip
FIVE_BAR = ("first", "crank", "rod", "pin")  # joints, and a link behind the joint after the first, at the rod's end
_NUMBERS = ("locked", "effort_Nm", "speed_rad_s", "masses_kg")
_WORDS = {dict: "a mapping", list: "a list", str: "a text", (int, float): "a number"}
_NEEDED = {
    "name": "the name of the robot",
    "like": "a robot whose robot.yaml has all that is said nowhere else: scaler",
    "body_link": "the link of the body",
    "limbs": f"for each of {', '.join(LIMB_NAMES)} what stands for {{}} in the names",
    "joints": f"names of a limb's {LEAST_JOINTS} to {MOST_JOINTS} joints, shoulder outwards, with {{}} for the limb",
    "gripper": "link: the link of the gripper; origin_m: the place between the pads in it",
    "fingers": "names of the sliding joints of finger 1 (towards +x of the gripper) and finger 2",
}


def read_mapping(path: Path | None, problems: list[Problem]) -> Mapping:
    """Of a file, or an empty one; what is wrong and what is missing is added to `problems`. Raises DocumentError."""
    given: Any = {}
    if path is not None:
        given = values(parse_mapping(read_bytes(path), str(path)))
    mapping = Mapping(str(path or "MAPPING"))
    for key, value in given.items():
        kind = _KINDS.get(key)
        if kind is None:
            problems.append(Problem(key, "", f"unknown key; right are {', '.join(_KINDS)}"))
        elif not isinstance(value, kind) or isinstance(value, bool):
            problems.append(Problem(key, str(value), f"expected {_WORDS[kind]}"))
        else:
            setattr(mapping, key, value)
    for key, what in _NEEDED.items():
        if not getattr(mapping, key) and not any(problem.key == key for problem in problems):
            problems.append(Problem(key, "", f"is missing: {what}"))
    _check(mapping, problems)
    return mapping


def _check(mapping: Mapping, problems: list[Problem]) -> None:
    """Forms of the values inside; what is wrong is taken out."""

    def refuse(key: str, value: Any, expected: str) -> None:
        problems.append(Problem(key, str(value), expected))

    if mapping.name and not re.fullmatch(r"[A-Za-z0-9_-]+", mapping.name):
        refuse("name", mapping.name, "expected letters, digits, - and _")
    for name in _NUMBERS:
        for key, value in list(getattr(mapping, name).items()):
            if not _is_number(value):
                refuse(f"{name}.{key}", value, "expected a number")
                del getattr(mapping, name)[key]
    for key, value in list(mapping.limits_rad.items()):
        if not _are_numbers(value, 2) or not value[0] < value[1]:
            refuse(f"limits_rad.{key}", value, "expected [low, high] with low below high")
            del mapping.limits_rad[key]
    if mapping.limbs and set(mapping.limbs) != set(LIMB_NAMES):
        refuse("limbs", ", ".join(mapping.limbs), f"expected {', '.join(LIMB_NAMES)}")
        mapping.limbs = {}
    mapping.limbs = {name: "" if mapping.limbs[name] is None else str(mapping.limbs[name])
                     for name in LIMB_NAMES if name in mapping.limbs}  # fmt: skip
    for name, least, most in (("joints", LEAST_JOINTS, MOST_JOINTS), ("fingers", 2, 2)):
        found = getattr(mapping, name)
        named = all(isinstance(each, str) and "{}" in each for each in found)
        if found and not (named and least <= len(found) <= most):
            count = f"{least}" if least == most else f"{least} to {most}"
            refuse(name, found, f"expected {count} names with {{}} for the limb")
            setattr(mapping, name, [])
    if mapping.gripper and not isinstance(mapping.gripper.get("link"), str):
        refuse("gripper.link", mapping.gripper.get("link"), "expected a name with {} for the limb")
        mapping.gripper = {}
    if mapping.five_bar:
        wrong = [key for key in FIVE_BAR if "{}" not in str(mapping.five_bar.get(key))]
        for key in wrong:
            refuse(f"five_bar.{key}", mapping.five_bar.get(key), "expected a name with {} for the limb")
        if not wrong and mapping.joints and mapping.five_bar["first"] not in mapping.joints[:-1]:
            refuse("five_bar.first", mapping.five_bar["first"], "expected one of joints with another behind it")
            wrong = ["first"]
        least_sine = mapping.five_bar.get("least_sine", 0.5)
        if not _is_number(least_sine) or not 0 < least_sine < 1:
            refuse("five_bar.least_sine", least_sine, "expected a number between 0 and 1")
            wrong.append("least_sine")
        if wrong:
            mapping.five_bar = {}
    for key in ("origin_m", "rpy_rad"):
        if key in mapping.gripper and not _are_numbers(mapping.gripper[key], 3):
            refuse(f"gripper.{key}", mapping.gripper[key], "expected three numbers")
            del mapping.gripper[key]
    for key, fits in (("effort_N", _is_number), ("speed_m_s", _is_number), ("opening_m", lambda v: _are_numbers(v, 2))):
        if key in mapping.finger and not fits(mapping.finger[key]):
            refuse(f"finger.{key}", mapping.finger[key], "expected a number" if key != "opening_m" else "[low, high]")
            del mapping.finger[key]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are_numbers(value: Any, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(map(_is_number, value))
