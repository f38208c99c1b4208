"""An imported robot as the two files of a robot folder."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts.robot_bounds import LEAST_JOINTS
from crux_contracts.robot_yaml import node_numbers
from crux_contracts.urdf import roll_pitch_yaw, rotation
from crux_contracts.yaml_writer import as_yaml
from numpy.typing import NDArray

from crux_tools.robot.facts import JointFacts
from crux_tools.robot.mapping import Mapping
from crux_tools.robot.serial import ROUND_M, SNAP, Part, Pose, SerialLimb, bare_names, placed_frames

Array = NDArray[np.float64]
RIGHT = math.pi / 2
ORIGIN = np.zeros(3)
COLOURS = {
    "trunk": "0.25 0.30 0.40 1", "one": "0.80 0.50 0.10 1", "next": "0.90 0.70 0.20 1",
    "palm": "0.30 0.30 0.35 1", "finger": "0.60 0.10 0.10 1",
}  # fmt: skip
LINK_COLOURS = ("one", "next")
BODY, GRIPPER, FINGERS = "base", "gripper", ("finger1_slide", "finger2_slide")


@dataclass(frozen=True)
class Hand:
    """What stands for the meshes of a gripper [m]: pads, fingers up to the palm, and a palm as wide as they open."""

    pad_radius_m: float
    finger_height_m: float

    @staticmethod
    def of(mapping: Mapping, like: dict[str, Any]) -> Hand:
        """As robot.yaml will have it."""
        names = "pad_radius_m", "finger_height_m"
        return Hand(*(float(mapping.set.get(f"gripper.{name}", like["gripper"][name])) for name in names))

    def palm(self, opening_m: float) -> tuple[Pose, ET.Element]:
        """In the gripper's frame."""
        thick = 2 * self.pad_radius_m
        box = ET.Element("box", size=_text([2 * opening_m, thick, thick]))
        return Pose(np.array([0.0, 0.0, self.finger_height_m + self.pad_radius_m]), np.eye(3)), box

    def finger(self, sign: float) -> tuple[Pose, ET.Element]:
        """Behind its pad, in a frame on the pad's face."""
        radius, length = 2 / 3 * self.pad_radius_m, self.finger_height_m
        solid = ET.Element("cylinder", radius=_text([radius]), length=_text([length]))
        return Pose(np.array([sign * self.pad_radius_m, 0.0, length / 2]), np.eye(3)), solid


def urdf_text(
    mapping: Mapping,
    body: Part,
    limbs: list[SerialLimb],
    facts: dict[str, tuple[list[JointFacts], JointFacts]],
    hand: Hand,
) -> str:
    """The URDF, in which names are PREFIX_name."""
    root = ET.Element("robot", name=mapping.name)
    for colour, rgba in COLOURS.items():
        ET.SubElement(ET.SubElement(root, "material", name=colour), "color", rgba=rgba)
    home = Pose(np.zeros(3), np.eye(3))
    element = _link(root, BODY, body, home)
    radius = mapping.capsule_radius_m or 0.0
    if body.meshes and radius > 0:
        inside = np.abs([limb.points[:2] for limb in limbs]).min(axis=(0, 1)) - 2 * radius  # of the limbs' capsules
        sides = 2 * np.maximum(inside[:2], radius)
        trunk = np.array([*sides, 2 * radius])
        for tag in ("collision", "visual"):
            _shape(element, home, ET.Element("box", size=_text(trunk)), "trunk", tag)
        for limb in limbs:  # for the eye: what carries a shoulder is within the limb's own reach
            shoulder = placed_frames(limb)[1][0]
            start = np.clip(shoulder, -trunk / 2, trunk / 2)
            _capsule(element, shoulder - start, radius, "trunk", start)
    for limb in limbs:
        _limb(root, limb, facts[limb.name], mapping, radius, hand)
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _limb(
    root: ET.Element,
    limb: SerialLimb,
    facts: tuple[list[JointFacts], JointFacts],
    mapping: Mapping,
    radius: float,
    hand: Hand,
) -> None:
    yaw, points = placed_frames(limb)
    turn = rotation((0.0, 0.0, yaw))
    parent, before = BODY, np.zeros(3)
    for i, (name, fact) in enumerate(zip(bare_names(mapping), facts[0], strict=True)):
        child = f"{limb.name}_link{i + 1}"
        joint = _joint(root, f"{limb.name}_{name}", "revolute", parent, child)
        place = points[i] if i == 0 else turn.T @ (points[i] - before)
        ET.SubElement(joint, "origin", xyz=_text(place), rpy=_text([0, 0, yaw if i == 0 else 0], 12))
        ET.SubElement(joint, "axis", xyz=_text(_snapped(turn.T @ limb.axes[i], 1.0), 12))
        _limit(joint, fact)
        frame = Pose(points[i], turn)
        element = _link(root, child, limb.parts[i], frame)
        above_palm = limb.gripper.place + limb.gripper.turn[:, 2] * (hand.finger_height_m + radius)
        end = points[i + 1] if i < len(points) - 1 else above_palm
        if limb.parts[i].meshes and radius > 0:
            _capsule(element, turn.T @ (end - points[i]), radius, LINK_COLOURS[i % len(LINK_COLOURS)])
        parent, before = child, points[i]
    _gripper(root, limb, facts[1], turn, parent, hand)


