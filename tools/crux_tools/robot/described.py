"""A robot folder read as far as it goes, also where planner and runtime refuse it: for checks of any climber."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from crux_contracts.robot import Robot, RobotError, RobotFiles, full_name, load_robot, robot_files
from crux_contracts.urdf import SHAPES, link_shapes, parse_xml, read_urdf
from crux_planner.checker.limb_model import RobotModelError, WholeRobot, read_model

UNUSABLE = "not looked at: the URDF has values that cannot be used"


@dataclass(frozen=True)
class Described:
    """`robot` is None where crux refuses the description, for `problems`; `model` where even its chains are unclear."""

    files: RobotFiles
    robot: Robot | None
    problems: list[str]
    model: WholeRobot | None
    unclear: str
    sections: dict[str, Any]


def described(name_or_folder: str) -> Described:
    """Raises RobotError where robot.yaml is wrong, or the URDF is no XML."""
    files = robot_files(name_or_folder)
    robot, problems = None, []
    try:
        robot = load_robot(files.folder)
    except RobotError as error:
        problems = [problem.text(error.path) for problem in error.problems]
    root = parse_xml(files.urdf_text, str(files.urdf_path))
    try:
        model, unclear = None if _is_unusable(files, root) else _model(files, root), UNUSABLE
    except (RobotModelError, KeyError, ValueError, AttributeError) as error:
        model, unclear = None, str(error)
    return Described(files, robot, problems, model, unclear, files.keys.sections)


def _is_unusable(files: RobotFiles, root: ET.Element) -> bool:
    """Parts of the URDF cannot be read, or a joint turns about nothing."""
    urdf, problems = read_urdf(root, str(files.urdf_path))
    return urdf is None or any("axis " in problem.value for problem in problems)


def _model(files: RobotFiles, root: ET.Element) -> WholeRobot:
    """Chains, masses and the shapes that crux knows; meshes are left out."""
    above = {}
    for joint in root.findall("joint"):
        child, parent = joint.find("child"), joint.find("parent")
        if child is not None and parent is not None:
            above[child.get("link")] = parent.get("link")
    for name in above:
        steps, at = 0, name
        while at in above and steps <= len(above):
            at, steps = above[at], steps + 1
        if at in above:
            raise RobotModelError(f"link {name} hangs on itself")
    for link in root.iter("link"):
        for shape in link_shapes(link):
            geometry = shape.find("geometry")
            if geometry is None or len(geometry) == 0 or geometry[0].tag not in SHAPES:
                for kind in ("collision", "visual"):
                    for each in link.findall(kind):
                        link.remove(each)
                break
    names, keys = files.keys.limb, files.keys
    limbs = tuple(
        (name, *_full((names.gripper_frame,), limb), _full(names.joints, limb), _full(names.finger_joints, limb))
        for name, limb in keys.limbs.items()
    )
    between = keys.sections["transmissions"], keys.sections["five_bar"]
    return read_model(ET.tostring(root), keys.top["body_link"], limbs, *between)


def _full(names: Sequence[str], limb: dict[str, Any]) -> tuple[str, ...]:
    return tuple(full_name(name, limb["prefix"]) for name in names)


def reasons(problems: Sequence[str]) -> str:
    """How many, in words."""
    return f"{len(problems)} reason{'s' * (len(problems) != 1)}"
