"""Where a two-finger gripper can take a wall, upright: pairs of patches that face away from each other.

A place must be within the gripper's opening, its patches flat where the pads press, and fingers and palm must have
space. Frame W: z off the wall. Every body on the wall tells the last thing that its candidates failed by.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario_types import LEAST_SHARE
from numpy.typing import NDArray

from crux_simulation.wall.planes import ON_M, Planes
from crux_simulation.wall.surface import SAMPLE_M, Array, Surface

Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

BODY_M = ON_M  # what stands farther off its plane belongs to a body
PROMINENCE_M = 0.008
LEAST_SAMPLES = 12  # of a body; fewer are specks
INSIDE_M = 5e-4  # rays that look through a body begin so far within it
LIFT_M = 0.008  # rays that look at a patch begin so far over it
FIRST_RINGS, LAST_RINGS, ROUNDS = 2, 4, 3  # of the discs by which a patch's plane is fitted, and at last judged
PAIR_M, PAIR_SHARE = 0.006, 0.12  # candidates nearer than this, and turned less, are one
GAP_M = 0.003  # of a finger's back and the palm to anything else

REASONS = (
    "no two faces of it look away from each other",
    "no two faces of it are opposite each other and lean less than the limit",
    "narrower than the gripper closes",
    "wider than the gripper opens",
    "its faces lean from the gripper's axis by more than the limit",
    "its faces lie across the wall: an upright gripper does not close over them",
    f"less than {LEAST_SHARE:g} of a pad bears: too rough, hollow, round or small where the pads press",
    "too low or too high for the gripper's pads",
    "the fingers would touch something beside it",
    "the palm would touch it or what is beside it",
    "",
)
(APART, OBLIQUE, NARROW, WIDE, LEANING, ACROSS, ROUGH, HEIGHT, BESIDE, PALM, TAKEN) = range(len(REASONS))


@dataclass(frozen=True)
class Limits:
    """What counts as a place for a pad."""

    tilt_deg: float = 15.0  # of a patch against the gripper's axis
    coverage: float = LEAST_SHARE  # of a pad that bears
    roughness_m: float = 0.002  # a part of the patch that is farther from its plane bears nothing
    turn_deg: float = 25.0  # of what bears, from the pad's middle to its rim: edges that are rounded are no faces


@dataclass(frozen=True, eq=False)
class Places:
    """Of m places: the middle (m, 3) [m], yaw of the axis in [0, pi), width [m], tilt of both patches (m, 2) [rad], how
    much of it leans off the wall, and aside, and share of the pads that bears (m, 2), of the patch at the axis's end
    first, and the body (m,).
    """

    middle: Array
    yaw_rad: Array
    width_m: Array
    tilt_rad: Array
    lean_rad: Array
    aside_rad: Array
    coverage: Array
    body: Indices

    def __len__(self) -> int:
        return len(self.width_m)

    @cached_property
    def merit(self) -> Array:
        """(m,) more is better: square, whole patches."""
        return np.asarray(self.coverage.min(axis=1) * np.cos(self.tilt_rad).prod(axis=1))

    def of(self, which: Flags | Indices) -> Places:
        return Places(**{name: each[which] for name, each in vars(self).items() if name != "merit"})


def bodies(surface: Surface, on: Planes) -> Indices:
    """By sample of the surface, the number of the body that it belongs to; -1 for the walls and for specks. Bodies on
    the plane that is climbed come first, those on others after them.

    From the highest sample down, each joins the body of a neighbour on its plane. Where two bodies meet, the lower one
    joins the higher, unless it rises by `PROMINENCE_M` over where they meet: holds that touch are bodies of their own.
    """
    samples, height = surface.samples, on.height_m
    order = np.flatnonzero(height > BODY_M)
    order = order[np.argsort(-height[order], kind="stable")]
    neighbours = samples.tree.query_ball_point(samples.points[order], 2.0 * SAMPLE_M)
    peak: dict[int, int] = {}  # by sample, one nearer to its body's highest

    def top(sample: int) -> int:
        while peak[sample] != sample:
            peak[sample] = sample = peak[peak[sample]]
        return sample

    for sample, around in zip(order.tolist(), neighbours, strict=True):
        mine = (other for other in around if other in peak and on.of[other] == on.of[sample])
        met = sorted({top(other) for other in mine}, key=lambda each: -height[each])
        peak[sample] = met[0] if met else sample
        for other in met[1:]:
            if height[other] - height[sample] < PROMINENCE_M:
                peak[other] = met[0]
    found = np.full(len(height), -1)
    found[order] = [top(sample) for sample in order.tolist()]
    tops, sizes = np.unique(found[order], return_counts=True)
    tops = tops[sizes >= LEAST_SAMPLES]
    number = np.full(len(height), -1)
    number[tops[np.argsort(on.of[tops], kind="stable")]] = np.arange(len(tops))
    return np.asarray(np.where(found >= 0, number[found], -1))


def find_places(surface: Surface, of: Indices, robot: Robot, limits: Limits) -> tuple[Places, Indices]:
    """The places, and by body which of `REASONS` its best candidate failed by; `of` is that of `bodies`."""
    reason = np.full(of.max(initial=-1) + 1, APART)
    candidates, body = _pairs(surface, of, robot, limits, reason)
    places = _fitted(surface, candidates, body, robot, limits, reason)
    space = np.array([_space(surface, places, i, robot) for i in range(len(places))], dtype=np.int64)
    np.maximum.at(reason, places.body, space)
    return places.of(space == TAKEN), reason


def _pairs(surface: Surface, of: Indices, robot: Robot, limits: Limits, reason: Indices) -> tuple[Array, Indices]:
    """Points and normals of candidates (m, 12), found by rays through the bodies, and their bodies (m,)."""
    which = np.flatnonzero(of >= 0)
    points, normals = surface.samples.points[which], surface.samples.smooth[which]
    least, most = (2.0 * each for each in robot.gripper.opening_m)
    across, along = _frames(normals)
    found, body = [np.zeros((0, 12))], [np.zeros(0, np.int64)]
    for a, b in _fan(limits.tilt_deg):
        way = -_unit(normals + a * across + b * along)
        distance, hit = surface.cast(points + INSIDE_M * way, way)
        width = distance + INSIDE_M
        seen = width < 2.0 * most
        faces = np.einsum("ni,ni->n", hit, way) > np.cos(np.radians(limits.tilt_deg + 5.0))
        stage = np.where(faces, np.where(width < least, NARROW, np.where(width > most, WIDE, LEANING)), OBLIQUE)
        np.maximum.at(reason, of[which], np.where(seen, stage, APART))
        good = np.flatnonzero(seen & (stage == LEANING))
        far = points[good] + width[good, None] * way[good]
        found.append(np.hstack([points[good], far, normals[good], hit[good]]))
        body.append(of[which[good]])
    pairs, number = np.concatenate(found), np.concatenate(body)
    axis = _unit(pairs[:, :3] - pairs[:, 3:6])
    axis *= np.where(axis @ [1.0, 0.1, 0.01] < 0.0, -1.0, 1.0)[:, None]
    key = np.hstack([(pairs[:, :3] + pairs[:, 3:6]) / 2.0 / PAIR_M, axis / PAIR_SHARE]).round().astype(int)
    kept = np.unique(key, axis=0, return_index=True)[1]
    return pairs[kept], number[kept]


def _fitted(surface: Surface, pairs: Array, body: Indices, robot: Robot, limits: Limits, reason: Indices) -> Places:
    """Pairs by the planes of their patches, those whose patches bear and that an upright gripper closes over."""
    radius = robot.gripper.pad_radius_m
    one, two = (_patch(surface, pairs[:, i : i + 3], pairs[:, 6 + i : 9 + i], radius, limits) for i in (0, 3))
    apart = one.middle - two.middle
    lean = np.arcsin(np.clip(_unit(apart)[:, 2], -1.0, 1.0))
    flat = _unit(apart * [1.0, 1.0, 0.0])  # of an upright gripper
    width = np.einsum("ni,ni->n", apart, flat)
    cosine = np.column_stack([np.einsum("ni,ni->n", one.normal, flat), -np.einsum("ni,ni->n", two.normal, flat)])
    tilt = np.arccos(np.clip(cosine, -1.0, 1.0))
    coverage = np.column_stack([one.coverage, two.coverage])
    middle = (one.middle + two.middle) / 2.0
    least, most = (2.0 * each for each in robot.gripper.opening_m)
    low, high = robot.grasp.pad_height_m
    limit = np.radians(limits.tilt_deg)
    stages = (
        (NARROW, width < least),
        (WIDE, width > most - 2.0 * radius),
        (ACROSS, np.abs(lean) > limit),
        (LEANING, (tilt > limit).any(axis=1)),
        (ROUGH, (coverage < limits.coverage).any(axis=1)),
        (HEIGHT, (middle[:, 2] < low) | (middle[:, 2] > high)),
    )
    alive = np.ones(len(pairs), bool)
    for stage, fails in stages:
        np.maximum.at(reason, body[alive & fails], stage)
        alive &= ~fails
    yaw = np.arctan2(flat[:, 1], flat[:, 0]) % np.pi
    ahead = np.einsum("ni,ni->n", flat[:, :2], np.column_stack([np.cos(yaw), np.sin(yaw)])) > 0.0
    normals = np.stack([one.normal, two.normal], axis=1)
    lean = np.arcsin(np.clip(normals[..., 2], -1.0, 1.0))
    aside = np.arccos(np.clip(cosine / np.maximum(np.cos(lean), 1e-9), -1.0, 1.0))
    lean, aside, coverage = (np.where(ahead[:, None], each, each[:, ::-1]) for each in (lean, aside, coverage))
    return Places(middle, yaw, width, tilt, lean, aside, coverage, body).of(alive)


@dataclass(frozen=True, eq=False)
class _Patches:
    """Outward normals (m, 3), middles (m, 3) and the share of the pad that bears (m,)."""

    normal: Array
    middle: Array
    coverage: Array


def _patch(surface: Surface, point: Array, normal: Array, radius: float, limits: Limits) -> _Patches:
    """Planes of patches: fitted by rays from over them, twice, and then judged by more."""
    at, outward = point, normal
    for last in range(ROUNDS):
        disc = _disc(radius, LAST_RINGS if last == ROUNDS - 1 else FIRST_RINGS)
        u, v = _frames(outward)
        grid = at[:, None] + disc[:, :1] * u[:, None] + disc[:, 1:] * v[:, None]
        over = (grid + LIFT_M * outward[:, None]).reshape(-1, 3)
        distance = surface.cast(over, np.repeat(-outward, len(disc), axis=0))[0].reshape(len(point), len(disc))
        off = LIFT_M - distance
        if last == ROUNDS - 1:
            break
        hit = (np.abs(off) < LIFT_M - 1e-4).astype(float)
        slope = np.clip(_fit(np.column_stack([disc, np.ones(len(disc))]), off, hit), -0.5, 0.5)
        at = at + np.clip(slope[:, 2:], -0.004, 0.004) * outward
        outward = _unit(outward - slope[:, :1] * u - slope[:, 1:2] * v)
    bears = (np.abs(off) <= limits.roughness_m).astype(float)
    turn = 2.0 * np.abs(np.linalg.eigvalsh(_curvature(disc, off, bears))).max(axis=1, initial=0.0) * radius
    return _Patches(outward, at, np.where(turn <= np.tan(np.radians(limits.turn_deg)), bears.mean(axis=1), 0.0))


def _curvature(disc: Array, off: Array, weight: Array) -> Array:
    """(n, 2, 2) the quadratic form of the paraboloids that fit `off` (n, k) best at the places (k, 2) of a disc."""
    x, y = disc.T
    found = _fit(np.column_stack([x * x, x * y, y * y, x, y, np.ones(len(disc))]), off, weight)
    return np.stack([found[:, :1], found[:, 1:2] / 2.0, found[:, 1:2] / 2.0, found[:, 2:3]], axis=1).reshape(-1, 2, 2)


def _fit(terms: Array, off: Array, weight: Array) -> Array:
    """(n, t) least squares of off (n, k) by terms (k, t), each with weights (n, k)."""
    size = np.linalg.norm(terms, axis=0)
    unit = terms / size
    squares = np.einsum("ki,kj,nk->nij", unit, unit, weight) + 1e-6 * np.eye(len(size))
    sums = np.einsum("ki,nk->ni", unit, weight * np.where(weight > 0.0, off, 0.0))
    return np.asarray(np.linalg.solve(squares, sums[..., None])[..., 0] / size)


def _space(surface: Surface, places: Places, i: int, robot: Robot) -> int:
    """`TAKEN` where the open fingers and the palm of an upright gripper have space, else what they would touch."""
    gripper, middle, yaw = robot.gripper, places.middle[i], places.yaw_rad[i]
    half, radius = places.width_m[i] / 2.0, gripper.pad_radius_m
    outer = min(half + radius, gripper.opening_m[1]) + 2.0 * radius  # a finger is as thick as its pad is wide
    palm = max(gripper.opening_m[1], outer)
    samples = surface.samples
    near = samples.points[samples.tree.query_ball_point(middle, palm + 2.0 * gripper.finger_height_m)] - middle
    x = np.abs(near @ [np.cos(yaw), np.sin(yaw), 0.0])
    in_lane = np.abs(near @ [-np.sin(yaw), np.cos(yaw), 0.0]) <= radius
    gap = lean_m(radius, float(places.tilt_rad[i].max()))
    if (in_lane & (x > half + gap) & (x < outer) & (near[:, 2] > -radius)).any():
        return BESIDE
    if (in_lane & (x < palm) & (near[:, 2] > gripper.finger_height_m - GAP_M)).any():
        return PALM
    return TAKEN


def lean_m(pad_radius_m: float, tilt_rad: float) -> float:
    """How far out of its pad's plane a face may come that leans so much, down to the pad's rim [m]."""
    return float(GAP_M + pad_radius_m * np.tan(tilt_rad))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _frames(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors (n, 3) across each normal."""
    helper = np.where(np.abs(normal[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = _unit(np.cross(normal, helper))
    return across, np.cross(normal, across)


def _disc(radius: float, rings: int) -> Array:
    """Places (k, 2) that share a disc evenly."""
    found = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        angle = 2.0 * np.pi * (np.arange(6 * ring) + 0.5 * (ring % 2)) / (6 * ring)
        found.append(ring / (rings + 0.5) * np.column_stack([np.cos(angle), np.sin(angle)]))
    return radius * np.concatenate(found)


def _fan(tilt_deg: float) -> list[tuple[float, float]]:
    """Slopes of rays about an inward normal: the other of two leaning faces is not straight behind."""
    rings = [(10.0, 4), (0.7 * tilt_deg, 6), (tilt_deg, 8)] if tilt_deg > 18.0 else [(10.0, 4)]
    slopes = [(0.0, 0.0)]
    for degrees, count in rings:
        angle, size = 2.0 * np.pi * np.arange(count) / count, np.tan(np.radians(degrees))
        slopes += [(float(size * np.cos(a)), float(size * np.sin(a))) for a in angle]
    return slopes
