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
from numpy.typing import NDArray

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array, box_to_box, segment_to_box, signed_distance_to_box
from crux_planner.checker.parts import BLOCK, Part
from crux_planner.checker.plan_arrays import Cuboids
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples

Indices = NDArray[np.int_]

NEAR_M = 0.03
"""Beyond this much clearance a lower bound of it is good enough."""


def check_clearance(
    samples: Samples,
    cuboids: Cuboids,
    limbs: list[list[Part]],
    body: list[Part],
    *,
    point_model: bool,
    findings: Findings,
) -> None:
    """Clearance of every part of the limbs (in limb order) and of the body to every cuboid and to the wall."""
    owners = [(index if index < len(limbs) else None, parts) for index, parts in enumerate([*limbs, body])]
    looks = [_look(part, cuboids, samples, limb) for limb, parts in owners for part in parts]
    cuts: dict[str, float] = {}
    closest = [look.closest() for look in looks]
    for look, place, gap in zip(looks, closest, _measured(looks, closest), strict=True):
        lacks = max(look.settled_need(), float((look.required(*place) - gap).max(initial=-np.inf)))
        cuts[look.part.kind] = max(cuts.get(look.part.kind, -np.inf), min(lacks, tolerances.LENGTH_M))
    open_places = [look.unsettled(cuts[look.part.kind]) for look in looks]
    for look, places, gaps in zip(looks, open_places, _measured(looks, open_places), strict=True):
        part, limb = look.part, look.limb
        for c, need in look.needs(cuts[part.kind], places, gaps):
            where: dict[str, Any] = {"limb": limb, "finger": part.finger, "detail": f"to {cuboids.names[c]!r}"}
            findings.add_series(f"clearance_{part.kind}", need[look.rests], samples.time_s, "m", **where)
        if point_model and part.kind in ("finger", "palm"):
            continue  # feet stand on the wall
        height = tolerances.MOVING_CLEARANCE_M - _height(part)
        height = np.where(np.isnan(height), -np.inf, height)[look.rests]
        where = {"limb": limb, "finger": part.finger, "detail": f"of the {part.kind}"}
        findings.add_series("clearance_wall", height, samples.time_s, "m", **where)


