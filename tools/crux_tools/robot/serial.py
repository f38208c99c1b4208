"""A climber's URDF as crux has climbers: a body, and of every limb its joints, the gripper and two fingers.

What is fixed or locked to a link becomes part of it. All links' frames are parallel to the limb's first one where all
joints are at zero, and stand where a joint's axis is nearest to the one before it, so that the same limb looks the same
whatever conventions its URDF has. Everything is worked out in the body frame at that posture.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from crux_contracts.urdf import SHAPES, SPACE, Joint, Urdf, about, link_shapes, rotation
from crux_contracts.yaml_document import Problem
from numpy.typing import NDArray

from crux_tools.robot.mapping import Mapping, bare

Array = NDArray[np.float64]
SNAP = 2e-4  # of directions: URDFs round a quarter of a turn
ROUND_M = 5  # digits of lengths
PARALLEL = 1e-3  # sine between axes
TURNING = ("revolute", "continuous")
NO_GRIPPER = "which it has to have"
WAY = "rpy_rad turns the gripper's frame in that of its link until x is the opening axis"
SLIDES = 0.02  # sine between a finger's slide and the gripper's x


@dataclass(frozen=True)
class Pose:
    """(3,) and (3, 3), in the body frame."""

    place: Array
    turn: Array

    def then(self, xyz: Array, turn: Array) -> Pose:
        return Pose(self.place + self.turn @ xyz, self.turn @ turn)


@dataclass
class Part:
    """What moves as one: mass, moment and inertia about the body's origin, and shapes."""

    mass_kg: float = 0.0
    moment_kgm: Array = field(default_factory=lambda: np.zeros(3))
    inertia_kgm2: Array = field(default_factory=lambda: np.zeros((3, 3)))
    shapes: list[tuple[Pose, ET.Element]] = field(default_factory=list)
    meshes: bool = False

    def scale(self, factor: float) -> None:
        """Its masses."""
        self.mass_kg, self.moment_kgm, self.inertia_kgm2 = (
            self.mass_kg * factor,
            self.moment_kgm * factor,
            self.inertia_kgm2 * factor,
        )


@dataclass
class Finger:
    """Its part at the posture of the URDF, where its slide starts, its direction and limits, all in the gripper."""

    part: Part
    joint: Joint
    start_m: Array
    axis: Array


@dataclass
class SerialLimb:
    """Axes (J, 3) and points on them (J, 3), the gripper's frame, and J + 1 parts: the links and the gripper."""

    name: str
    joints: list[Joint]
    axes: Array
    points: Array
    gripper: Pose
    parts: list[Part]
    fingers: list[Finger]


