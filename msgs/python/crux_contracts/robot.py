"""A robot description: a folder with robot.yaml and the URDF it names, read into typed values.

`robot_hash` is the SHA-256 (hex) of what both files mean (robot_meaning.py), not of their bytes.
"""

from __future__ import annotations

import hashlib
import os
import typing
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from .five_bar import FiveBar, geometry
from .gain_checks import gain_problems
from .joint_loop_checks import joint_loop_problems
from .motor_checks import motor_problems
from .one_branch import on_one_branch
from .places import MSGS
from .robot_archive import is_archive, unpacked
from .robot_bounds import JOINTS
from .robot_meaning import robot_meaning
from .robot_rules import Chain, RobotRules, have_closed_form
from .robot_types import Array, AtZero, Limb, Robot
from .robot_yaml import RobotYaml
from .still_turns import CANNOT_PLACE, completed
from .transmissions import (
    Limits,
    Transmission,
    five_bar_problems,
    joint_limits,
    limit_problems,
    narrowed,
    own_limits,
    transmission_problems,
)
from .urdf import Joint, Urdf, parse_xml, read_urdf, rotation
from .yaml_document import DocumentError, Node, Problem, parse_mapping, read_bytes

__all__ = [
    "ROBOTS",
    "Array",
    "Limb",
    "Robot",
    "RobotError",
    "RobotFiles",
    "load_robot",
    "robot_files",
    "robot_folders",
    "robot_hash",
    "robot_names",
]

ROBOTS = MSGS / "robots"
MOST_READ = 8


class RobotError(DocumentError):
    """A robot description that cannot be used."""


def robot_folders() -> dict[str, Path]:
    """Robots that go by their name, and their folders: those that ship with crux, and those in the folders, and the
    archives of robots, that the environment variable CRUX_ROBOTS names, of which the first has the last word. Raises
    DocumentError where an archive has no robot.
    """
    own = [Path(folder) for folder in os.environ.get("CRUX_ROBOTS", "").split(os.pathsep) if folder]
    found: dict[str, Path] = {}
    for each in (ROBOTS, *reversed(own)):
        folders = [unpacked(each)] if is_archive(each) else [path.parent for path in each.glob("*/robot.yaml")]
        found |= {folder.name: folder for folder in folders}
    return found


def robot_names() -> list[str]:
    """Robots that go by their name."""
    return sorted(robot_folders())


def robot_hash(folder: str | Path) -> str:
    """Hash of a robot folder; see the module's text. Raises RobotError when it cannot be read."""
    return load_robot(folder).hash


@dataclass(frozen=True)
class RobotFiles:
    """The two files of a robot folder, robot.yaml read."""

    folder: Path
    yaml_text: bytes
    root: Node
    keys: RobotYaml
    urdf_path: Path
    urdf_text: bytes


def robot_files(name_or_folder: str | Path) -> RobotFiles:
    """Of a robot by its name, or of any robot's folder or archive. Raises RobotError where robot.yaml is wrong."""
    try:
        named = robot_folders() if isinstance(name_or_folder, str) else {}
        folder = named.get(str(name_or_folder), Path(name_or_folder))
        folder = unpacked(folder) if is_archive(folder) else folder
        text = read_bytes(folder / "robot.yaml")
        root, keys = _keys(text, str(folder / "robot.yaml"))
        return RobotFiles(folder, text, root, keys, folder / keys.top["urdf"], read_bytes(folder / keys.top["urdf"]))
    except RobotError:
        raise
    except DocumentError as error:
        raise RobotError(error.path, error.problems) from None


def load_robot(name_or_folder: str | Path) -> Robot:
    """Reads a robot by its name, or any robot's folder or archive. Raises RobotError with all that is wrong."""
    try:
        return _load(robot_files(name_or_folder))
    except RobotError:
        raise
    except DocumentError as error:
        raise RobotError(error.path, error.problems) from None


def robot_of(robot: Robot | str | Path) -> Robot:
    """A robot as it is, or as `load_robot` reads it. Raises RobotError, and TypeError for anything else."""
    if isinstance(robot, Robot):
        return robot
    if not isinstance(robot, str | Path):
        raise TypeError(f"robot: expected a Robot, a robot's name or its folder, not {type(robot).__name__}")
    return load_robot(robot)


