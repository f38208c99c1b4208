"""Scenario files of version 2: gravity as a vector, surfaces, and holds with a pose and a shape.

What of it this crux can plan with becomes a Scenario as that of version 1; the rest is refused by name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from .reading import Checker
from .records import REQUIRED, Key, key, keys_of
from .scenario_types import (
    FACE_NAMES,
    MAX_CUBOIDS,
    MAX_FRICTION,
    MAX_GRAVITY_M_S2,
    MAX_LEAN_DEG,
    MAX_SURFACES,
    MOST_GRIPS,
    POSITION,
    SIZE_M,
    VERSIONS,
    Foothold,
    Grip,
    Hold,
    Obstacle,
    Scenario,
    Slab,
    Wall,
)
from .turned_boxes import axes_of
from .yaml_document import Node

SIDE_FACES = FACE_NAMES[:4]
LEAST_TOP_M = 0.005  # edges of a top that leaning faces leave
UPRIGHT_DEG = 1e-6
MAX_TURN_DEG = 90.0  # of a hold's top out of the wall's plane
ON_WALL_M = 1e-9
Place = tuple[float, float, float]
ON_SURFACE_M = 1e-3  # of footholds, whose places are rounded
MAX_EDGE_M = 100.0


@dataclass(frozen=True)
class Plane:
    """Endless."""

    point_m: tuple[float, float, float] = key(REQUIRED, *POSITION, "of it")
    normal: tuple[float, float, float] = key(REQUIRED, -1.0, 1.0, "", "off it, of length 1")


@dataclass(frozen=True)
class Pose:
    """Of the middle of a body's foot, or of a surface."""

    position_m: tuple[float, float, float] = key(REQUIRED, *POSITION, "x, y, z in W")
    rpy_deg: tuple[float, float, float] = key((0.0, 0.0, 0.0), -360.0, 360.0, "degrees", "roll, pitch and yaw")


@dataclass(frozen=True)
class Rectangle:
    """A surface with edges, and the solid behind it."""

    pose: Pose = key(REQUIRED, means="of its middle: its own z points off it")
    size_m: tuple[float, float] = key(REQUIRED, 0.05, MAX_EDGE_M, "m", "along its own x and y")
    depth_m: float = key(0.05, 0.005, MAX_EDGE_M, "m", "of the solid behind it")


@dataclass(frozen=True)
class Surface:
    """What all else keeps clear of: an endless plane, or a rectangle. Feet stand on the plane."""

    name: str = key(REQUIRED, means="any text, each name once")
    plane: Plane | None = key(None, means="that of W, z = 0; of one surface at most")
    rectangle: Rectangle | None = key(None, means="a surface with edges; of climbs")
    friction: float = key(0.6, 0.0, MAX_FRICTION, "", "of what touches it")


@dataclass(frozen=True)
class Shape:
    """A box whose sides may lean in."""

    box_m: tuple[float, float, float] = key(REQUIRED, *SIZE_M, "m", "of the foot along its own axes, and the height")
    lean_deg: dict[str, float] = key(
        dict, 0.0, MAX_LEAN_DEG, "degrees", "by which a side leans in from the upright", words=SIDE_FACES
    )


@dataclass(frozen=True)
class Box:
    """A cuboid to be kept clear of."""

    name: str = key(REQUIRED, means="any text, each name once")
    pose: Pose = key(REQUIRED, means="of the middle of its foot")
    shape: Shape = key(REQUIRED, means="of the body")


@dataclass(frozen=True)
class BoxHold(Box):
    """A body over which grippers close."""

    friction: tuple[float, ...] = key((), 0.0, MAX_FRICTION, "", "one, or by face", required=True, reader="friction")
    spines: tuple[bool, ...] = key((True,) * 5, means="whether spines grip, of all or by face", reader="spines")
    grips: tuple[Grip, ...] = key((), most=MOST_GRIPS, means="the only places for grippers (any place)")


