"""The part of URDF that crux reads: links with inertia and simple shapes, joints with origin, axis and limits."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from .yaml_document import DocumentError, Problem

Vector = tuple[float, float, float]
MAX_BYTES = 4_000_000
SHAPES = {"box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": {"radius": 1, "length": 1}}
SHAPES["capsule"] = SHAPES["cylinder"]


class UrdfError(DocumentError):
    """A robot description that cannot be used."""


@dataclass(frozen=True)
class Link:
    """Inertia about the centre of mass, in axes parallel to the link's frame: xx, xy, xz, yy, yz, zz."""

    name: str
    mass_kg: float
    com_m: Vector
    inertia_kg_m2: tuple[float, float, float, float, float, float]


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
    def __init__(self, path: str) -> None:
        self.path = path

    def fail(self, key: str, value: str, expected: str) -> UrdfError:
        return UrdfError(self.path, [Problem(key, value, expected)])

    def numbers(
        self, element: ET.Element | None, attribute: str, count: int, default: str | None, key: str
    ) -> list[float]:
        text = default if element is None else element.get(attribute, default)
        if text is None:
            raise self.fail(key, "", f"needs the attribute {attribute}")
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if len(values) != count or not all(math.isfinite(v) for v in values):
            raise self.fail(key, f'{attribute}="{text}"', f"expected {count} finite numbers")
        return values

    def vector(self, element: ET.Element | None, attribute: str, default: str, key: str) -> Vector:
        x, y, z = self.numbers(element, attribute, 3, default, key)
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
        mass = self.numbers(inertial.find("mass"), "value", 1, None, key)[0]
        if mass < 0:
            raise self.fail(key, f"{mass:g}", "expected a mass of 0 kg or more")
        tensor = inertial.find("inertia")
        xx, xy, xz, yy, yz, zz = (
            self.numbers(tensor, axis, 1, "0", key)[0] for axis in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        return Link(name, mass, self.vector(inertial.find("origin"), "xyz", "0 0 0", key), (xx, xy, xz, yy, yz, zz))

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
                raise self.fail(key, found, cure)
            for attribute, count in sizes.items():
                values = self.numbers(solid, attribute, count, None, key)
                if min(values) <= 0:
                    raise self.fail(key, f'{attribute}="{solid.get(attribute)}"', "expected lengths above 0")

    def joint(self, element: ET.Element) -> Joint:
        name = self.name(element, "name", "joint")
        key = f"joint {name}"
        kind = self.name(element, "type", key)
        if kind not in ("revolute", "prismatic", "continuous", "fixed"):
            raise self.fail(key, kind, "expected revolute, prismatic, continuous or fixed")
        limit = element.find("limit")
        bounded = kind in ("revolute", "prismatic")
        if bounded and limit is None:
            raise self.fail(key, "", "needs a limit")
        lower, upper = (
            self.numbers(limit, side, 1, "0" if bounded else default, key)[0]
            for side, default in (("lower", "-1e9"), ("upper", "1e9"))
        )
        velocity, effort = (
            self.numbers(limit, what, 1, None if bounded else "0", key)[0] for what in ("velocity", "effort")
        )
        if bounded and not lower < upper:
            raise self.fail(key, f"{lower:g}..{upper:g}", "expected lower below upper")
        if bounded and (velocity <= 0 or effort <= 0):
            raise self.fail(key, f"velocity {velocity:g}, effort {effort:g}", "expected positive limits")
        axis = self.vector(element.find("axis"), "xyz", "1 0 0", key)
        length = math.hypot(*axis)
        if length == 0:
            raise self.fail(key, "axis 0 0 0", "expected a direction")
        origin = element.find("origin")
        return Joint(
            name,
            kind,
            self.name(element.find("parent"), "link", key),
            self.name(element.find("child"), "link", key),
            self.vector(origin, "xyz", "0 0 0", key),
            self.vector(origin, "rpy", "0 0 0", key),
            (axis[0] / length, axis[1] / length, axis[2] / length),
            lower,
            upper,
            velocity,
            effort,
        )


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
    """Reads a URDF's <robot>. Raises UrdfError naming link or joint, value and what would be right."""
    reader = _Reader(path)
    links = [reader.link(element) for element in root.findall("link")]
    joints = [reader.joint(element) for element in root.findall("joint")]
    for kind, names in (("link", [link.name for link in links]), ("joint", [joint.name for joint in joints])):
        for name in {n for n in names if names.count(n) > 1}:
            raise reader.fail(f"{kind} {name}", "", "expected once")
    known = {link.name for link in links}
    for joint in joints:
        for link_name in (joint.parent, joint.child):
            if link_name not in known:
                raise reader.fail(f"joint {joint.name}", link_name, "no such link")
    return Urdf(reader.name(root, "name", "robot"), {k.name: k for k in links}, {j.name: j for j in joints})