@lru_cache(maxsize=4)
def _keys(text: bytes, path: str) -> tuple[Node, RobotYaml]:
    root = parse_mapping(text, path)
    return root, RobotYaml(root, path, RobotError)


_READ: dict[tuple[bytes, bytes], Robot] = {}
"""Descriptions that were found right, by their bytes: commands read the same one again and again."""


def _load(files: RobotFiles) -> Robot:
    folder, file, urdf_path, key = files.folder, files.keys, files.urdf_path, (files.yaml_text, files.urdf_text)
    if key in _READ:
        return replace(_READ[key], folder=folder, urdf_path=urdf_path)
    yaml_path = folder / "robot.yaml"
    xml = parse_xml(files.urdf_text, str(urdf_path))
    read, problems = read_urdf(xml, str(urdf_path))
    limbs = None if read is None else _limbs(RobotRules(read, file.top["body_link"], problems), file, str(yaml_path))
    problems = [replace(problem, file=problem.file or str(urdf_path)) for problem in problems]
    if read is None or limbs is None:
        raise RobotError(str(yaml_path), problems)
    robot = Robot(
        name=file.top["name"],
        folder=folder,
        urdf_path=urdf_path,
        urdf=read,
        body_link=file.top["body_link"],
        limbs=typing.cast(tuple[Limb, Limb, Limb, Limb], limbs),
        hash=hashlib.sha256(robot_meaning(files.root, xml).encode()).hexdigest(),
        **file.sections,
    )
    problems += motor_problems(robot)
    problems += gain_problems(robot)
    if not any(problem.file for problem in problems):  # masses and limits that can be reckoned with
        problems += joint_loop_problems(robot)
    if problems:
        raise RobotError(str(yaml_path), problems)
    if len(_READ) == MOST_READ:
        _READ.clear()
    _READ[key] = robot
    return robot


def full_name(name: str, prefix: str) -> str:
    """A name of section `limb` for the limb with this prefix, which stands for {}; without {} it is PREFIX_name."""
    return name.replace("{}", prefix) if "{}" in name else f"{prefix}_{name}"


def _limbs(rules: RobotRules, file: RobotYaml, path: str) -> tuple[Limb, ...] | None:
    """None where a limb has other joints than robot.yaml says, or joints that place no gripper; what is wrong is among
    the rules' problems.
    """
    if not rules.check_tree():
        return None
    chains: dict[str, Chain] = {}
    fingers: dict[str, tuple[str, str]] = {}
    names = file.limb
    for name, limb in file.limbs.items():
        prefix = limb["prefix"]
        gripper_link, (one, other) = full_name(names.gripper_frame, prefix), names.finger_joints
        chain = rules.chain(name, gripper_link, [full_name(joint, prefix) for joint in names.joints])
        both = (full_name(one, prefix), full_name(other, prefix))
        there = rules.check_fingers(gripper_link, both, file.sections["gripper"].opening_m)
        if chain is not None and there:
            chains[name], fingers[name] = chain, both
    if len(chains) < len(file.limbs):
        return None
    joints = [joint for chain in chains.values() for joint in chain.joints]
    joints += [rules.urdf.joints[finger] for both in fingers.values() for finger in both]
    rules.check_bodies(joints, [chain.gripper_link for chain in chains.values()])
    rules.check_sides(chains)
    section = file.sections["transmissions"]
    problems: list[Problem] = []
    limbs, narrow = [], {}
    for name, chain in chains.items():
        transmission = _transmission(file, name, chain, problems)
        if not problems:
            left = narrowed(transmission, section, chain.joints)
            problems += limit_problems(name, chain.joints, left)
        if problems:
            rules.problems.append(replace(problems[0], file=problems[0].file or path))
            return None
        narrow[name] = _with_joints(chain, left)
        own = joint_limits(chain.joints), own_limits(section, len(left))
        by = transmission, transmission.reached(joint_limits(left), *own)
        limbs.append(_limb(rules.urdf, name, file.limbs[name]["bus"], narrow[name], fingers[name], *by))
    if have_closed_form(narrow):
        return tuple(limbs)
    slots = max(JOINTS, *(len(limb.joints) for limb in limbs))
    whole = []
    for each in limbs:
        if (made := completed(_without_closed_form(each), slots)) is None:
            rules.note(f"limb {each.name}", "", CANNOT_PLACE)
        else:
            whole.append(on_one_branch(made))
    return tuple(whole) if len(whole) == len(limbs) else None