def _gripper(root: ET.Element, limb: SerialLimb, fact: JointFacts, turn: Array, parent: str, hand: Hand) -> None:
    _, points = placed_frames(limb)
    gripper = f"{limb.name}_{GRIPPER}"
    mount = _joint(root, f"{limb.name}_mount", "fixed", parent, gripper)
    rpy = roll_pitch_yaw(turn.T @ limb.gripper.turn)
    ET.SubElement(
        mount, "origin", xyz=_text(turn.T @ (limb.gripper.place - points[-1])), rpy=_text(_snapped(rpy, RIGHT), 12)
    )
    element = _link(root, gripper, limb.parts[-1], limb.gripper)
    if limb.parts[-1].meshes:
        _shape(element, *hand.palm(fact.limits[1]), "palm")
    for finger, name, sign in zip(limb.fingers, FINGERS, (1.0, -1.0), strict=True):
        child = f"{limb.name}_{name.removesuffix('_slide')}"
        joint = _joint(root, f"{limb.name}_{name}", "prismatic", gripper, child)
        ET.SubElement(joint, "origin", xyz="0 0 0", rpy="0 0 0")
        ET.SubElement(joint, "axis", xyz=_text([sign, 0, 0]))
        _limit(joint, fact)
        start = limb.gripper.turn @ np.array([finger.start_m[0], 0.0, 0.0])
        element = _link(root, child, finger.part, Pose(limb.gripper.place + start, limb.gripper.turn))
        if finger.part.meshes:
            _shape(element, *hand.finger(sign), "finger")


def _joint(root: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _limit(joint: ET.Element, fact: JointFacts) -> None:
    low, high = fact.limits
    ET.SubElement(
        joint, "limit", lower=f"{low:g}", upper=f"{high:g}", effort=f"{fact.effort:g}", velocity=f"{fact.speed:g}"
    )


def _link(root: ET.Element, name: str, part: Part, frame: Pose) -> ET.Element:
    """A part's inertia and shapes in a frame."""
    link = ET.SubElement(root, "link", name=name)
    if part.mass_kg > 0:
        com = part.moment_kgm / part.mass_kg
        about_com = part.inertia_kgm2 - part.mass_kg * (com @ com * np.eye(3) - np.outer(com, com))
        tensor = frame.turn.T @ about_com @ frame.turn
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=_text(frame.turn.T @ (com - frame.place), 9))
        ET.SubElement(inertial, "mass", value=f"{part.mass_kg:.9g}")
        rows = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        ET.SubElement(inertial, "inertia", {key: f"{tensor[at]:.9g}" for key, at in rows.items()})
    for pose, solid in part.shapes:
        _shape(link, Pose(frame.turn.T @ (pose.place - frame.place), frame.turn.T @ pose.turn), solid)
    return link