class Reader:
    """Takes a URDF apart. What does not fit is noted in `problems`, with what the mapping would have to say. `poses` of
    links are those with all joints at zero.
    """

    def __init__(self, urdf: Urdf, root: ET.Element, mapping: Mapping, problems: list[Problem]) -> None:
        self.urdf, self.mapping, self.problems = urdf, mapping, problems
        self.elements = {str(link.get("name")): link for link in root.findall("link")}
        self.below: dict[str, list[Joint]] = {}
        for joint in urdf.joints.values():
            self.below.setdefault(joint.parent, []).append(joint)
        self.locked = {
            mapping.of(name, limb): angle for limb in mapping.limbs for name, angle in mapping.locked.items()
        }
        for key in ("crank", "rod") if mapping.five_bar else ():
            self.locked |= {mapping.of(mapping.five_bar[key], limb): 0.0 for limb in mapping.limbs}
        self.poses: dict[str, Pose] = {}
        self.used: set[str] = set()
        self.seen: set[str] = set()

    def note(self, key: str, value: str, expected: str) -> None:
        self.problems.append(Problem(key, value, expected))

    def whole(self) -> tuple[Part, list[SerialLimb]]:
        """The body's part and the limbs that could be read."""
        if not self.has_body():
            return Part(), []
        body = Part()
        hanging: dict[str, Pose] = {}
        for link, pose in self._group(self.mapping.body_link, Pose(np.zeros(3), np.eye(3)), hanging):
            self._add(body, link, pose)
        found = [self._limb(limb, hanging) for limb in self.mapping.limbs]
        limbs = [limb for limb in found if limb is not None]
        if len(limbs) == len(found):
            for name, joint in self.urdf.joints.items():
                if joint.kind != "fixed" and name not in self.used and name not in self.locked:
                    self.note(f"locked.{name}", joint.kind, "is missing: no joint of a limb or finger, locked at?")
        return body, limbs

    def has_body(self) -> bool:
        """Whether the URDF has the body's link; where it has not, that is noted."""
        known = self.mapping.body_link in self.urdf.links
        if not known:
            roots = ", ".join(sorted({joint.parent for joint in self.urdf.joints.values()} & set(self._roots())))
            self.note("body_link", self.mapping.body_link, f"no such link in the URDF; its root is {roots}")
        return known

    def _roots(self) -> Iterator[str]:
        children = {joint.child for joint in self.urdf.joints.values()}
        return (link for link in self.urdf.links if link not in children)

    def _group(self, link: str, pose: Pose, hanging: dict[str, Pose]) -> Iterator[tuple[str, Pose]]:
        """A link and all that is fixed or locked to it; joints that move go to `hanging`, with where they are."""
        if link in self.seen:
            self.note("body_link", link, "is reached on two ways: expected each link of the URDF to hang on one joint")
            return
        self.seen.add(link)
        self.poses[link] = pose
        yield link, pose
        for joint in self.below.get(link, []):
            at = pose.then(np.array(joint.xyz_m), rotation(joint.rpy_rad))
            angle = self.locked.get(joint.name)
            if joint.kind == "fixed":
                yield from self._group(joint.child, at, hanging)
            elif angle is not None:
                turn = about(np.array(joint.axis), 0.0 if joint.kind == "prismatic" else angle)
                slide = np.array(joint.axis) * (angle if joint.kind == "prismatic" else 0.0)
                yield from self._group(joint.child, at.then(slide, turn), hanging)
            else:
                hanging[joint.name] = at

    def _add(self, part: Part, name: str, pose: Pose) -> None:
        link = self.urdf.links[name]
        xx, xy, xz, yy, yz, zz = link.inertia_kg_m2
        com = pose.place + pose.turn @ np.array(link.com_m)
        part.mass_kg += link.mass_kg
        part.moment_kgm = part.moment_kgm + link.mass_kg * com
        own = pose.turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ pose.turn.T
        part.inertia_kgm2 = part.inertia_kgm2 + own + _point_mass(link.mass_kg, com)
        for shape in link_shapes(self.elements[name]):
            geometry, origin = shape.find("geometry"), shape.find("origin")
            if geometry is None or len(geometry) == 0 or geometry[0].tag not in SHAPES:
                part.meshes = True
                continue
            xyz, rpy = (_numbers(origin, key) for key in ("xyz", "rpy"))
            part.shapes.append((pose.then(xyz, rotation((rpy[0], rpy[1], rpy[2]))), geometry[0]))

    def _limb(self, limb: str, hanging: dict[str, Pose]) -> SerialLimb | None:
        names = [self.mapping.of(name, limb) for name in self.mapping.joints]
        if not self._has(limb, names):
            return None
        axes, points, joints, parts = [], [], [], []
        gripper_link = self.mapping.of(self.mapping.gripper["link"], limb)
        gripper: Pose | None = None
        for index, name in enumerate(names):
            if name not in hanging:
                there = ", ".join(hanging) or "none"
                self.note(
                    "joints", name, f"expected one that moves next on limb {limb}: {there}; or lock what is before"
                )
                return None
            joint, at = self.urdf.joints[name], hanging[name]
            self.used.add(name)
            joints.append(joint)
            axes.append(at.turn @ np.array(joint.axis))
            points.append(at.place)
            part, palm, hanging = Part(), Part(), {}
            for link, pose in self._group(joint.child, at, hanging):
                if link == gripper_link:
                    gripper = pose
                hand = gripper is not None and self._hangs(link, gripper_link)
                self._add(palm if hand else part, link, pose)
            parts.append(part)
            if gripper is not None and index < len(names) - 1:
                self.note("joints", names[-1], f"expected all joints of limb {limb} before {gripper_link}")
                return None
        if gripper is None:
            self.note("gripper.link", gripper_link, f"expected a link fixed behind joint {names[-1]}")
            return None
        xyz = np.array(self.mapping.gripper.get("origin_m", [0.0, 0.0, 0.0]))
        roll, pitch, yaw = self.mapping.gripper.get("rpy_rad", [0.0, 0.0, 0.0])
        gripper = gripper.then(xyz, rotation((roll, pitch, yaw)))
        palm.shapes = [shape for shape in palm.shapes if not _surrounds(*shape, gripper.place)]
        fingers = self._fingers(limb, gripper, hanging)
        whole = SerialLimb(limb, joints, np.array(axes), np.array(points), gripper, [*parts, palm], fingers)
        return whole if len(fingers) == 2 else None

    def _has(self, limb: str, names: list[str]) -> bool:
        """Whether the URDF has what the mapping names of a limb, each of its kind; all that it has not is noted."""
        before, fingers = len(self.problems), [self.mapping.of(finger, limb) for finger in self.mapping.fingers]
        for key, given, kinds in (("joints", names, TURNING), ("fingers", fingers, ("prismatic",))):
            all_such = [joint.name for joint in self.urdf.joints.values() if joint.kind in kinds]
            for name in given:
                joint = self.urdf.joints.get(name)
                if joint is None or joint.kind not in kinds:
                    what = name if joint is None else f"{name}: {joint.kind}"
                    there = ", ".join(all_such) or f"none: crux grips with two fingers that slide, {NO_GRIPPER}"
                    kind = " or ".join(kinds)
                    self.note(key, what, f"expected of limb {limb} one of the URDF's {kind} joints: {there}")
        link = self.mapping.of(self.mapping.gripper["link"], limb)
        if link not in self.urdf.links:
            self.note("gripper.link", link, f"no such link in the URDF for limb {limb}")
        return len(self.problems) == before

    def _hangs(self, link: str, above: str) -> bool:
        by_child = {joint.child: joint.parent for joint in self.urdf.joints.values()}
        while link != above and link in by_child:
            link = by_child[link]
        return link == above

    def _fingers(self, limb: str, gripper: Pose, hanging: dict[str, Pose]) -> list[Finger]:
        found = []
        for name in (self.mapping.of(finger, limb) for finger in self.mapping.fingers):
            if name not in hanging or self.urdf.joints[name].kind != "prismatic":
                there = ", ".join(hanging) or "none"
                self.note("fingers", name, f"expected a sliding joint on the gripper of limb {limb}: {there}")
                continue
            joint, at = self.urdf.joints[name], hanging[name]
            axis = gripper.turn.T @ at.turn @ np.array(joint.axis)
            if np.hypot(axis[1], axis[2]) > SLIDES:
                shown = " ".join(f"{v:.3g}" for v in np.round(axis, 3) + 0.0)
                self.note("gripper.rpy_rad", f"{name} slides along {shown}", f"expected x: {WAY}")
            part = Part()
            for link, pose in self._group(joint.child, at, {}):
                self._add(part, link, pose)
            self.used.add(name)
            found.append(Finger(part, joint, gripper.turn.T @ (at.place - gripper.place), axis))
        return found


