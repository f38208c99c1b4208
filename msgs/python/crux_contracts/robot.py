"""A robot description: a folder with robot.yaml and the URDF it names, read into typed values.

`robot_hash` is the SHA-256 (hex) of what both files mean (robot_meaning.py), not of their bytes.
"""

from __future__ import annotations

import dataclasses
import hashlib
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import LIMB_NAMES, robot_sections
from .motor_checks import check_motors
from .places import MSGS
from .reading import Checker
from .robot_meaning import robot_meaning
from .robot_sections import SECTIONS, Interval, PerJoint
from .urdf import Joint, Urdf, UrdfError, parse_urdf, parse_xml
from .yaml_document import DocumentError, Node, Problem, parse_mapping, read_bytes

ROBOTS = MSGS / "robots"
JOINTS = 6
MAX_NUMBER = 1e9

# Joint axes the closed-form kinematics stand on: yaw, pitch, pitch, then a spherical wrist pitch, roll, yaw.
_AXES = ((0, 0, 1), (0, -1, 0), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1))

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
    sections = {name: reader.section(kind, keys[name]) for name, kind in SECTIONS.items() if name in keys}
    limbs = reader.limbs(keys)
    parts = reader.limb_parts(keys)
    check.finish(RobotError)

    urdf_path = folder / texts["urdf"]
    xml = parse_xml(read_bytes(urdf_path), str(urdf_path))
    urdf = parse_urdf(xml, str(urdf_path))
    if texts["body_link"] not in urdf.links:
        raise UrdfError(str(urdf_path), [Problem("", texts["body_link"], "has no such link (body_link of robot.yaml)")])
    built = tuple(
        _limb(urdf, str(urdf_path), texts["body_link"], name, bus, prefix, parts)
        for name, (bus, prefix) in limbs.items()
    )
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
    check_motors(robot, str(yaml_path), RobotError)
    return robot


@dataclass(frozen=True)
class _LimbParts:
    joints: tuple[str, ...]
    gripper_frame: str
    finger_joints: tuple[str, str]


class _Reader:
    def __init__(self, path: str) -> None:
        self.check = Checker(path)

    def section(self, kind: type[Any], node: Node) -> Any:
        """A dataclass of robot_sections from a mapping with exactly its keys; None after a problem."""
        hints = typing.get_type_hints(kind)
        names = [f.name for f in dataclasses.fields(kind)]
        keys = self.check.members(node, names)
        values = {name: self._value(hints[name], member) for name, member in keys.items()}
        return kind(**values) if len(values) == len(names) else None

    def _value(self, hint: Any, node: Node) -> Any:
        check = self.check
        if hint is float:
            return check.number(node, 0.0, MAX_NUMBER)
        if hint is int:
            return check.integer(node, 0, int(MAX_NUMBER))
        if hint == PerJoint:
            return check.numbers(node, JOINTS, 0.0, MAX_NUMBER)
        if hint == Interval:
            low, high = check.numbers(node, 2, -MAX_NUMBER, MAX_NUMBER)
            if isinstance(node.content, list) and not low < high:
                check.note_at(node, "", f"[{low:g}, {high:g}]", "expected [low, high] with low below high")
            return (low, high)
        if isinstance(node.content, dict):
            return {name: check.integer(member, 0, 127) for name, member in node.content.items()}
        check.note(node, "expected a mapping of names to whole numbers")
        return {}

    def limbs(self, keys: dict[str, Node]) -> dict[str, tuple[int, str]]:
        """Bus and prefix by limb, in the order used everywhere."""
        members = self.check.members(keys["limbs"], LIMB_NAMES) if "limbs" in keys else {}
        limbs = {}
        for name in LIMB_NAMES:
            if name in members:
                entry = self.check.members(members[name], ["bus", "prefix"])
                bus = self.check.integer(entry["bus"], 0, 15) if "bus" in entry else 0
                limbs[name] = (bus, self.check.text(entry["prefix"]) if "prefix" in entry else "")
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


