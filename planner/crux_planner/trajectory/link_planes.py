"""Planes that keep links off the trunk and off other limbs, and trunk and links off solids, in the exact P1,
about a path of the body.

Links are capsules. A row says how far one end of a capsule is along a plane's normal, or how much farther one limb's
end is than another's. Where all ends are on their side, the capsules are apart, whatever the normal: it comes from the
places where they are nearest to each other on the path.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.cuboids import NO_CUBOIDS, Cuboids
from crux_planner.model.hands import rotations
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.reach import between, solids
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.protocol import Reach
from crux_planner.reach.solids import Links
from crux_planner.reach.trunk_clearance import boxes_of, links_off_slabs
from crux_planner.trajectory.box_planes import CORNERS, capsules_off, places, trunk_clear, trunk_off

OFF_M = 0.0045  # of links: half as much again as the check asks for
OFF_SURFACES_M = 0.01  # of links and trunk off solids, where the path has as much: bodies stray less from it
_NEAR_LIMB_M = 0.1  # links farther off need no plane
_SHARES = (0.2, 0.4, 0.6, 0.8, 0.9, 1.0)  # of the way from a path that are looked at
_LEAST_WAY_M = 1e-6  # capsules whose axes meet have no plane between them


@dataclass(frozen=True)
class Planes:
    """Of N knots, R rows each: normals (N, R, 3) in the ends' frame, numbers (N, R) of two ends, and how much farther
    (N, R) the first end is along the normal than the second at least, -inf where there is no row. The number after all
    ends' is that of the body's origin, or of H's.
    """

    normals: Array
    one: Indices
    other: Indices
    least: Array

    @property
    def packed(self) -> Array:
        """(N, 5 R) without `least`."""
        parts = self.normals.reshape(len(self.least), -1), self.one, self.other
        return np.concatenate(parts, axis=1).astype(float)


def unpacked(packed: Array) -> tuple[Array, Indices, Indices]:
    """Normals (N, R, 3) and numbers (N, R), twice."""
    rows = packed.shape[1] // 5
    one, other = packed[:, 3 * rows : 4 * rows], packed[:, 4 * rows :]
    return packed[:, : 3 * rows].reshape(len(packed), rows, 3), one.astype(int), other.astype(int)


class Ends:
    """Of all capsules of all limbs, numbered; a ball has one. Beside solids also the same ends in H, which
    are as many numbers on, and then the corners of the trunk in H.
    """

    def __init__(self, reaches: tuple[Reach, ...], slabs: Cuboids = NO_CUBOIDS) -> None:
        self.reaches, self.slabs = reaches, slabs
        self.of_limb: list[list[tuple[int, Array]]] = []
        """Frame of the capsule, and place in it."""
        self.numbers: list[list[list[int]]] = []
        """Of each capsule's ends, limb by limb."""
        self.count = 0
        for reach in reaches:
            mine: list[tuple[int, Array]] = []
            numbers = []
            for capsule in (*reach.keep_off.links, *reach.keep_off.first):
                ball = bool((capsule.start_m == capsule.end_m).all())
                ends = [capsule.start_m] if ball else [capsule.start_m, capsule.end_m]
                numbers.append(list(range(self.count + len(mine), self.count + len(mine) + len(ends))))
                mine += [(capsule.frame, end) for end in ends]
            self.of_limb.append(mine)
            self.numbers.append(numbers)
            self.count += len(mine)
        self.links = self.count  # ends in the body frame
        self.corners = np.zeros((0, 3))
        if len(slabs.yaw_rad):
            trunk = reaches[0].keep_off.trunk
            self.corners = np.vstack([box.centre_m + (CORNERS * box.half_m) @ box.rotation.T for box in trunk])
            self.count += self.links + len(self.corners)


def planes_about(ends: Ends, path: Array, hands: Array, apart_m: Array) -> Planes:
    """For body poses (N, 6), hands (N, 4, 4 or 6), and what links keep off each other and off the trunk
    (N,). What is asked for beyond `OFF_M` is so much more than the path has at most.
    """
    seen = _seen(path, hands)
    links = [reach.links(each) for reach, each in zip(ends.reaches, seen, strict=True)]
    rows: list[_Row] = []
    for limb in range(len(links)):
        rows += _off_trunk(ends, limb, links[limb], apart_m)
    for pair in combinations(range(len(links)), 2):
        rows += _off_each_other(ends, pair, links, apart_m)
    rows += _off_surfaces(ends, path, links, apart_m)
    if not rows:
        none = np.zeros((len(path), 0))
        return Planes(none[..., None].repeat(3, axis=2), none.astype(int), none.astype(int), none)
    normals, least = (np.stack([row[i] for row in rows], axis=1) for i in (0, 3))
    numbers = [np.array([row[i] for row in rows]) for i in (1, 2)]
    asked = np.isfinite(least)
    order = np.argsort(~asked, axis=1, kind="stable")[:, : int(asked.sum(axis=1).max())]  # those asked for come first
    normals = np.take_along_axis(normals, order[..., None], axis=1)
    return Planes(normals, numbers[0][order], numbers[1][order], np.take_along_axis(least, order, axis=1))


