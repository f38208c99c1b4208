"""A robot description: a folder with robot.yaml and the URDF it names, read into typed values.

`robot_hash` is the SHA-256 (hex) of what both files mean (robot_meaning.py), not of their bytes.
"""

from __future__ import annotations

import hashlib
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import LIMB_NAMES, robot_sections
from .gain_checks import gain_problems
from .joint_loop_checks import joint_loop_problems
from .motor_checks import motor_problems
from .places import MSGS
from .reading import Checker
from .robot_bounds import MAX_BUS
from .robot_meaning import robot_meaning
from .robot_rules import JOINTS, RobotRules
from .robot_sections import SECTIONS, Interval, KeyRule, key_rules
from .urdf import Joint, Urdf, parse_urdf, parse_xml
from .yaml_document import DocumentError, Node, parse_mapping, read_bytes

ROBOTS = MSGS / "robots"

Array = NDArray[np.float64]


class RobotError(DocumentError):
    """A robot description that cannot be used."""


@dataclass(frozen=True)
class Limb:
    """One limb as YAML and URDF describe it together; SI units. Arrays have one value a joint, shoulder outwards."""

    name: str
    bus: int
    joints: tuple[Joint, ...]
    gripper_link: str
    finger_joints: tuple[str, str]
    shoulder_b_m: Array
    """(3,) where the first three axes start, body frame."""
    mount_rad: float
    """Direction of the limb at q1 = 0, about the body's z."""
    upper_link_m: float
    lower_link_m: float
    wrist_to_gripper_m: float
    """Along the gripper's -z."""
    gripper_mount_rad: float
    """Turn of the gripper on the last joint, about its z."""
    hand_mass_kg: float
    """Of what hangs on the F/T sensor: gripper and fingers."""
    hand_com_g_m: Array
    """(3,) its centre of mass with the fingers half open, gripper frame."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    @property
    def lower_rad(self) -> Array:
        """(6,)"""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper_rad(self) -> Array:
        """(6,)"""
        return np.array([joint.upper for joint in self.joints])

    @property
    def effort_Nm(self) -> Array:
        """(6,) peak torque."""
        return np.array([joint.effort for joint in self.joints])

    @property
    def velocity_rad_s(self) -> Array:
        """(6,)"""
        return np.array([joint.velocity for joint in self.joints])


@dataclass(frozen=True)
class Robot:
    name: str
    folder: Path
    urdf_path: Path
    urdf: Urdf
    body_link: str
    limbs: tuple[Limb, Limb, Limb, Limb]
    can: robot_sections.Can
    servo: robot_sections.Servo
    gripper: robot_sections.Gripper
    drive: robot_sections.Drive
    motor: robot_sections.JointMotor
    gripper_motor: robot_sections.GripperMotor
    force_torque: robot_sections.ForceTorque
    body: robot_sections.Body
    grasp: robot_sections.GraspLimits
    walking: robot_sections.Walking
    admittance: robot_sections.Admittance
    calibration: robot_sections.Calibration
    control: robot_sections.Control
    localisation: robot_sections.Localisation
    stance: robot_sections.Stance
    supervisor: robot_sections.SupervisorLimits
    hash: str = field(repr=False)

    @property
    def total_mass_kg(self) -> float:
        """kg, of the body and all limbs."""
        return self.urdf.total_mass_kg


def robot_names() -> list[str]:
    """Robots that ship with crux."""
    return sorted(path.parent.name for path in ROBOTS.glob("*/robot.yaml"))


def robot_hash(folder: str | Path) -> str:
    """Hash of a robot folder; see the module's text. Raises RobotError when it cannot be read."""
    return load_robot(folder).hash


def load_robot(name_or_folder: str | Path) -> Robot:
    """Reads a robot that ships with crux (by name) or any robot folder. Raises RobotError."""
    folder = Path(name_or_folder)
    if isinstance(name_or_folder, str) and name_or_folder in robot_names():
        folder = ROBOTS / name_or_folder
    try:
        return _load(folder)
    except RobotError:
        raise
    except DocumentError as error:
        raise RobotError(error.path, error.problems) from None