def _limb(urdf: Urdf, path: str, body_link: str, name: str, bus: int, prefix: str, parts: _LimbParts) -> Limb:
    def fail(what: str, value: str, expected: str) -> RobotError:
        return RobotError(path, [Problem(what, value, expected)])

    gripper_link = f"{prefix}_{parts.gripper_frame}"
    try:
        chain = urdf.chain(body_link, gripper_link)
    except KeyError:
        raise fail(f"link {gripper_link}", "", f"expected it to hang on {body_link}") from None
    wanted = [f"{prefix}_{joint}" for joint in parts.joints]
    moving = [joint for joint in chain if joint.kind != "fixed"]
    if [joint.name for joint in moving] != wanted:
        found = ", ".join(joint.name for joint in moving)
        raise fail(f"limb {name}", found, f"expected the joints {', '.join(wanted)} from the body outwards")
    if len(chain) != JOINTS + 1 or chain[-1].kind != "fixed":
        raise fail(f"limb {name}", "", f"expected {JOINTS} revolute joints and then the fixed mount of the gripper")
    for joint, axis in zip(moving, _AXES, strict=True):
        if joint.kind != "revolute" or not np.allclose(joint.axis, axis, atol=1e-9):
            raise fail(f"joint {joint.name}", f"{joint.kind} about {joint.axis}", f"expected revolute about {axis}")
    _check_origins(fail, moving, chain[-1])
    fingers = (f"{prefix}_{parts.finger_joints[0]}", f"{prefix}_{parts.finger_joints[1]}")
    for finger in fingers:
        if finger not in urdf.joints or urdf.joints[finger].parent != gripper_link:
            raise fail(f"joint {finger}", "", f"expected a prismatic joint on {gripper_link}")
    hand_mass, hand_com = _hand(urdf, gripper_link, fingers)
    return Limb(
        name=name,
        bus=bus,
        joints=tuple(moving),
        gripper_link=gripper_link,
        finger_joints=fingers,
        shoulder_b_m=np.array(moving[0].xyz_m),
        mount_rad=moving[0].rpy_rad[2],
        upper_link_m=moving[2].xyz_m[0],
        lower_link_m=moving[3].xyz_m[0],
        wrist_to_gripper_m=-chain[-1].xyz_m[2],
        gripper_mount_rad=chain[-1].rpy_rad[2],
        hand_mass_kg=hand_mass,
        hand_com_g_m=hand_com,
    )


def _check_origins(fail: typing.Callable[[str, str, str], RobotError], joints: list[Joint], mount: Joint) -> None:
    """The frames the closed form needs: links along x, a wrist in one point, the gripper on the last axis."""
    for index, joint in enumerate(joints):
        x, y, z = joint.xyz_m
        roll, pitch, yaw = joint.rpy_rad
        if index == 0:
            if abs(roll) > 1e-9 or abs(pitch) > 1e-9:
                raise fail(f"joint {joint.name}", f"rpy {joint.rpy_rad}", "expected a turn about z only")
            continue
        is_link = index in (2, 3)
        if abs(y) > 1e-9 or abs(z) > 1e-9 or (x <= 0 if is_link else abs(x) > 1e-9):
            expected = "a link along x" if is_link else "0 0 0: the axes meet in one point"
            raise fail(f"joint {joint.name}", f"xyz {joint.xyz_m}", f"expected {expected}")
        if max(abs(roll), abs(pitch), abs(yaw)) > 1e-9:
            raise fail(f"joint {joint.name}", f"rpy {joint.rpy_rad}", "expected 0 0 0")
    x, y, z = mount.xyz_m
    if abs(x) > 1e-9 or abs(y) > 1e-9 or z >= 0 or max(abs(mount.rpy_rad[0]), abs(mount.rpy_rad[1])) > 1e-9:
        raise fail(f"joint {mount.name}", f"xyz {mount.xyz_m}", "expected the gripper along -z of the last axis")


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
