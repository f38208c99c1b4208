"""`crux robot import`: a maker's URDF and a mapping become a robot folder, or all that is missing is told at once."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from crux_contracts.records import keys_of
from crux_contracts.robot import RobotError, load_robot, robot_files, robot_names
from crux_contracts.robot_bounds import LEAST_JOINTS
from crux_contracts.urdf import Urdf, parse_xml, read_urdf
from crux_contracts.yaml_document import Plain, Problem, read_bytes, values
from crux_msgs.robot_keys import SECTIONS

from crux_tools.errors import UsageError
from crux_tools.robot.facts import Facts, JointFacts
from crux_tools.robot.linkage import joint_facts, read_linkage
from crux_tools.robot.mapping import Mapping, MappingError, read_mapping
from crux_tools.robot.serial import NO_GRIPPER, TURNING, Reader
from crux_tools.robot.written import Hand, robot_yaml, urdf_text
from crux_tools.robot.xacro_file import arguments_of, expanded, is_xacro

MESH = "<mesh>"  # of problems that an import has a cure for
FREE = ("floating", "planar")  # of a URDF's joints


@dataclass(frozen=True)
class Imported:
    """A robot folder, what was assumed for it, and why planner and runtime do not take it, if so."""

    folder: Path
    assumed: list[str]
    problems: list[str]


def imported(urdf_path: Path, mapping_path: Path | None, folder: Path, xacro: Sequence[str] = ()) -> Imported:
    """Of a URDF, or a xacro file and its arguments NAME:=VALUE. Raises DocumentError with everything that is missing or
    wrong; then nothing is written.
    """
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"{folder}: is there already: name another folder, or take it away")
    problems: list[Problem] = []
    mapping = read_mapping(mapping_path, problems)
    text = read_bytes(urdf_path)
    if is_xacro(urdf_path, text):
        text = expanded(urdf_path, text, arguments_of(xacro))
    root = parse_xml(text, str(urdf_path))
    _ground(root, mapping.body_link)
    urdf, found = read_urdf(root, str(urdf_path))
    if mapping.like and mapping.like not in robot_names():
        problems.append(Problem("like", mapping.like, f"expected one of {', '.join(robot_names())}"))
    if urdf is None:
        problems += [replace(each, file=str(urdf_path)) for each in found if not each.value.startswith(MESH)]
        raise MappingError(mapping.path, problems)
    reader = Reader(urdf, root, mapping, problems)
    if any(not getattr(mapping, key) for key in ("body_link", "limbs", "joints", "gripper", "fingers")):
        if mapping.body_link:
            reader.has_body()
        problems.append(_there(urdf, str(urdf_path)))
        raise MappingError(mapping.path, problems)
    own = {f"joint {mapping.of(name, limb)}" for name in mapping.joints for limb in mapping.limbs}
    mimics = [each for each in found if each.value == "mimic" and each.key in own]
    problems += [replace(each, file=str(urdf_path)) for each in mimics]
    body, limbs = reader.whole()
    facts, numbers, linkage = Facts(mapping, problems), {}, read_linkage(reader, limbs)
    for limb in limbs:
        joints, said = joint_facts(linkage, reader, facts, limb)
        numbers[limb.name] = joints, facts.finger(limb.fingers)
        mapping.set = said | mapping.set
    if len(limbs) == len(mapping.limbs):
        facts.scale_masses(body, limbs)
    meshes = body.meshes or any(part.meshes for limb in limbs for part in limb.parts)
    if meshes and mapping.capsule_radius_m is None:
        facts.missing("capsule_radius_m", "the URDF has meshes; capsules of this radius along the links stand for them")
    facts.tell()
    like = _plain(mapping)
    problems += _unknown(mapping, like)
    if problems:
        raise MappingError(mapping.path, problems)
    folder.mkdir(parents=True, exist_ok=True)
    written = urdf_text(mapping, body, limbs, numbers, Hand.of(mapping, like))
    (folder / f"{mapping.name}.urdf").write_text(written, encoding="utf-8")
    first: JointFacts = numbers[limbs[0].name][1]
    (folder / "robot.yaml").write_text(robot_yaml(mapping, like, first), encoding="utf-8")
    return Imported(folder, _assumed(mapping, meshes), _refusals(folder))


def _ground(root: ET.Element, body_link: str) -> None:
    """Fixes what floats between the URDF's root and the body: crux's body is free anyway. Without the body, all that
    floats.
    """
    above = {_link_of(joint, "child"): joint for joint in root.findall("joint")}
    known = any(link.get("name") == body_link for link in root.findall("link"))
    before, link = set[str](), body_link
    while link in above and link not in before:
        before.add(link)
        link = _link_of(above[link], "parent")
    for child, joint in above.items():
        if joint.get("type") in FREE and (not known or child in before):
            joint.set("type", "fixed")


def _link_of(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _there(urdf: Urdf, path: str) -> Problem:
    """What a mapping may name: the joints of the URDF that move."""
    moving = [f"{joint.name} ({joint.kind})" for joint in urdf.joints.values() if joint.kind != "fixed"]
    slide = any(joint.kind == "prismatic" for joint in urdf.joints.values())
    lacks = "" if slide else f"; none slides: crux grips with two fingers that do, {NO_GRIPPER}"
    if moving and (most := _most_in_a_row(urdf)) < LEAST_JOINTS:
        lacks += f"; at most {most} turn one behind the other: a limb needs {LEAST_JOINTS} at least, add its wrist"
    return Problem("joints that move", ", ".join(moving) or "none", f"a mapping names those of limbs{lacks}", file=path)


def _most_in_a_row(urdf: Urdf) -> int:
    """Joints that turn between the root and any link."""
    above = {joint.child: joint for joint in urdf.joints.values()}
    most = 0
    for link in urdf.links:
        at, turning, seen = link, 0, set[str]()
        while at in above and at not in seen:
            seen.add(at)
            turning += above[at].kind in TURNING
            at = above[at].parent
        most = max(most, turning)
    return most


def _plain(mapping: Mapping) -> dict[str, Plain]:
    """robot.yaml of the robot that the mapping is like."""
    if mapping.like not in robot_names():
        return {}
    content = values(robot_files(mapping.like).root)
    return content if isinstance(content, dict) else {}


def _unknown(mapping: Mapping, like: dict[str, Plain]) -> list[Problem]:
    """Keys of `set` that robot.yaml does not have."""
    found = []
    for place in mapping.set if like else {}:
        name, _, key = str(place).partition(".")
        if name not in SECTIONS or key not in keys_of(SECTIONS[name]):
            found.append(Problem(f"set.{place}", "", "no such key of robot.yaml; right is SECTION.KEY"))
    return found


def _assumed(mapping: Mapping, meshes: bool) -> list[str]:
    """What nobody said, in words."""
    found = [f"[A] all of robot.yaml that is marked so is {mapping.like}'s: motors, gains, sensors, limits of control"]
    if mapping.locked:
        found.append(f"[A] {', '.join(mapping.locked)} stay where they are; their links weigh where they are then")
    if mapping.five_bar:
        found.append("[A] crank and rod of the five-bar weigh where they are with all joints at 0")
    if mapping.masses_kg:
        found.append("[A] masses and inertias are the URDF's, scaled")
    if meshes:
        found.append(
            "[A] shapes in place of meshes are capsules along links, boxes for body and palms, cylinders for fingers"
        )
    return found


def _refusals(folder: Path) -> list[str]:
    try:
        load_robot(folder)
    except RobotError as error:
        return [problem.text(error.path) for problem in error.problems]
    return []