def _load(folder: Path) -> Robot:
    yaml_path = folder / "robot.yaml"
    reader = _Reader(str(yaml_path))
    root = parse_mapping(read_bytes(yaml_path), str(yaml_path))
    check = reader.check
    keys = check.members(root, ["version", "name", "urdf", "body_link", "limbs", "limb", *SECTIONS])
    if "version" in keys:
        check.integer(keys["version"], 1, 1)
    texts = {name: check.text(keys[name]) for name in ("name", "urdf", "body_link") if name in keys}
    if "urdf" in texts and Path(texts["urdf"]).name != texts["urdf"]:
        check.note(keys["urdf"], "expected a file name in the same folder")
    limbs = reader.limbs(keys)
    parts = reader.limb_parts(keys)
    sections = {name: reader.section(name, keys[name], parts.joints) for name in SECTIONS if name in keys}
    check.finish(RobotError)

    urdf_path = folder / texts["urdf"]
    xml = parse_xml(read_bytes(urdf_path), str(urdf_path))
    urdf = parse_urdf(xml, str(urdf_path))
    rules = RobotRules(urdf, str(urdf_path), texts["body_link"])
    rules.check_tree()
    built = tuple(_limbs(rules, limbs, parts, sections["gripper"].opening_m))
    robot = Robot(
        name=texts["name"],
        folder=folder,
        urdf_path=urdf_path,
        urdf=urdf,
        body_link=texts["body_link"],
        limbs=typing.cast(tuple[Limb, Limb, Limb, Limb], built),
        hash=hashlib.sha256(robot_meaning(root, xml).encode()).hexdigest(),
        **sections,
    )
    problems = [*motor_problems(robot), *gain_problems(robot), *joint_loop_problems(robot)]
    if problems:
        raise RobotError(str(yaml_path), problems)
    return robot


@dataclass(frozen=True)
class _LimbParts:
    joints: tuple[str, ...]
    gripper_frame: str
    finger_joints: tuple[str, str]


class _Reader:
    def __init__(self, path: str) -> None:
        self.check = Checker(path)

    def section(self, name: str, node: Node, joints: tuple[str, ...]) -> Any:
        """A dataclass of robot_sections from a mapping with exactly its keys; None after a problem."""
        rules = {rule.key: rule for rule in key_rules() if rule.section == name}
        keys = self.check.members(node, list(rules))
        values = {key: self._value(rules[key], member, joints) for key, member in keys.items()}
        return SECTIONS[name](**values) if len(values) == len(rules) else None

    def _value(self, rule: KeyRule, node: Node, joints: tuple[str, ...]) -> Any:
        check, bounds = self.check, rule.range
        if rule.kind == "number":
            return check.number(node, bounds.low, bounds.high, rule.unit)
        if rule.kind == "integer":
            return check.integer(node, int(bounds.low), int(bounds.high))
        if rule.kind == "per_joint":
            return check.numbers(node, JOINTS, bounds.low, bounds.high, rule.unit)
        if rule.kind == "interval":
            before = len(check.problems)
            low, high = (v + 0.0 for v in check.numbers(node, 2, bounds.low, bounds.high, rule.unit))  # -0 is 0
            if len(check.problems) == before and not low < high:
                check.note_at(node, "", f"[{low:g}, {high:g}]", "expected [low, high] with low below high")
            return (low, high)
        return self._nodes(node, joints)

    def _nodes(self, node: Node, joints: tuple[str, ...]) -> dict[str, int]:
        """Numbers on the bus, which the CAN database fixes: from the shoulder outwards, the gripper last."""
        if not all(joints):
            return {}
        keys = self.check.members(node, [*joints, "gripper"])
        numbers = {}
        for number, name in enumerate((*joints, "gripper"), start=1):
            if name in keys:
                if keys[name].content != number or isinstance(keys[name].content, (bool, float)):
                    self.check.note(keys[name], f"expected {number}: nodes count from the shoulder outwards")
                numbers[name] = number
        return numbers

    def limbs(self, keys: dict[str, Node]) -> dict[str, tuple[int, str]]:
        """Bus and prefix by limb, in the order used everywhere."""
        members = self.check.members(keys["limbs"], LIMB_NAMES) if "limbs" in keys else {}
        limbs: dict[str, tuple[int, str]] = {}
        for name in LIMB_NAMES:
            if name in members:
                entry = self.check.members(members[name], ["bus", "prefix"])
                bus = self.check.integer(entry["bus"], 0, MAX_BUS) if "bus" in entry else 0
                if "bus" in entry and bus in [other for other, _ in limbs.values()]:
                    self.check.note(entry["bus"], "expected a bus of its own for each limb")
                prefix = self.check.text(entry["prefix"]) if "prefix" in entry else ""
                if prefix and prefix in [other for _, other in limbs.values()]:
                    self.check.note(entry["prefix"], "expected a prefix of its own for each limb")
                limbs[name] = (bus, prefix)
        return limbs

    def limb_parts(self, keys: dict[str, Node]) -> _LimbParts:
        members = (
            self.check.members(keys["limb"], ["joints", "gripper_frame", "finger_joints"]) if "limb" in keys else {}
        )
        joints = self._texts(members, "joints", JOINTS)
        fingers = self._texts(members, "finger_joints", 2)
        frame = self.check.text(members["gripper_frame"]) if "gripper_frame" in members else ""
        return _LimbParts(joints, frame, (fingers[0], fingers[1]))

    def _texts(self, members: dict[str, Node], name: str, count: int) -> tuple[str, ...]:
        items = self.check.items(members[name], count) if name in members else []
        if name in members and len(items) != count:
            self.check.note(members[name], f"expected a list of {count} names")
        return tuple(self.check.text(item) for item in items) if len(items) == count else ("",) * count