def _transmission(file: RobotYaml, limb: str, chain: Chain, problems: list[Problem]) -> Transmission:
    """Of a limb, right where no problem is added."""
    section, keys = file.sections["transmissions"], file.sections["five_bar"]
    joints, first = chain.joints, int(keys.first_joint) - 1
    problems += transmission_problems(section, len(joints))
    if first < 0 or problems:
        return Transmission.of(section, 0 if problems else len(joints))
    if keys.first_joint != first + 1 or first + 2 > len(joints):
        expected = f"expected the number of a joint with another behind it, of {len(joints)}"
        problems.append(Problem("five_bar.first_joint", f"{keys.first_joint:g}", expected))
        return Transmission.of(section, len(joints))
    at_zero, pair = _at_zero(chain), slice(first, first + 2)
    if (found := geometry(at_zero.axes[pair], at_zero.points_m[pair])) is None:
        expected = f"of limb {limb}, expected joints about parallel axes apart from each other"
        problems.append(Problem("five_bar.first_joint", f"{keys.first_joint:g}", expected))
        return Transmission.of(section, len(joints))
    middle_rad = np.array([(joint.lower + joint.upper) / 2 for joint in joints[pair]])
    five_bar = FiveBar(keys, *found, middle_rad)
    problems += five_bar_problems(section, five_bar, limb)
    return Transmission.of(section, len(joints), five_bar)


def _with_joints(chain: Chain, joints: tuple[Joint, ...]) -> Chain:
    moving = (replace(step, joint=joint) for step, joint in zip(chain.steps, joints, strict=False))
    return Chain((*moving, chain.steps[-1]))


def _without_closed_form(limb: Limb) -> Limb:
    lengths = np.linalg.norm(np.diff(np.vstack([limb.at_zero.points_m, limb.at_zero.gripper_m]), axis=0), axis=1)
    return replace(
        limb,
        closed_form=False,
        senses=np.ones(len(limb.joints)),
        mount_rad=0.0,
        upper_link_m=float(lengths[:2].sum()),
        lower_link_m=float(lengths[2:-1].sum()),
        wrist_to_gripper_m=float(lengths[-1]),
        gripper_mount_rad=0.0,
    )


def _limb(
    urdf: Urdf,
    name: str,
    bus: int,
    chain: Chain,
    fingers: tuple[str, str],
    transmission: Transmission,
    actuators: Limits,
) -> Limb:
    shoulder, _, elbow, wrist, *_, mount = chain.steps
    hand_mass, hand_com = _hand(urdf, chain.gripper_link, fingers)
    return Limb(
        name=name,
        bus=bus,
        joints=chain.joints,
        gripper_link=chain.gripper_link,
        finger_joints=fingers,
        senses=np.array([step.sense for step in chain.steps[:-1]]),
        shoulder_b_m=np.array(shoulder.xyz_m),
        mount_rad=shoulder.rpy_rad[2],
        upper_link_m=elbow.xyz_m[0],
        lower_link_m=wrist.xyz_m[0],
        wrist_to_gripper_m=-mount.xyz_m[2],
        gripper_mount_rad=mount.rpy_rad[2],
        hand_mass_kg=hand_mass,
        hand_com_g_m=hand_com,
        closed_form=True,
        at_zero=_at_zero(chain),
        transmission=transmission,
        actuators=actuators,
    )


def _at_zero(chain: Chain) -> AtZero:
    place, turn = np.zeros(3), np.eye(3)
    places, turns = [], []
    for step in chain.steps:
        place, turn = place + turn @ np.array(step.xyz_m), turn @ rotation(step.rpy_rad)
        places.append(place)
        turns.append(turn)
    axes = [at @ np.array(joint.axis) for at, joint in zip(turns, chain.joints, strict=False)]
    points, rotations = np.array(places), np.array(turns)
    return AtZero(np.array(axes), points[:-1], rotations[:-1], points[-1], rotations[-1])


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
    return mass, moment / max(mass, 1e-9)