def farthest_clear(ends: Ends, path: Array, body: Array, hands: Array) -> Array:
    """Of body poses (N, 6) on the straight way from a path's to others, the last of some at which links keep `OFF_M`
    off the trunk and off each other, and both off solids, which they do on the path.
    """
    found, reaches, slabs = path.copy(), ends.reaches, ends.slabs
    for share in _SHARES:
        poses = path + share * (body - path)
        seen = _seen(poses, hands)
        links = [reach.links(each) for reach, each in zip(reaches, seen, strict=True)]
        clear = [between.apart(*pair, OFF_M, hands=False) for pair in combinations(links, 2)]
        clear += [solids.off_trunk(reach.keep_off, each, OFF_M) for reach, each in zip(reaches, links, strict=True)]
        if len(slabs.yaw_rad):
            clear.append(trunk_clear(reaches[0].keep_off.trunk, boxes_of(slabs), poses, OFF_M))
            clear += [links_off_slabs(poses, each, slabs, OFF_M) for each in links]
        every = np.logical_and.reduce(clear)
        found[every] = poses[every]
    return found


def _seen(path: Array, hands: Array) -> list[GripperPoses]:
    """The grippers as the body has them, limb by limb."""
    turn, hand = np.swapaxes(rotation_from_rpy(path[:, 3:6]), 1, 2), rotations(hands)
    places = [(turn @ (hands[:, limb, :3] - path[:, :3])[..., None])[..., 0] for limb in range(hands.shape[1])]
    yaws = hands[:, :, 3] - path[:, 5:6]
    return [GripperPoses.of(place, turn @ hand[:, limb], yaws[:, limb]) for limb, place in enumerate(places)]


_Row = tuple[Array, int, int, Array]
"""Normals (N, 3), the ends' numbers, and least (N,)."""


def _off_trunk(ends: Ends, limb: int, links: Links, apart_m: Array) -> list[_Row]:
    """Of the links that do not turn on the trunk."""
    reach = ends.reaches[limb]
    count = len(reach.keep_off.links)
    start, end, radius = links.start_m[:, :count], links.end_m[:, :count], links.radius_m[:count]
    normals, least = capsules_off(reach.keep_off.trunk, (start, end), radius, apart_m, OFF_M)
    numbers = ends.numbers[limb][:count]
    return [(normals[:, i], end, ends.count, least[:, i]) for i, each in enumerate(numbers) for end in each]


def _off_surfaces(ends: Ends, path: Array, links: list[Links], apart_m: Array) -> list[_Row]:
    """Of the links but the grippers', and of the trunk."""
    rows: list[_Row] = []
    apart_m = apart_m + OFF_SURFACES_M - OFF_M
    for slab in boxes_of(ends.slabs):
        for limb, own in enumerate(links):
            some = np.flatnonzero(~own.hand)
            both = places(path, own.start_m[:, some]), places(path, own.end_m[:, some])
            normals, least = capsules_off((slab,), both, own.radius_m[some], apart_m, OFF_SURFACES_M)
            for i, capsule in enumerate(some):
                rows += [
                    (normals[:, i], ends.links + end, ends.count, least[:, i]) for end in ends.numbers[limb][capsule]
                ]
        for number, box in enumerate(ends.reaches[0].keep_off.trunk):
            normal, wanted = trunk_off(box, slab, path, apart_m, OFF_SURFACES_M)
            first = 2 * ends.links + len(CORNERS) * number
            rows += [(normal, first + i, ends.count, wanted[:, i]) for i in range(len(CORNERS))]
    return rows


def _off_each_other(ends: Ends, pair: tuple[int, int], links: list[Links], apart_m: Array) -> list[_Row]:
    """Of the links of two limbs."""
    a, b = pair
    first, second = links[a], links[b]
    way = between.way_between(
        first.start_m[:, :, None], first.end_m[:, :, None], second.start_m[:, None], second.end_m[:, None]
    )
    off = np.linalg.norm(way, axis=-1)
    thick = first.radius_m[:, None] + second.radius_m
    near: Flags = (off > _LEAST_WAY_M) & (off - thick < _NEAR_LIMB_M)
    near &= ~np.logical_and.outer(first.hand, second.hand)  # no body pose changes how far these are from each other
    rows: list[_Row] = []
    for i, j in np.argwhere(near.any(axis=0)).tolist():
        normal = way[:, i, j] / np.maximum(off[:, i, j], _LEAST_WAY_M)[:, None]
        along = [
            ((one[:, i] - two[:, j]) * normal).sum(axis=1)
            for one, two in product((first.start_m, first.end_m), (second.start_m, second.end_m))
        ]
        least = np.where(
            near[:, i, j], np.minimum(thick[i, j] + apart_m, np.min(along, axis=0) + apart_m - OFF_M), -np.inf
        )
        rows += [(normal, one, two, least) for one, two in product(ends.numbers[a][i], ends.numbers[b][j])]
    return rows
