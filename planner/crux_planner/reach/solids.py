"""Shapes of trunk and links, from the robot's URDF: the trunk as boxes, the links of a limb as capsules.

A cylinder counts as the capsule whose ends touch its faces, as in the check: only the rims are missing. Of other shapes
there are two versions: `around` has all of the shape, for what must keep off; `inside` is all in the shape, for proofs.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Limb, Robot
from crux_contracts.urdf import link_shapes

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z

UPPER, FOREARM, ROLLED, TILTED, HAND, SHOULDER, SIXTH = range(7)
"""Frames of capsules: links 2, 3, 4 and 5 as in the URDF; the gripper's, for all behind the last joint; link 1; and
link 6 of a limb of seven joints."""

LINK_OF = {SHOULDER: 0, UPPER: 1, FOREARM: 2, ROLLED: 3, TILTED: 4, SIXTH: 5}
"""Numbers of the links in whose frames capsules are."""


@dataclass(frozen=True)
class Capsule:
    """A ball swept along a segment, in one of the frames above."""

    frame: int
    start_m: Array
    end_m: Array
    radius_m: float


@dataclass(frozen=True)
class Box:
    """A cuboid of the trunk in the body frame."""

    centre_m: Array
    rotation: Array
    half_m: Array


@dataclass(frozen=True)
class Solids:
    """The trunk, and a limb's links that may meet it; the first, which turns on it, may meet other limbs alone."""

    trunk: tuple[Box, ...]
    links: tuple[Capsule, ...]
    first: tuple[Capsule, ...] = ()


NOTHING = Solids((), ())


def solids(robot: Robot, limb: Limb, *, around: bool) -> Solids:
    """Of a robot and one of its limbs, `around` the shapes or inside them; around them fingers are as wide open as they
    go, and inside them what a half turn of the gripper moves
    is left out.
    """
    links = {str(link.get("name")): link for link in ET.parse(robot.urdf_path).getroot().iter("link")}
    trunk = tuple(_box(shape, around) for shape in link_shapes(links[robot.body_link]))
    capsules: list[Capsule] = []
    for frame, joint in zip((SHOULDER, UPPER, FOREARM, ROLLED, TILTED, SIXTH), limb.joints[:-1], strict=False):
        shapes = link_shapes(links[joint.child])
        capsules += [_capsule(shape, frame, around, np.eye(3), np.zeros(3)) for shape in shapes]
    back, down = rotation_z(-limb.gripper_mount_rad), np.array([0.0, 0.0, limb.wrist_to_gripper_m])
    if not limb.closed_form:
        zero, last = limb.at_zero, len(limb.joints) - 1
        to_gripper = zero.gripper_rotation.T
        back, down = to_gripper @ zero.rotations[last], to_gripper @ (zero.points_m[last] - zero.gripper_m)
    hand = [(limb.joints[-1].child, back, down), (limb.gripper_link, np.eye(3), np.zeros(3))]
    for name in limb.finger_joints:
        slide = robot.urdf.joints[name]
        turn = rotation_from_rpy(np.array(slide.rpy_rad))
        hand.append((slide.child, turn, np.array(slide.xyz_m) + turn @ np.array(slide.axis) * slide.upper))
    for link, turn, place in hand:
        held = [_capsule(shape, HAND, around, turn, place) for shape in link_shapes(links[link])]
        capsules += [each for each in held if around or not np.any([each.start_m[:2], each.end_m[:2]])]
    first = tuple(capsule for capsule in capsules if capsule.frame == SHOULDER)
    return Solids(trunk, tuple(capsules[len(first) :]), first)


def radii_and_hands(capsules: Sequence[Capsule]) -> tuple[Array, Flags]:
    """(P,) of each."""
    return np.array([each.radius_m for each in capsules]), np.array([each.frame == HAND for each in capsules])


@dataclass(frozen=True)
class Links:
    """The links of a limb at n poses as P capsules in the body frame: ends (n, P, 3), (n, P, 3) and radii (P,) [m];
    and which (P,) are the gripper's.
    """

    start_m: Array
    end_m: Array
    radius_m: Array
    hand: Flags

    def where(self, index: Indices) -> Links:
        """At some of the poses."""
        return Links(self.start_m[index], self.end_m[index], self.radius_m, self.hand)


def gap_m(trunk: tuple[Box, ...], start_m: Array, end_m: Array) -> Array:
    """Distance (n,) from segments, start (n, 3) to end (n, 3) in the body frame, to the trunk; 0 where they meet."""
    found = np.full(len(start_m), np.inf)
    for box in trunk:
        start, end = (start_m - box.centre_m) @ box.rotation, (end_m - box.centre_m) @ box.rotation
        np.minimum(found, _to_box(start, end, box.half_m), out=found)
    return found


