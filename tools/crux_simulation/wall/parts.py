"""A wall of several planes: the frame in which the bodies of each are looked at, and the planes as bounded surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from crux_contracts.scenario_bodies import MAX_TURN_DEG
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from crux_simulation.wall.frame import CLIMBED, Frame
from crux_simulation.wall.planes import LINK_M, ON_M, Indices, Plane, Planes, lies_in
from crux_simulation.wall.surface import PLANE_COS, Array, Samples, Surface

WALL = "wall"  # the name of the plane that is climbed
DEPTH_M, LEAST_DEPTH_M = 0.05, 0.005  # of the solid behind a plane, less where it is thinner
INSIDE_M = 1e-3  # rays that look for the back begin so far within
RAYS, THIN = 200, 0.05  # of a plane, and the share of them that may be shorter than its depth
STRIP_M = 0.03  # of what lies behind a plane: steps stand for its slope
ROUNDED_DEG = 0.005  # by which rounding may take a plane from beyond the limit


@dataclass(frozen=True, eq=False)
class Part:
    """Bodies that are looked at in one frame: `body` has their numbers by sample, -1 for all else. `reason` says why
    none of them can be a hold, and is empty where they can.
    """

    frame: Frame
    body: Indices
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Bounded:
    """A plane as a rectangle about what is seen of it: its middle is the frame's origin."""

    name: str
    frame: Frame
    size_m: Array
    depth_m: float


def parts(samples: Samples, on: Planes, of: Indices) -> list[Part]:
    """By plane the bodies on it, that which is climbed first; then those that lie across two planes, one by one, in the
    frame between these. `of` is the body of each sample.
    """
    groups = _across(samples, on, of)
    alone = np.where(np.isin(of, [body for group in groups for body in group]), -1, of)
    found = []
    for number, plane in enumerate(on.planes):
        body = np.where(on.of == number, alone, -1)
        frame = _frame(plane) if number else CLIMBED
        words = f"is on another plane, {plane.words()}: holds are turned by at most {MAX_TURN_DEG:g}°"
        if number == 0 or (body >= 0).any():
            found.append(Part(frame, body, "" if _can_turn(frame) else words))
    for group in groups:
        mine = np.isin(of, group)
        body, numbers = np.where(mine, group[0], -1), np.unique(on.of[mine])
        lowest, *others = (on.planes[each] for each in numbers)
        between = _between(lowest, others[0], samples.points[mine]) if len(others) == 1 else None
        if between is not None and _can_turn(between):
            found.append(Part(between, body))
        else:
            found.append(Part(_frame(lowest), body, f"lies across {len(numbers)} planes"))
    return found


def _frame(plane: Plane) -> Frame:
    return Frame.on(plane.normal, plane.offset_m * plane.normal)


def _across(samples: Samples, on: Planes, of: Indices) -> list[list[int]]:
    """The numbers of bodies on different planes that touch one another."""
    count = of.max(initial=-1) + 1
    outside = np.flatnonzero((of >= 0) & (on.of > 0))
    links = {
        (int(of[i]), int(of[other]))
        for i, around in zip(outside, samples.tree.query_ball_point(samples.points[outside], LINK_M), strict=True)
        for other in around
        if of[other] >= 0 and on.of[other] != on.of[i]
    }
    if not links:
        return []
    one, other = zip(*links, strict=True)
    number = connected_components(csr_matrix((np.ones(len(links)), (one, other)), (count, count)), directed=False)[1]
    groups = [np.flatnonzero(number == each).tolist() for each in np.unique(number[list(one)])]
    return sorted(groups)


def _can_turn(frame: Frame) -> bool:
    return bool(np.degrees(np.arccos(np.clip(frame.rotation[2, 2], -1.0, 1.0))) <= MAX_TURN_DEG + ROUNDED_DEG)


def _between(a: Plane, b: Plane, points: Array) -> Frame | None:
    """The frame of a body across the edge of two planes: z is halfway between their normals; None without an edge."""
    edge = np.cross(a.normal, b.normal)
    if np.linalg.norm(edge) < np.sqrt(1.0 - PLANE_COS**2):
        return None
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    origin = np.linalg.solve(np.stack([a.normal, b.normal, edge]), [a.offset_m, b.offset_m, edge @ middle])
    normal = a.normal + b.normal
    return Frame.on(normal / np.linalg.norm(normal), origin)


def bounded(surface: Surface, on: Planes, of: Indices) -> list[Bounded]:
    """The planes on which bodies stand or that stand out of that which is climbed, bounded; the latter first where it
    ends, too, as others go behind it. None where there is one plane.
    """
    found = []
    for number, plane in enumerate(on.planes):
        mine = on.of == number
        seen = surface.samples.points[mine & lies_in(surface.samples, plane)]
        if number == 0 or (mine & (of >= 0)).any() or (seen[:, 2] > ON_M).any():
            found.append(_bounded(WALL if number == 0 else f"plane-{number + 1}", surface, plane, seen))
    others = found[1:]
    return found if any(_lowest_m(each) < -ON_M for each in others) else others


def _lowest_m(plane: Bounded) -> float:
    corners = np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)]) * [*plane.size_m, 0.0]
    return float(plane.frame.in_w(corners)[:, 2].min())


def _bounded(name: str, surface: Surface, plane: Plane, points: Array) -> Bounded:
    """The smallest rectangle about points, its x as near to that of the plane's frame as it goes."""
    whole = _frame(plane)
    flat = whole.seen(points)[:, :2]
    towards = np.linalg.inv(trimesh.bounds.oriented_bounds_2D(flat)[0])[:2, 0]
    turn = np.arctan2(towards[1], towards[0])
    turn -= np.round(turn / (np.pi / 2.0)) * np.pi / 2.0
    c, s = np.cos(turn), np.sin(turn)
    own = np.array([[c, s], [-s, c]])
    low, high = (flat @ own.T).min(axis=0), (flat @ own.T).max(axis=0)
    middle = np.append((low + high) / 2.0 @ own, 0.0)
    rotation = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ whole.rotation
    few = points[:: 1 + len(points) // RAYS]
    behind = surface.cast(few - INSIDE_M * plane.normal, np.repeat(-plane.normal[None], len(few), axis=0))[0]
    depth = max(min(DEPTH_M, float(np.quantile(behind, THIN, method="lower")) + INSIDE_M), LEAST_DEPTH_M)
    return Bounded(name, Frame(rotation, whole.in_w(middle)), high - low, depth)


def behind(samples: Samples, on: Planes, of: Indices) -> list[tuple[str, Array, str]]:
    """Name, points and reason of what lies behind the other planes and stands out of that which is climbed, as the
    sides of a large volume, in strips.
    """
    points, found = samples.points, []
    for number, plane in enumerate(on.planes[1:], start=1):
        mine = points[(points[:, 2] > ON_M) & (on.of == number) & (of < 0) & (on.height_m < -ON_M)]
        size = float(np.hypot(*plane.normal[:2]))
        along = mine[:, :2] @ plane.normal[:2] / size if size > 0.0 else np.zeros(len(mine))
        strip = np.floor((along - along.min(initial=np.inf)) / STRIP_M)
        reason = f"is behind another plane, {plane.words()}"
        found += [(f"plane-{number + 1}-{int(k) + 1}", mine[strip == k], reason) for k in np.unique(strip)]
    return found
