"""The part of URDF that crux reads: links with inertia and simple shapes, joints with origin, axis and limits."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from . import robot_bounds as bounds
from .yaml_document import DocumentError, Problem

Vector = tuple[float, float, float]
Element = TypeVar("Element")
MAX_BYTES = 4_000_000
SHAPES = {"box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": {"radius": 1, "length": 1}}
SHAPES["capsule"] = SHAPES["cylinder"]
KINDS = ("revolute", "prismatic", "continuous", "fixed")
NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
SPACE = re.compile(r"[ \t\r\n]+")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True)
class _Most:
    """The largest absolute value that makes sense, and what to ask where a number is larger."""

    value: float
    unit: str
    hint: str


_ANY = _Most(math.inf, "", "")
_LENGTH = _Most(bounds.MAX_LENGTH_M, "m", ": are these millimetres?")
_ANGLE = _Most(bounds.MAX_ANGLE_RAD, "rad", ": are these degrees?")
_MASS = _Most(bounds.MAX_MASS_KG, "kg", ": are these grams?")


class UrdfError(DocumentError):
    """A robot description that cannot be used."""


@dataclass(frozen=True)
class Link:
    """Inertia about the centre of mass, in axes parallel to the link's frame: xx, xy, xz, yy, yz, zz."""

    name: str
    mass_kg: float
    com_m: Vector
    inertia_kg_m2: tuple[float, ...]


@dataclass(frozen=True)
class Joint:
    """`kind` is revolute, prismatic, continuous or fixed. Limits in rad or m, rad/s or m/s, Nm or N."""

    name: str
    kind: str
    parent: str
    child: str
    xyz_m: Vector
    rpy_rad: Vector
    axis: Vector
    lower: float
    upper: float
    velocity: float
    effort: float


@dataclass(frozen=True)
class Urdf:
    name: str
    links: dict[str, Link]
    joints: dict[str, Joint]

    @property
    def total_mass_kg(self) -> float:
        return math.fsum(link.mass_kg for link in self.links.values())

    def chain(self, root: str, tip: str) -> list[Joint]:
        """Joints from link `root` to link `tip`; KeyError when tip does not hang on root."""
        by_child = {joint.child: joint for joint in self.joints.values()}
        chain: list[Joint] = []
        link = tip
        while link != root:
            joint = by_child[link]
            chain.append(joint)
            link = joint.parent
            if len(chain) > len(by_child):
                raise KeyError(tip)
        return chain[::-1]


def link_shapes(link: ET.Element) -> list[ET.Element]:
    """What of a <link> collides: every <collision>, or every <visual> where there is none."""
    return link.findall("collision") or link.findall("visual")