@dataclass(frozen=True)
class Bodies:
    """What a file of version 2 has in place of version 1's wall, holds and obstacles."""

    gravity_m_s2: tuple[float, float, float] = key(REQUIRED, -MAX_GRAVITY_M_S2, MAX_GRAVITY_M_S2, "m/s^2", "in W")
    surfaces: tuple[Surface, ...] = key(REQUIRED, most=MAX_SURFACES, means="planes and rectangles")
    holds: tuple[BoxHold, ...] = key((), most=MAX_CUBOIDS, means="bodies over which grippers close")
    obstacles: tuple[Box, ...] = key((), most=MAX_CUBOIDS, means="bodies that nothing may touch; holds are, too")
    footholds: tuple[Foothold, ...] = key((), most=MAX_CUBOIDS, means="places on surfaces where limbs may stand")


REPLACED = ("wall", "holds", "obstacles")


def keys_of_version(version: int) -> dict[str, Key]:
    """The keys of a scenario file of a version, `version` itself left out."""
    keys = keys_of(Scenario)
    if version == VERSIONS[0]:
        return keys
    return {name: each for name, each in keys.items() if name not in REPLACED} | keys_of(Bodies)


def as_first(read: dict[str, Any], members: Mapping[str, Node], check: Checker) -> dict[str, Any]:
    """What a file of version 2 holds, `read` of its `members`, as a Scenario has it; what it cannot have is noted."""
    bodies = {name: read.pop(name, ()) for name in keys_of(Bodies)}
    gravity = bodies["gravity_m_s2"] or (0.0, 0.0, 0.0)
    if "gravity_m_s2" in members and not any(gravity):
        check.note(members["gravity_m_s2"], "expected a vector that is not 0")
    surfaces = bodies["surfaces"]
    if "surfaces" in members and not surfaces and not check.problems:
        check.note(members["surfaces"], "expected at least one")
    nodes = _items(members.get("surfaces"))
    for index, (node, surface) in enumerate(zip(nodes, surfaces, strict=False)):
        _is_surface(node, surface, surfaces[:index], read.get("contact"), check)
    endless = any(surface.plane is not None for surface in surfaces)
    for name in ("holds", "obstacles"):
        for node, body in zip(_items(members.get(name)), bodies[name], strict=False):
            _can_be(node, body, endless, check)
    nodes = _items(members.get("footholds"))
    if bodies["footholds"] and getattr(read.get("contact"), "model", "patch") == "point":
        check.note(members["footholds"], "does not go with contact.model point: feet stand anywhere on the plane z = 0")
    pairs = [each for each in zip(nodes, bodies["footholds"], strict=False) if each[1].position_m is not None]
    stood_on = [_on_surface(node, foothold, surfaces, check) for node, foothold in pairs]
    slope = math.degrees(math.atan2(math.hypot(*gravity[:2]), -gravity[2]))
    friction = next((each.friction for each in surfaces if each.plane is not None), 0.0)
    slabs = tuple(_slab(each) for each in surfaces if each.rectangle is not None) if not check.problems else ()
    return read | {
        "wall": Wall(slope, friction, gravity, slabs, endless),
        "holds": tuple(_hold(body) for body in bodies["holds"]) if not check.problems else (),
        "obstacles": tuple(Obstacle(**_cuboid(body)) for body in bodies["obstacles"]) if not check.problems else (),
        "footholds": tuple(stood_on) if not check.problems else (),
    }


def _on_surface(node: Node, foothold: Foothold, surfaces: tuple[Surface, ...], check: Checker) -> Foothold:
    """The foothold on the nearest surface, as that has it."""
    found = [(_off_surface(foothold.position_m, each), each) for each in surfaces if _is_whole(each)]
    (place, nearest), best = min(found, key=lambda each: each[0][1], default=((foothold.position_m, math.inf), None))
    if best is None or nearest > ON_SURFACE_M:
        where = "" if best is None else f"; {best.name} is {1e3 * nearest:.3g} mm away"
        shown = ", ".join(f"{each:g}" for each in foothold.position_m)
        check.note_at(node, "position_m", f"[{shown}]", f"is on no surface; expected one within 1 mm{where}")
        return foothold
    bounded, turned = "", (0.0, 0.0, 0.0)
    if best.rectangle is not None:
        bounded, turned = best.name, best.rectangle.pose.rpy_deg
    return replace(foothold, position_m=place, friction=best.friction, rpy_deg=turned, surface=bounded)