@dataclass(frozen=True)
class _Look:
    """One part's clearance to every cuboid, measured as far as need be. NaN where the part is nowhere.

    A part at rest, a gripper that holds on, is looked at once: `rests` (T,) tells which look each sample is. `begins`:
    looks at a limb that begins in the air, before the second knot.
    """

    part: Part
    cuboids: Cuboids
    own_hold: Indices
    limb: int | None
    rests: Indices
    begins: NDArray[np.bool_]

    def settled_need(self) -> float:
        """The most that clearance lacks where bounds settle it."""
        found = [-np.inf]
        far, (c, t, bound) = self._blocks[self._blocks >= NEAR_M], self._bounds
        if len(far) > 0:
            found.append(float(self._far(self._blocks == far.min())[2].max(initial=-np.inf)))
        off = bound >= NEAR_M
        if off.any():
            at = np.argmin(np.where(off, bound, np.inf), keepdims=True)
            found.append(float((self.required(c[at], t[at]) - bound[at])[0]))
        return max(found)

    def closest(self) -> tuple[Indices, Indices]:
        """A cuboid and a sample to measure at, if any: where clearance may lack most."""
        c, t, bound = self._close
        at = [] if len(c) == 0 else [int(np.argmax(self.required(c, t) - bound))]
        return c[at], t[at]

    def unsettled(self, cut: float) -> tuple[Indices, Indices]:
        """Cuboids and samples to measure at: where clearance may lack `cut` or more."""
        c, t, bound = self._close
        rows = np.flatnonzero(self.required(c, t) - bound >= cut)
        return c[rows], t[rows]

    def needs(self, cut: float, places: tuple[Indices, Indices], gaps: Array) -> list[tuple[int, Array]]:
        """(cuboid, what clearance lacks at every look) where that is `cut` or more somewhere; -inf where less."""
        c, t, bound = self._bounds
        off = (bound >= NEAR_M) & (tolerances.MOVING_CLEARANCE_M - bound >= cut)
        parts = [
            self._far((self._blocks >= NEAR_M) & (tolerances.MOVING_CLEARANCE_M - self._blocks >= cut)),
            (c[off], t[off], self.required(c[off], t[off]) - bound[off]),
            (*places, self.required(*places) - gaps),
        ]
        c, t, need = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        found = []
        for cuboid in np.unique(c[need >= cut]):
            series = np.full(len(self.part.start), -np.inf)
            mine = (c == cuboid) & (need >= cut)
            series[t[mine]] = need[mine]
            found.append((int(cuboid), series))
        return found

    def required(self, c: Indices, t: Indices) -> Array:
        """Clearance asked at samples t to cuboids c: none of a finger to the hold that it grips, opens or closes on.

        Of a limb that begins in the air, on its way to a hold or from one, no more at first than there is at the start,
        which no plan has chosen.
        """
        required = np.full(len(c), tolerances.MOVING_CLEARANCE_M)
        if self.part.kind == "finger" and self.limb is not None:
            required[self.own_hold[t] == c] = 0.0
        first = self.begins[t]
        if first.any():
            required[first] = np.fmin(required[first], self._at_start[c[first]])
        return required

    @cached_property
    def _at_start(self) -> Array:
        """Clearance (H,) at the first sample: what touches a hold may be measured within it."""
        every = np.arange(len(self.cuboids.names))
        gap = _measured([self], [(every, np.zeros_like(every))])[0]
        return np.maximum(gap, -tolerances.MOVING_CLEARANCE_M)

    def _far(self, blocks: NDArray[np.bool_]) -> tuple[Indices, Indices, Array]:
        """Cuboids, samples and what clearance lacks in some of the blocks, by their bounds."""
        c, t = self._samples_of(blocks)
        return c, t, self.required(c, t) - self._blocks[c, t // BLOCK]

    def _samples_of(self, blocks: NDArray[np.bool_]) -> tuple[Indices, Indices]:
        """Cuboids and samples in some of the blocks (H, blocks), where the part is somewhere."""
        c, block = np.nonzero(blocks)
        t = block[:, None] * BLOCK + np.arange(BLOCK)
        inside = (t < len(self.part.start)) & ~self._nowhere[np.minimum(t, len(self.part.start) - 1)]
        return np.broadcast_to(c[:, None], t.shape)[inside], t[inside]

    @cached_property
    def _nowhere(self) -> NDArray[np.bool_]:
        return np.isnan(self.part.start[:, 0])

    @cached_property
    def _blocks(self) -> Array:
        """Lower bounds (H, blocks) from the box around the part over some samples in a row."""
        (low, high), cuboids = self.part.blocks, self.cuboids
        centre = cuboids.centre_w_m[..., None]
        apart = np.maximum(low - centre, centre - high) - cuboids.reach_w_m[..., None]
        return np.asarray(np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=1)))

    @cached_property
    def _bounds(self) -> tuple[Indices, Indices, Array]:
        """Cuboids, samples and lower bounds of the clearance, from a sphere, where the blocks settle nothing."""
        part = self.part
        c, t = self._samples_of(self._blocks < NEAR_M)
        middle = 0.5 * (self.seen(part.start, c, t) + self.seen(part.end, c, t))
        if part.half_m is not None:
            reach: Array | float = float(np.linalg.norm(part.half_m))
        else:
            reach = (0.5 * np.linalg.norm(part.end - part.start, axis=1) + part.radius_m)[t]
        return c, t, np.asarray(signed_distance_to_box(middle, 0.5 * self.cuboids.size_m[c]) - reach)

    @cached_property
    def _close(self) -> tuple[Indices, Indices, Array]:
        """Cuboids, samples and lower bounds where only measuring settles it."""
        c, t, bound = self._bounds
        close = np.flatnonzero(bound < NEAR_M)
        c, t, bound = c[close], t[close], bound[close]
        if self.part.half_m is None:  # the box around the segment, in the cuboid's axes
            start, end = self.seen(self.part.start, c, t), self.seen(self.part.end, c, t)
            half = 0.5 * self.cuboids.size_m[c]
            apart = np.maximum(np.minimum(start, end) - half, -half - np.maximum(start, end))
            outside = np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=1)) - self.part.radius_m - _ROUNDING_M
            bound = np.maximum(bound, outside)
        return c, t, bound

    def seen(self, points: Array, c: Indices, t: Indices) -> Array:
        """Points at samples t in the frames of cuboids c."""
        offset = points.T[:, t] - self.cuboids.centre_w_m.T[:, c]
        sine, cosine = np.sin(self.cuboids.yaw_rad)[c], np.cos(self.cuboids.yaw_rad)[c]
        x, y, z = offset
        return np.array([cosine * x + sine * y, cosine * y - sine * x, z]).T


def _look(part: Part, cuboids: Cuboids, samples: Samples, limb: int | None) -> _Look:
    own_hold = samples.own_hold[:, limb] if limb is not None else np.full(len(part.start), -1)
    moved = part.moved | (np.diff(own_hold, prepend=-1) != 0)
    looks = np.flatnonzero(moved)
    in_air = limb is not None and samples.load[0, limb] == 0.0
    begins = (samples.interval[looks] == 0) & in_air
    return _Look(part.at(looks), cuboids, own_hold[looks], limb, np.cumsum(moved) - 1, begins)


def _measured(looks: list[_Look], places: list[tuple[Indices, Indices]]) -> list[Array]:
    """Exact clearance of every part at its places (cuboids, looks): all capsules at once."""
    found, capsules, order = [np.zeros(len(c)) for c, _ in places], [], []
    for number, (look, (c, t)) in enumerate(zip(looks, places, strict=True)):
        if len(c) == 0:
            continue
        part = look.part
        start, half = look.seen(part.start, c, t), 0.5 * look.cuboids.size_m[c]
        if part.half_m is not None and part.rotation is not None:
            turn = look.cuboids.rotation[c].swapaxes(1, 2) @ part.rotation[t]
            found[number] = box_to_box(start, turn, part.half_m, half)
        else:
            capsules.append((start, look.seen(part.end, c, t), half, np.full(len(start), part.radius_m)))
            order.append(number)
    if capsules:
        start, end, half, radius = (np.concatenate(arrays) for arrays in zip(*capsules, strict=True))
        gaps = segment_to_box(start, end, half) - radius
        ends = np.cumsum([len(radii) for *_, radii in capsules])
        for number, mine in zip(order, np.split(gaps, ends[:-1]), strict=True):
            found[number] = mine
    return found


_ROUNDING_M = 1e-9


def _height(part: Part) -> Array:
    """Clearance (T,) above the wall plane z = 0."""
    if part.half_m is not None and part.rotation is not None:
        return part.start[:, 2] - np.abs(part.rotation[:, 2, :]) @ part.half_m
    return np.minimum(part.start[:, 2], part.end[:, 2]) - part.radius_m
