"""(14), for the robot's real shapes and along the whole way: fingers, palms, links and body keep off holds, obstacles
and the wall.

Clearance is measured exactly for capsules against cuboids (the distance to a convex set is convex along a segment) and
by the separating axis theorem for boxes. Pads, which pass closest, are followed along the chords between samples.
Only what may be a violation, or the tightest place of its kind, is measured: bounds settle the rest.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from crux_planner.checker import tolerances
from crux_planner.checker.cuboids import Cuboids
from crux_planner.checker.footholds import PLANE
from crux_planner.checker.geometry import Array, Flags, Indices, box_to_box, segment_to_box, signed_distance_to_box
from crux_planner.checker.parts import BLOCK, Part
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples

NEAR_M = 0.03
"""Beyond this much clearance a lower bound of it is good enough."""


def check_clearance(
    samples: Samples,
    cuboids: Cuboids,
    limbs: list[list[Part]],
    body: list[Part],
    *,
    endless: bool,
    point_model: bool,
    spare_m: float,
    findings: Findings,
) -> None:
    """Clearance of every part of the limbs (in limb order) and of the body to every cuboid, and to z = 0 where
    the wall is `endless`; `spare_m` more to cuboids but the hold that a limb grips, which takes its hand along where
    it is elsewhere.
    """
    owners = [(index if index < len(limbs) else None, parts) for index, parts in enumerate([*limbs, body])]
    looks = [_look(part, cuboids, samples, limb, spare_m) for limb, parts in owners for part in parts]
    cuts: dict[str, float] = {}
    closest = [look.closest() for look in looks]
    for look, place, gap in zip(looks, closest, _measured(looks, closest), strict=True):
        lacks = max(look.settled_need(), float((look.required(*place) - gap).max(initial=-np.inf)))
        cuts[look.part.kind] = max(cuts.get(look.part.kind, -np.inf), min(lacks, tolerances.LENGTH_M))
    open_places = [look.places(look.may_lack >= cuts[look.part.kind]) for look in looks]
    for look, places, gaps in zip(looks, open_places, _measured(looks, open_places), strict=True):
        part, limb, cut = look.part, look.limb, cuts[look.part.kind]
        need = np.where(look.close, -np.inf, look.may_lack)
        need[places] = look.required(*places) - gaps
        for c in np.flatnonzero((need >= cut).any(axis=1)):
            where: dict[str, Any] = {"limb": limb, "finger": part.finger, "detail": f"to {cuboids.names[c]!r}"}
            lacking = np.where(need[c] >= cut, need[c], -np.inf)[look.rests]
            findings.add_series(f"clearance_{part.kind}", lacking, samples.time_s, "m", **where)
        if not endless:
            continue
        if point_model and part.kind in ("finger", "palm"):
            continue  # feet stand on the wall
        standing = (look.own_hold == PLANE) & (part.kind == "finger")
        height = np.where(standing, 0.0, tolerances.MOVING_CLEARANCE_M) - _height(look.part)
        height = np.where(np.isnan(height), -np.inf, height)[look.rests]
        where = {"limb": limb, "finger": part.finger, "detail": f"of the {part.kind}"}
        findings.add_series("clearance_wall", height, samples.time_s, "m", **where)


@dataclass(frozen=True)
class _Look:
    """One part's clearance to every cuboid, measured as far as need be. NaN where the part is nowhere.

    A part at rest, a gripper that holds on, is looked at once: `rests` (T,) tells which look each sample is. `begins`:
    looks at a limb that begins in the air, before the second knot. `clear_m`: what is asked for as a rule.
    """

    part: Part
    cuboids: Cuboids
    own_hold: Indices
    limb: int | None
    rests: Indices
    begins: Flags
    clear_m: float

    def settled_need(self) -> float:
        """Largest clearance violation among the parts that bounds decide [m]; negative: slack."""
        return float(self.may_lack[~self.close].max(initial=-np.inf))

    def closest(self) -> tuple[Indices, Indices]:
        """A cuboid and a look to measure at, if any: where clearance may lack most."""
        most = np.where(self.close, self.may_lack, -np.inf).max(initial=-np.inf)
        c, t = self.places(self.may_lack >= most)
        return c[:1], t[:1]

    def places(self, wanted: Flags) -> tuple[Indices, Indices]:
        """Cuboids and looks to measure at, of those wanted (H, T)."""
        c, t = np.nonzero(self.close & wanted)
        return c, t

    def required(self, c: Indices, t: Indices) -> Array:
        """Clearance asked at looks t to cuboids c: none of a finger to the hold that it grips, opens or closes on.

        Of a limb that begins in the air, on its way to a hold or from one, no more at first than there is at the start,
        which no plan has chosen.
        """
        required = np.full(np.broadcast_shapes(c.shape, t.shape), self.clear_m)
        if self.limb is not None:
            finger = self.part.kind == "finger"
            required[self.own_hold[t] == c] = 0.0 if finger else tolerances.MOVING_CLEARANCE_M
        if self.begins.any():
            required = np.where(self.begins[t], np.fmin(required, self._at_start[c]), required)
        return required

    @cached_property
    def _at_start(self) -> Array:
        """Clearance (H,) at the first look: what touches a hold may be measured within it."""
        every = np.arange(len(self.cuboids.names))
        gap = _measured([self], [(every, np.zeros_like(every))])[0]
        return np.maximum(gap, -tolerances.MOVING_CLEARANCE_M)

    @cached_property
    def may_lack(self) -> Array:
        """What clearance lacks at most (H, T), by bounds; -inf where the part is nowhere."""
        every = np.arange(len(self.cuboids.names))[:, None]
        return self.required(every, np.arange(len(self.part.start))) - self._bounds[0]

    @property
    def close(self) -> Flags:
        """(H, T) where only measuring settles it."""
        return self._bounds[1]

    @cached_property
    def _bounds(self) -> tuple[Array, Flags]:
        """Lower bounds (H, T) of the clearance, and where they are too small to be good enough: from the box around the
        part over some looks in a row, from a sphere where that settles nothing, last from the box around a segment.
        """
        part, cuboids = self.part, self.cuboids
        (low, high), centre = part.blocks, cuboids.centre_w_m[..., None]
        apart = np.maximum(low - centre, centre - high) - cuboids.reach_w_m[..., None]
        blocks = np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=1))
        bound = np.repeat(blocks, BLOCK, axis=1)[:, : len(part.start)]
        bound[:, np.isnan(part.start[:, 0])] = np.inf
        c, t = np.nonzero(bound < NEAR_M)
        start, end, half = self.seen(part.start, c, t), self.seen(part.end, c, t), 0.5 * cuboids.size_m[c]
        if part.half_m is not None:
            reach: Array | float = float(np.linalg.norm(part.half_m))
        else:
            reach = (0.5 * np.linalg.norm(part.end - part.start, axis=1) + part.radius_m)[t]
        bound[c, t] = signed_distance_to_box(0.5 * (start + end), half) - reach
        close = bound < NEAR_M
        if part.half_m is None:  # the box around the segment, in the cuboid's axes
            apart = np.maximum(np.minimum(start, end) - half, -half - np.maximum(start, end))
            outside = np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=1)) - part.radius_m - _ROUNDING_M
            bound[c, t] = np.where(close[c, t], np.maximum(bound[c, t], outside), bound[c, t])
        return bound, close

    def seen(self, points: Array, c: Indices, t: Indices) -> Array:
        """Points at looks t in the frames of cuboids c."""
        offset = points.T[:, t] - self.cuboids.centre_w_m.T[:, c]
        if self.cuboids.tilt_rad.any():
            turn = self.cuboids.rotation[c]
            return np.asarray((offset.T[:, None] @ turn)[:, 0])
        sine, cosine = np.sin(self.cuboids.yaw_rad)[c], np.cos(self.cuboids.yaw_rad)[c]
        x, y, z = offset
        return np.array([cosine * x + sine * y, cosine * y - sine * x, z]).T


def _look(part: Part, cuboids: Cuboids, samples: Samples, limb: int | None, spare_m: float) -> _Look:
    own_hold = samples.own_hold[:, limb] if limb is not None else np.full(len(part.start), -1)
    moved = part.moved | (np.diff(own_hold, prepend=-1) != 0)
    looks = np.flatnonzero(moved)
    in_air = limb is not None and samples.load[0, limb] == 0.0
    begins, clear_m = (samples.interval[looks] == 0) & in_air, tolerances.MOVING_CLEARANCE_M + spare_m
    return _Look(part.at(looks), cuboids, own_hold[looks], limb, np.cumsum(moved) - 1, begins, clear_m)


def _measured(looks: list[_Look], places: list[tuple[Indices, Indices]]) -> list[Array]:
    """Exact clearance of every part at its places (cuboids, looks): all capsules at once."""
    found, capsules, order = [np.zeros(len(c)) for c, _ in places], [], []
    for number, (look, (c, t)) in enumerate(zip(looks, places, strict=True)):
        if len(c) == 0:
            continue
        part = look.part
        found[number] = _off_leaning(look, c, t)
        start, half = look.seen(part.start, c, t), 0.5 * look.cuboids.size_m[c]
        if part.half_m is not None and part.rotation is not None:
            turn = look.cuboids.rotation[c].swapaxes(1, 2) @ part.rotation[t]
            found[number] = np.maximum(found[number], box_to_box(start, turn, part.half_m, half))
        else:
            capsules.append((start, look.seen(part.end, c, t), half, np.full(len(start), part.radius_m)))
            order.append(number)
    if capsules:
        start, end, half, radius = (np.concatenate(arrays) for arrays in zip(*capsules, strict=True))
        gaps = segment_to_box(start, end, half) - radius
        ends = np.cumsum([len(radii) for *_, radii in capsules])
        for number, mine in zip(order, np.split(gaps, ends[:-1]), strict=True):
            found[number] = np.maximum(found[number], mine)
    return found


def _off_leaning(look: _Look, c: Indices, t: Indices) -> Array:
    """How far the part is at looks t beyond the plane of some leaning face of the cuboids c, which are within their
    boxes: a lower bound of the distance to them; -inf where no face leans.
    """
    found, part = np.full(len(c), -np.inf), look.part
    for index in np.unique(c[look.cuboids.lean_rad[c].any(axis=1)]):
        at = np.flatnonzero(c == index)
        normals, offsets = look.cuboids.side_planes(int(index))
        ends = [look.seen(points, c[at], t[at]) @ normals.T - offsets for points in (part.start, part.end)]
        extent: Array | float = part.radius_m
        if part.half_m is not None and part.rotation is not None:
            turn = look.cuboids.rotation[index].T @ part.rotation[t[at]]
            extent = np.abs(normals @ turn) @ part.half_m
        found[at] = (np.minimum(*ends) - extent).max(axis=1)
    return found


_ROUNDING_M = 1e-9


def _height(part: Part) -> Array:
    """Clearance (T,) above the wall plane z = 0."""
    if part.half_m is not None and part.rotation is not None:
        return part.start[:, 2] - np.abs(part.rotation[:, 2, :]) @ part.half_m
    return np.minimum(part.start[:, 2], part.end[:, 2]) - part.radius_m