def _shape(link: ET.Element, pose: Pose, solid: ET.Element, colour: str = "", tag: str = "visual") -> None:
    shape = ET.SubElement(link, tag)
    ET.SubElement(shape, "origin", xyz=_text(pose.place), rpy=_text(_snapped(roll_pitch_yaw(pose.turn), RIGHT), 9))
    ET.SubElement(shape, "geometry").append(ET.Element(solid.tag, solid.attrib))
    if colour and tag == "visual":
        ET.SubElement(shape, "material", name=colour)


def _capsule(link: ET.Element, way: Array, radius: float, colour: str, start: Array = ORIGIN) -> None:
    """From `start` in the link's frame."""
    length = float(np.linalg.norm(way))
    if length > radius:
        yaw, pitch = math.atan2(way[1], way[0]), math.atan2(math.hypot(way[0], way[1]), way[2])
        solid = ET.Element("capsule", radius=f"{radius:g}", length=f"{length:.{ROUND_M}f}")
        _shape(link, Pose(start + way / 2, rotation((0.0, pitch, yaw))), solid, colour)


def robot_yaml(mapping: Mapping, like: dict[str, Any], finger: JointFacts) -> str:
    """All keys of the robot it is like, with marks of where each is from."""
    joints = bare_names(mapping)
    sections = {name: dict(content) for name, content in like.items() if isinstance(content, dict)}
    said = {"gripper.opening_m": list(finger.limits), "gripper.max_finger_force_N": finger.effort}
    said |= {"gripper.max_finger_speed_m_s": finger.speed, **mapping.set}
    for place, value in mapping.set.items():
        name, _, key = str(place).partition(".")
        sections.setdefault(name, {}).setdefault(key, value)  # one that may be left out
    lines = [f"# {mapping.name}, brought in by `crux robot import`. msgs/robot_keys.yaml says what each key means.",
             "# Marks: [S] said by the mapping or the URDF, [A] assumed: measure it.",
             as_yaml({"version": like["version"], "name": mapping.name, "urdf": f"{mapping.name}.urdf",
                      "body_link": BODY}, "").rstrip(), "limbs:"]  # fmt: skip
    lines += [f"  {limb}: {{bus: {bus}, prefix: {limb}}}" for bus, limb in enumerate(mapping.limbs)]
    lines += [
        "limb:",
        f"  joints: {_flow(joints)}",
        f"  gripper_frame: {GRIPPER}",
        f"  finger_joints: {_flow(FINGERS)}",
    ]
    for name, section in sections.items():
        if name in ("limbs", "limb"):
            continue
        lines.append(f"{name}:")
        for key, value in section.items():
            place = f"{name}.{key}"
            if place == "can.nodes":
                numbers = ", ".join(f"{joint}: {number}" for joint, number in node_numbers(joints).items())
                lines.append(f"  nodes: {{{numbers}}}")
                continue
            mark = "[S]" if place in said else f"[A: as of {mapping.like}]"
            lines.append(f"  {key}: {_flow(said.get(place, _of_joints(value, len(joints))))} # {mark}")
    return "\n".join(lines) + "\n"


def _of_joints(value: Any, count: int) -> Any:
    """A list of one value a joint for another number of joints: its first ones, or its last one again."""
    if not isinstance(value, list) or len(value) < LEAST_JOINTS:
        return value
    return [value[min(i, len(value) - 1)] for i in range(count)]


def _flow(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(_flow(each) for each in value)}]"
    return as_yaml({"x": value}, "").removeprefix("x: ").strip()


def _snapped(values: Array, grid: float) -> Array:
    """Those that are nearly whole numbers of `grid` become them."""
    near = np.round(values / grid) * grid
    return np.asarray(np.where(np.abs(values - near) < SNAP, near, values))


def _text(values: Any, digits: int = ROUND_M) -> str:
    return " ".join(f"{round(float(v), digits) + 0.0:.16g}" for v in values)