def off_trunk(shapes: Solids, links: Links, clear_m: float) -> Flags:
    """(n,) whether all links of a limb that may meet the trunk keep off it."""
    clear = np.ones(len(links.start_m), dtype=bool)
    for index in range(len(shapes.links)):
        start, end = links.start_m[:, index], links.end_m[:, index]
        need = np.full(len(start), links.radius_m[index] + clear_m)
        for box in shapes.trunk:
            some = np.flatnonzero(clear & ~apart(box, start, end, need))
            clear[some] = gap_m((box,), start[some], end[some]) >= need[some]
    return clear


def apart(box: Box, start_m: Array, end_m: Array, by_m: Array) -> Flags:
    """(n,) where one face of the box alone shows that segments are `by_m` (n,) off it: quick, and mostly enough."""
    start, end = (start_m - box.centre_m) @ box.rotation, (end_m - box.centre_m) @ box.rotation
    beyond = np.maximum(np.minimum(start, end), -np.maximum(start, end)) - box.half_m
    return np.asarray(beyond.max(axis=1) >= by_m)


def _to_box(start: Array, end: Array, half: Array) -> Array:
    """Distance (n,) of segments to the box |x| <= half. Along a segment the square of a point's distance is convex and
    its slope linear between the places where the segment crosses the planes of the faces.
    """
    way = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = np.concatenate([(-half - start) / way, (half - start) / way], axis=1)
    places = np.clip(np.nan_to_num(crossings, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    places = np.sort(np.concatenate([places, np.zeros((len(start), 1)), np.ones((len(start), 1))], axis=1), axis=1)
    point = start[:, None] + places[..., None] * way[:, None]
    slope = ((point - np.clip(point, -half, half)) * way[:, None]).sum(axis=2)  # grows along the segment
    last = np.maximum((slope <= 0.0).sum(axis=1) - 1, 0)
    after = np.minimum(last + 1, places.shape[1] - 1)
    rows = np.arange(len(start))
    falls, climbs = slope[rows, last], slope[rows, after]
    share = np.where((falls < 0.0) & (climbs > falls), -falls / np.where(climbs > falls, climbs - falls, 1.0), 0.0)
    share = np.minimum(share, 1.0)
    best = places[rows, last] + share * (places[rows, after] - places[rows, last])
    nearest = start + best[:, None] * way
    return np.asarray(np.linalg.norm(nearest - np.clip(nearest, -half, half), axis=1))


def _capsule(shape: ET.Element, frame: int, around: bool, turn: Array, place: Array) -> Capsule:
    """Of a shape in a frame that is turned and placed so in the capsule's."""
    centre, rotation = _origin(shape)
    centre, rotation = place + turn @ centre, turn @ rotation
    kind, sizes = _sizes(shape)
    if kind == "box":
        half = sizes / 2
        axis, others = int(np.argmax(half)), np.delete(half, int(np.argmax(half)))
        radius = float(np.linalg.norm(others) if around else others.min())
        along = float(half[axis] if around else half[axis] - radius)
        way = rotation[:, axis] * along
    else:
        radius = float(sizes[0])
        length = 0.0 if kind == "sphere" else float(sizes[1])
        way = rotation[:, 2] * max(length / 2 - (radius if kind == "cylinder" else 0.0), 0.0)
    return Capsule(frame, centre - way, centre + way, radius)


def _box(shape: ET.Element, around: bool) -> Box:
    """Of a shape of the trunk."""
    centre, rotation = _origin(shape)
    kind, sizes = _sizes(shape)
    if kind == "box":
        return Box(centre, rotation, sizes / 2)
    radius, round_axes = float(sizes[0]), 3 if kind == "sphere" else 2
    half = np.full(3, radius if around else radius / round_axes**0.5)
    if kind != "sphere":
        half[2] = sizes[1] / 2 + (radius if around and kind == "capsule" else 0.0)
    return Box(centre, rotation, half)


def _origin(shape: ET.Element) -> tuple[Array, Array]:
    """Place (3,) and rotation (3, 3) of a shape in its link."""
    origin = shape.find("origin")
    xyz, rpy = ("0 0 0" if origin is None else origin.get(key, "0 0 0") for key in ("xyz", "rpy"))
    return np.array(xyz.split(), dtype=float), rotation_from_rpy(np.array(rpy.split(), dtype=float))


def _sizes(shape: ET.Element) -> tuple[str, Array]:
    """Kind of a shape, and a box's edges or a round one's radius and length. The description's reader knows it is one
    of these.
    """
    geometry = shape.find("geometry")
    assert geometry is not None
    solid = geometry[0]
    keys = ("size",) if solid.tag == "box" else ("radius", "length")
    return solid.tag, np.array(" ".join(solid.get(key, "") for key in keys).split(), dtype=float)