def placed_frames(limb: SerialLimb) -> tuple[float, Array]:
    """The yaw of the limb's frames in the body, and where they stand (J, 3), in the body frame."""
    axes, points = limb.axes, limb.points.copy()
    first, second = axes[0], axes[1]
    if np.linalg.norm(np.cross(first, second)) > PARALLEL:
        points[0] = _nearest(points[0], first, points[1], second)
    for i in range(1, len(points)):
        if np.linalg.norm(np.cross(axes[i - 1], axes[i])) > PARALLEL:
            points[i] = _nearest(points[i], axes[i], points[i - 1], axes[i - 1])
        else:
            points[i] = points[i] + axes[i] * (axes[i] @ (points[i - 1] - points[i]))
    away = points[-1] - points[0]
    ahead = np.cross(second, [0.0, 0.0, 1.0])
    if abs(second[2]) < SNAP and np.linalg.norm(ahead) > 1 - SNAP:
        away = ahead * (1.0 if ahead @ away >= 0 else -1.0)
    yaw = float(np.arctan2(away[1], away[0]))
    quarter = np.round(yaw / (np.pi / 2)) * np.pi / 2
    return float(quarter) if abs(yaw - quarter) < SNAP else yaw, points


def bare_names(mapping: Mapping) -> list[str]:
    """Of the joints in robot.yaml."""
    names = [bare(name) for name in mapping.joints]
    return names if len(set(names)) == len(names) else [f"joint{i + 1}" for i in range(len(names))]


def _nearest(point: Array, axis: Array, other: Array, other_axis: Array) -> Array:
    """The place on an axis that is nearest to another."""
    along = np.linalg.lstsq(np.column_stack([axis, -other_axis]), other - point, rcond=None)[0]
    return np.asarray(point + along[0] * axis)


def _surrounds(pose: Pose, solid: ET.Element, place: Array) -> bool:
    """Whether a place is nearer to a shape's centre than any of its edges or radii: a mark between pads is no shape."""
    sizes = [float(word) for value in solid.attrib.values() for word in SPACE.split(value) if word]
    return bool(np.linalg.norm(place - pose.place) < min(sizes))


def _point_mass(mass_kg: float, place: Array) -> Array:
    return np.asarray(mass_kg * (place @ place * np.eye(3) - np.outer(place, place)))


def _numbers(element: ET.Element | None, key: str) -> Array:
    text = "0 0 0" if element is None else element.get(key, "0 0 0")
    return np.array([float(word) for word in SPACE.split(text) if word])