class _Reader:
    """Elements of a URDF. What is wrong with one that can be read nevertheless is noted in `problems`."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.problems: list[Problem] = []

    def fail(self, key: str, value: str, expected: str) -> UrdfError:
        """Of an element that cannot be read."""
        return UrdfError(self.path, [Problem(key, value, expected)])

    def note(self, key: str, value: str, expected: str) -> None:
        self.problems.append(Problem(key, value, expected))

    def each(self, elements: Iterable[ET.Element], read: Callable[[ET.Element], Element]) -> list[Element]:
        """Those of the elements that can be read."""
        found = []
        for element in elements:
            try:
                found.append(read(element))
            except UrdfError as error:
                self.problems += error.problems
        return found

    def numbers(
        self,
        element: ET.Element | None,
        attribute: str,
        count: int,
        default: str | None,
        key: str,
        most: _Most = _ANY,
    ) -> list[float]:
        text = default if element is None else element.get(attribute, default)
        if text is None:
            raise self.fail(key, "", f"needs the attribute {attribute}")
        words = [word for word in SPACE.split(text) if word]
        values = [float(word) + 0.0 if NUMBER.fullmatch(word) else math.nan for word in words]  # -0 is 0
        if len(values) != count or not all(math.isfinite(v) for v in values):
            raise self.fail(key, f'{attribute}="{text}"', f"expected {count} finite number{'s' * (count > 1)}")
        if max(map(abs, values)) > most.value:
            raise self.fail(key, f'{attribute}="{text}"', f"expected at most {most.value:g} {most.unit}{most.hint}")
        return values

    def vector(self, element: ET.Element | None, attribute: str, default: str, key: str, most: _Most) -> Vector:
        x, y, z = self.numbers(element, attribute, 3, default, key, most)
        return (x, y, z)

    def name(self, element: ET.Element | None, attribute: str, key: str) -> str:
        text = None if element is None else element.get(attribute)
        if not text:
            raise self.fail(key, "", f"needs the attribute {attribute}")
        return text

    def link(self, element: ET.Element) -> Link:
        name = self.name(element, "name", "link")
        key = f"link {name}"
        self.check_shapes(element, key)
        inertial = element.find("inertial")
        if inertial is None:
            return Link(name, 0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
        mass = self.numbers(inertial.find("mass"), "value", 1, None, key, _MASS)[0]
        if mass < 0:
            self.note(key, f"{mass:g}", "expected a mass of 0 kg or more")
        tensor, origin = inertial.find("inertia"), inertial.find("origin")
        xx, xy, xz, yy, yz, zz = (self.numbers(tensor, moment, 1, "0", key)[0] for moment in _MOMENTS)
        com = self.vector(origin, "xyz", "0 0 0", key, _LENGTH)
        turn = rotation(self.vector(origin, "rpy", "0 0 0", key, _ANGLE))
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if mass > 0:
            self.check_inertia(inertia, mass, key)
        turned = turn @ inertia @ turn.T
        return Link(name, mass, com, tuple(float(v) for v in turned[np.triu_indices(3)]))

    def check_inertia(self, inertia: NDArray[np.float64], mass: float, key: str) -> None:
        """Of a body that can exist, of sizes that a robot's links have."""
        small, middle, large = np.linalg.eigvalsh(inertia)
        value = f"principal moments of inertia {small:.3g}, {middle:.3g}, {large:.3g} kg m2"
        if small < mass * bounds.MIN_GYRATION_M**2:
            self.note(key, value, "expected all of them above 0")
        elif small + middle <= large * (1 + bounds.ALIKE):
            self.note(key, value, "expected each below the sum of the two others")
        elif large > mass * bounds.MAX_GYRATION_M**2 * (1 + bounds.ALIKE):
            limit = f"{mass * bounds.MAX_GYRATION_M**2:.3g}"
            self.note(key, value, f"expected at most {limit} for {mass:g} kg: are these kg mm2?")

    def check_shapes(self, link: ET.Element, key: str) -> None:
        for shape in link_shapes(link):
            geometry = shape.find("geometry")
            solid = geometry[0] if geometry is not None and len(geometry) else None
            sizes = None if solid is None else SHAPES.get(solid.tag)
            if solid is None or sizes is None:
                found = "" if solid is None else f"<{solid.tag}> {solid.get('filename', '')}".strip()
                cure = (
                    f"expected {', '.join(SHAPES)}: what collides is a link's <collision>, its <visual> if it has none"
                )
                self.note(key, found, cure)
                continue
            for attribute, count in sizes.items():
                values = self.numbers(solid, attribute, count, None, key, _LENGTH)
                if min(values) <= 0:
                    self.note(key, f'{attribute}="{solid.get(attribute)}"', "expected lengths above 0")

    def joint(self, element: ET.Element) -> Joint:
        name = self.name(element, "name", "joint")
        key = f"joint {name}"
        kind = self.name(element, "type", key)
        if kind not in KINDS:
            raise self.fail(key, kind, "expected revolute, prismatic, continuous or fixed")
        if element.find("mimic") is not None:
            self.note(key, "mimic", "expected a joint with a motor of its own")
        lower, upper, velocity, effort = self.limits(element.find("limit"), kind, key)
        axis = (1.0, 0.0, 0.0) if kind == "fixed" else self.axis(element.find("axis"), key)
        origin = element.find("origin")
        return Joint(
            name,
            kind,
            self.name(element.find("parent"), "link", key),
            self.name(element.find("child"), "link", key),
            self.vector(origin, "xyz", "0 0 0", key, _LENGTH),
            self.vector(origin, "rpy", "0 0 0", key, _ANGLE),
            axis,
            lower,
            upper,
            velocity,
            effort,
        )

    def axis(self, element: ET.Element | None, key: str) -> Vector:
        x, y, z = axis = self.vector(element, "xyz", "1 0 0", key, _ANY)
        length = math.hypot(*axis)
        if length < bounds.ALIKE or length > 1 / bounds.ALIKE:
            self.note(key, f"axis {shown(axis)}", "expected a direction")
            return (0.0, 0.0, 1.0)
        return (x / length, y / length, z / length)

    def limits(self, limit: ET.Element | None, kind: str, key: str) -> tuple[float, float, float, float]:
        """Lower, upper, velocity, effort."""
        if kind in ("continuous", "fixed"):
            return -math.inf, math.inf, 0.0, 0.0
        if limit is None:
            self.note(key, "", "needs a limit")
            return 0.0, 0.0, 0.0, 0.0
        turns = kind == "revolute"
        speed, force = ("rad/s", "Nm") if turns else ("m/s", "N")
        most = _ANGLE if turns else _LENGTH
        lower, upper = (self.limit(limit, side, "0", key, most) for side in ("lower", "upper"))
        velocity = self.limit(limit, "velocity", None, key, _Most(bounds.MAX_SPEED, speed, ""))
        effort = self.limit(limit, "effort", None, key, _Most(bounds.MAX_EFFORT, force, ""))
        if not lower < upper:
            self.note(key, f"{lower:g}..{upper:g}", "expected lower below upper")
        if velocity <= 0 or effort <= 0:
            self.note(key, f"velocity {velocity:g}, effort {effort:g}", "expected positive limits")
        return lower, upper, velocity, effort

    def limit(self, element: ET.Element, attribute: str, default: str | None, key: str, most: _Most) -> float:
        """A number that is noted where it is too large, but not taken for one that cannot be read."""
        value = self.numbers(element, attribute, 1, default, key)[0]
        if abs(value) > most.value:
            text = f'{attribute}="{element.get(attribute)}"'
            self.note(key, text, f"expected at most {most.value:g} {most.unit}{most.hint}")
        return value