def _limbs(rules: RobotRules, limbs: dict[str, tuple[int, str]], parts: _LimbParts, opening_m: Interval) -> list[Limb]:
    chains, built = {}, []
    for name, (bus, prefix) in limbs.items():
        gripper_link = f"{prefix}_{parts.gripper_frame}"
        chains[name] = chain = rules.chain(name, gripper_link, [f"{prefix}_{joint}" for joint in parts.joints])
        fingers = (f"{prefix}_{parts.finger_joints[0]}", f"{prefix}_{parts.finger_joints[1]}")
        rules.check_fingers(gripper_link, fingers, opening_m)
        built.append(_limb(rules.urdf, name, bus, chain, fingers))
    joints = rules.urdf.joints
    fingers_too = (joints[finger] for limb in built for finger in limb.finger_joints)
    rules.check_bodies([*(joint for chain in chains.values() for joint in chain), *fingers_too])
    rules.check_mirrored(chains)
    return built


def _limb(urdf: Urdf, name: str, bus: int, chain: list[Joint], fingers: tuple[str, str]) -> Limb:
    *joints, mount = chain
    hand_mass, hand_com = _hand(urdf, mount.child, fingers)
    return Limb(
        name=name,
        bus=bus,
        joints=tuple(joints),
        gripper_link=mount.child,
        finger_joints=fingers,
        shoulder_b_m=np.array(joints[0].xyz_m),
        mount_rad=joints[0].rpy_rad[2],
        upper_link_m=joints[2].xyz_m[0],
        lower_link_m=joints[3].xyz_m[0],
        wrist_to_gripper_m=-mount.xyz_m[2],
        gripper_mount_rad=mount.rpy_rad[2],
        hand_mass_kg=hand_mass,
        hand_com_g_m=hand_com,
    )


def _hand(urdf: Urdf, gripper_link: str, fingers: tuple[str, str]) -> tuple[float, Array]:
    gripper = urdf.links[gripper_link]
    mass = gripper.mass_kg
    moment = gripper.mass_kg * np.array(gripper.com_m)
    for name in fingers:
        joint = urdf.joints[name]
        finger = urdf.links[joint.child]
        middle = (joint.lower + joint.upper) / 2
        mass += finger.mass_kg
        moment += finger.mass_kg * (np.array(joint.xyz_m) + middle * np.array(joint.axis) + np.array(finger.com_m))
    return mass, moment / mass