def _is_whole(surface: Surface) -> bool:
    """Whether nothing that was noted as missing keeps it from being somewhere."""
    rectangle = surface.rectangle
    return surface.plane is not None or (
        rectangle is not None
        and rectangle.pose is not None
        and rectangle.size_m is not None
        and rectangle.pose.position_m is not None
    )


def _off_surface(place_m: Place, surface: Surface) -> tuple[Place, float]:
    """The nearest place of the surface's own plane, and how far off the surface a place is."""
    if surface.rectangle is None:
        return (place_m[0], place_m[1], 0.0), abs(place_m[2])
    pose, size = surface.rectangle.pose, surface.rectangle.size_m
    away = [a - b for a, b in zip(place_m, pose.position_m, strict=True)]
    roll, pitch, yaw = map(math.radians, pose.rpy_deg)
    axes = axes_of((roll, pitch, yaw))
    x, y, z = (sum(a * b for a, b in zip(away, axis, strict=True)) for axis in axes)
    onto = tuple(a - z * b for a, b in zip(place_m, axes[2], strict=True))
    beyond = (max(abs(x) - size[0] / 2, 0.0), max(abs(y) - size[1] / 2, 0.0), z)
    return (onto[0], onto[1], onto[2]), math.hypot(*beyond)


def _items(node: Node | None) -> list[Node]:
    return node.content if node is not None and isinstance(node.content, list) else []


def _is_surface(node: Node, surface: Surface, before: tuple[Surface, ...], contact: Any, check: Checker) -> None:
    """A plane, the z = 0 of W, of one surface at most; or a rectangle, which only climbs may have."""
    plane, rectangle = surface.plane, surface.rectangle
    if surface.name in {each.name for each in before}:
        check.note_at(node, "name", surface.name, "expected a name of its own: another surface has it too")
    if (plane is None) == (rectangle is None):
        check.note(node, "expected either plane or rectangle")
    if rectangle is not None and contact is not None and contact.model == "point":
        check.note_at(node, "rectangle", "", "does not go with contact.model point: feet stand on the plane z = 0 of W")
    if plane is None or plane.normal is None or plane.point_m is None:
        return
    if any(each.plane is not None for each in before):
        check.note_at(node, "plane", "", "another surface is the plane z = 0 of W: expected a rectangle")
    if math.dist(plane.normal, (0.0, 0.0, 1.0)) > ON_WALL_M:
        shown = [round(each, 4) for each in plane.normal]
        check.note_at(node, "plane.normal", f"{shown}", "expected [0, 0, 1], z of W off the wall, or a rectangle")
    if abs(plane.point_m[2]) > ON_WALL_M:
        check.note_at(node, "plane.point_m", f"z {plane.point_m[2]:g}", "expected z 0, or a rectangle")


