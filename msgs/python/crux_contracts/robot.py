"""A robot description: a folder with robot.yaml and the URDF it names, read into typed values.

`robot_hash` is the SHA-256 (hex) of what both files mean (robot_meaning.py), not of their bytes.
"""

from __future__ import annotations

import hashlib
import typing
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from .gain_checks import gain_problems
from .joint_loop_checks import joint_loop_problems
from .motor_checks import motor_problems
from .places import MSGS
from .robot_meaning import robot_meaning
from .robot_rules import RobotRules
from .robot_types import Array, Limb, Robot
from .robot_yaml import RobotYaml
from .urdf import Joint, Urdf, parse_urdf, parse_xml
from .yaml_document import DocumentError, Node, parse_mapping, read_bytes

__all__ = ["ROBOTS", "Array", "Limb", "Robot", "RobotError", "load_robot", "robot_hash", "robot_names"]

ROBOTS = MSGS / "robots"
MOST_READ = 8


class RobotError(DocumentError):
    """A robot description that cannot be used."""


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


@lru_cache(maxsize=4)
def _keys(text: bytes, path: str) -> tuple[Node, RobotYaml]:
    root = parse_mapping(text, path)
    return root, RobotYaml(root, path, RobotError)


_READ: dict[tuple[bytes, bytes], Robot] = {}
"""Descriptions that were found right, by their bytes: commands read the same one again and again."""


def _load(folder: Path) -> Robot:
    yaml_path = folder / "robot.yaml"
    text = read_bytes(yaml_path)
    root, file = _keys(text, str(yaml_path))
    urdf_path = folder / file.top["urdf"]
    urdf_text = read_bytes(urdf_path)
    if (text, urdf_text) in _READ:
        return replace(_READ[text, urdf_text], folder=folder, urdf_path=urdf_path)
    xml = parse_xml(urdf_text, str(urdf_path))
    urdf = parse_urdf(xml, str(urdf_path))
    rules = RobotRules(urdf, str(urdf_path), file.top["body_link"])
    rules.check_tree()
    built = tuple(_limbs(rules, file))
    robot = Robot(
        name=file.top["name"],
        folder=folder,
        urdf_path=urdf_path,
        urdf=urdf,
        body_link=file.top["body_link"],
        limbs=typing.cast(tuple[Limb, Limb, Limb, Limb], built),
        hash=hashlib.sha256(robot_meaning(root, xml).encode()).hexdigest(),
        **file.sections,
    )
    problems = [*motor_problems(robot), *gain_problems(robot), *joint_loop_problems(robot)]
    if problems:
        raise RobotError(str(yaml_path), problems)
    if len(_READ) == MOST_READ:
        _READ.clear()
    _READ[text, urdf_text] = robot
    return robot


def _limbs(rules: RobotRules, file: RobotYaml) -> list[Limb]:
    chains, built, names = {}, [], file.limb
    for name, limb in file.limbs.items():
        bus, prefix = limb["bus"], limb["prefix"]
        gripper_link = f"{prefix}_{names.gripper_frame}"
        chains[name] = chain = rules.chain(name, gripper_link, [f"{prefix}_{joint}" for joint in names.joints])
        one, other = names.finger_joints
        fingers = (f"{prefix}_{one}", f"{prefix}_{other}")
        rules.check_fingers(gripper_link, fingers, file.sections["gripper"].opening_m)
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