def shown(vector: Sequence[float]) -> str:
    """As a URDF writes it, and -0 as 0."""
    return " ".join(f"{v + 0.0:g}" for v in vector)


def rotation(rpy_rad: Vector) -> NDArray[np.float64]:
    """Rz Ry Rx."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy_rad), np.sin(rpy_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def roll_pitch_yaw(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) of a rotation (3, 3), Rz Ry Rx; roll 0 where x points straight up or down."""
    level = math.hypot(turn[2, 1], turn[2, 2])
    pitch = math.atan2(-turn[2, 0], level)
    if level < bounds.ALIKE:
        return np.array([0.0, pitch, math.atan2(-turn[0, 1], turn[1, 1])])
    return np.array([math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])])


def about(axis: NDArray[np.float64], angle_rad: float) -> NDArray[np.float64]:
    """(3, 3) the rotation about a unit vector (3,)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle_rad) * skew + (1.0 - math.cos(angle_rad)) * skew @ skew)


def parse_xml(data: bytes, path: str) -> ET.Element:
    """The <robot> of a URDF. Raises UrdfError where the bytes are no such XML."""
    reader = _Reader(path)
    if len(data) > MAX_BYTES:
        raise reader.fail("", f"{len(data)} bytes", f"expected at most {MAX_BYTES} bytes")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise reader.fail("", "", "document types and entities are not allowed")
    try:
        root = ET.fromstring(data)
    except ET.ParseError as error:
        raise reader.fail("", "", f"is not XML: {error}") from None
    if root.tag != "robot":
        raise reader.fail("", f"<{root.tag}>", "expected a <robot>")
    return root


def parse_urdf(root: ET.Element, path: str) -> Urdf:
    """Reads a URDF's <robot>. Raises UrdfError with all that is wrong: link or joint, value and what would be right."""
    urdf, problems = read_urdf(root, path)
    if problems or urdf is None:
        raise UrdfError(path, problems)
    return urdf


def read_urdf(root: ET.Element, path: str) -> tuple[Urdf | None, list[Problem]]:
    """A URDF's <robot> and all that is wrong with it; None where parts of it could not be read at all."""
    reader = _Reader(path)
    elements = root.findall("link"), root.findall("joint")
    links, joints = reader.each(elements[0], reader.link), reader.each(elements[1], reader.joint)
    whole = (len(links), len(joints)) == (len(elements[0]), len(elements[1]))
    before = len(reader.problems)
    for kind, names in (("link", [link.name for link in links]), ("joint", [joint.name for joint in joints])):
        seen: set[str] = set()
        for name in names:
            if name in seen:
                reader.note(f"{kind} {name}", "", "expected once")
            seen.add(name)
    known = {element.get("name") for element in elements[0]}
    for joint in joints:
        for link_name in (joint.parent, joint.child):
            if link_name not in known:
                reader.note(f"joint {joint.name}", link_name, "no such link")
    named = reader.each([root], lambda element: reader.name(element, "name", "robot"))
    if not whole or len(reader.problems) > before:
        return None, reader.problems
    return Urdf(named[0], {k.name: k for k in links}, {j.name: j for j in joints}), reader.problems