def _can_be(node: Node, body: Box, endless: bool, check: Checker) -> None:
    """Bodies reach off an endless wall; turned ones are boxes; leaning sides leave a top."""
    if body.pose is None or body.shape is None or body.pose.position_m is None or body.shape.box_m is None:
        return
    x, y, height = body.shape.box_m
    roll, pitch, _ = body.pose.rpy_deg
    turned = max(abs(roll), abs(pitch)) > UPRIGHT_DEG or abs(body.pose.position_m[2]) > ON_WALL_M
    if turned and body.shape.lean_deg:
        why = f"is not supported yet: {body.name} is turned out of the wall's plane, or off it; expected none"
        check.note_at(node, "shape.lean_deg", "", why)
    off_deg = math.degrees(math.acos(math.cos(math.radians(roll)) * math.cos(math.radians(pitch))))
    if isinstance(body, BoxHold) and off_deg > MAX_TURN_DEG:
        why = f"is not supported yet: the top of {body.name} is turned by {off_deg:.0f} degrees out of the wall's plane"
        check.note_at(
            node, "pose.rpy_deg", f"roll {roll:g}, pitch {pitch:g}", f"{why}, expected at most {MAX_TURN_DEG:g}"
        )
    top = top_m(body.pose.position_m[2], body.shape.box_m, (math.radians(roll), math.radians(pitch)))
    if endless and top < LEAST_TOP_M:
        found = f"z {body.pose.position_m[2]:g}"
        why = f"{body.name} ends {1e3 * top:.1f} mm off the wall, expected at least {1e3 * LEAST_TOP_M:g} mm"
        check.note_at(node, "pose.position_m", found, why)
    if body.shape.lean_deg and not isinstance(body, BoxHold):
        check.note_at(node, "shape.lean_deg", "", "is for holds: an obstacle is a box")
    grips = body.grips if isinstance(body, BoxHold) else ()
    for faces in "xy":
        if len({(grip.share, grip.friction) for grip in grips if grip.faces == faces}) > 1:
            why = f"those of {body.name} on faces {faces} differ in share or friction; expected the same"
            check.note_at(node, "grips", "", why)
        leaning = any(body.shape.lean_deg.get(f"{sign}{faces}", 0.0) for sign in "+-")
        if leaning and any(grip.tilt_deg for grip in grips if grip.faces == faces):
            why = f"{body.name} has a tilt_deg on faces {faces}, which lean; expected faces that do not"
            check.note_at(node, "grips", "", why)
    for axis, width in (("x", x), ("y", y)):
        leans = [body.shape.lean_deg.get(f"{sign}{axis}", 0.0) for sign in "+-"]
        left = width - height * sum(math.tan(math.radians(each)) for each in leans)
        if left < LEAST_TOP_M:
            why = (
                f"leaves {1e3 * left:.1f} mm along {axis} at the top of {body.name}, expected {1e3 * LEAST_TOP_M:g} mm"
            )
            check.note_at(node, "shape.lean_deg", "", why)


def top_m(foot_z_m: float, size_m: tuple[float, float, float], tilt_rad: tuple[float, float]) -> float:
    """How far off the wall a box reaches whose foot's middle is at z, turned by roll and pitch [rad]."""
    (sr, cr), (sp, cp) = ((math.sin(angle), math.cos(angle)) for angle in tilt_rad)
    across = (size_m[0] * abs(sp) + size_m[1] * abs(sr * cp)) / 2
    return foot_z_m + max(size_m[2] * cr * cp, 0.0) + across


def _cuboid(body: Box) -> dict[str, Any]:
    (x, y, z), (roll, pitch, yaw) = body.pose.position_m, body.pose.rpy_deg
    tilt = (roll, pitch) if max(abs(roll), abs(pitch)) > UPRIGHT_DEG else (0.0, 0.0)
    place = {"position_m": (x, y), "foot_z_m": z if abs(z) > ON_WALL_M else 0.0}
    return {"name": body.name, **place, "size_m": body.shape.box_m, "yaw_deg": yaw, "tilt_deg": tilt}


def _hold(body: BoxHold) -> Hold:
    lean_deg = tuple(body.shape.lean_deg.get(face, 0.0) for face in SIDE_FACES)
    friction = dict(zip(FACE_NAMES, body.friction, strict=True))
    for grip in body.grips:  # the only places for pads on these faces
        if grip.friction is not None:
            friction |= dict(zip((f"+{grip.faces}", f"-{grip.faces}"), grip.friction, strict=True))
    rough = tuple(friction.values())
    return Hold(**_cuboid(body), friction=rough, spines=body.spines, lean_deg=lean_deg, grips=body.grips)


def _slab(surface: Surface) -> Slab:
    rectangle = surface.rectangle
    assert rectangle is not None
    pose, depth = rectangle.pose, rectangle.depth_m
    up = axes_of((math.radians(pose.rpy_deg[0]), math.radians(pose.rpy_deg[1]), math.radians(pose.rpy_deg[2])))[2]
    foot = tuple(place - depth * each for place, each in zip(pose.position_m, up, strict=True))
    box = Box(surface.name, Pose((foot[0], foot[1], foot[2]), pose.rpy_deg), Shape((*rectangle.size_m, depth)))
    return Slab(**_cuboid(box), friction=surface.friction)
